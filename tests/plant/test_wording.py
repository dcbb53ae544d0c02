"""Numbers in sentences."""

from __future__ import annotations

import math

import numpy as np
import pytest

from inkjet_env.plant.wording import percent, span_text, with_prefix


def test_values_are_told_as_they_are_read_aloud():
    assert with_prefix(-100.0, "V") == "-100 V"
    assert with_prefix(5.2e6, "V/s") == "5.2 V/µs"
    assert with_prefix(100.0, "V/s") == "100 V/s"
    assert with_prefix(0.0, "s") == "0 s"
    assert with_prefix(math.inf, "Hz") == "∞ Hz"


def test_a_value_that_rounds_up_to_the_next_prefix_takes_it():
    assert with_prefix(999.7, "Hz") == "1 kHz"
    assert with_prefix(0.99996, "s", 4) == "1 s"


def test_micrometres_and_nanometres_are_metres():
    assert with_prefix(0.0021, "um") == "2.1 nm"
    assert with_prefix(1500.0, "nm") == "1.5 µm"


@pytest.mark.parametrize("digits", [1, 2, 3])
@pytest.mark.parametrize("unit", ["Hz", "V", "s", "V/s"])
def test_no_value_is_told_with_an_exponent_and_none_is_far_off(unit, digits):
    sizes = {"": 1, "G": 1e9, "M": 1e6, "k": 1e3, "m": 1e-3, "µ": 1e-6, "n": 1e-9, "p": 1e-12}
    sizes |= {"V/µs": 1e6, "V/ms": 1e3, "V/s": 1}
    for value in np.geomspace(1e-12, 9e11, 157):
        number, told = with_prefix(value, unit, digits).split()
        size = sizes[told] if unit == "V/s" else sizes[told.removesuffix(unit)]
        assert "e" not in number
        assert float(number) * size == pytest.approx(value, rel=0.5 * 10.0 ** (1 - digits) * 1.001)


def test_small_shares_are_told_in_parts_per_million():
    assert percent(7e-7) == "0.7 ppm"
    assert percent(-1e-4, signed=True) == "-0.01 %"
    assert percent(1.0) == "100 %"
    assert percent(0.0) == "0 %"


def test_a_stretch_names_a_shared_unit_once():
    assert span_text(4e4, 1.2e5, "Hz") == "40 to 120 kHz"
    assert span_text(900.0, 1500.0, "Hz") == "900 Hz to 1.5 kHz"
    assert span_text(20.0, 20.0, "V") == "20 V"
