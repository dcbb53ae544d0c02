"""Peak costs with vector instructions: those of the scalar path."""

import math

import numpy as np
import pytest
from numba import njit

from inkjet_env.printhead import Bounds, PeakCost, Printhead, batch, lanes
from inkjet_env.printhead.compiled_lanes import BELOW, BEYOND, SCALAR, kinds_of
from inkjet_env.printhead.vector_functions import atan2, cos_sin, exp
from inkjet_env.printhead.vector_type import (
    bits,
    both,
    differ,
    either,
    floor,
    load,
    magnitude,
    root,
    same,
    spread,
    store,
    where,
)

HEAD = Printhead.published()
BEST = (100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)


def drawn(count, seed, bounds=None):
    return (bounds or Bounds()).from_unit(np.random.default_rng(seed).uniform(-1, 1, (count, 7)))


def kinds(rows, table=None, window_s=350e-6):
    found, keys = np.empty(len(rows), np.int8), np.empty(len(rows), np.int16)
    kinds_of(rows, batch.head_table(HEAD) if table is None else table, window_s, 1, found, keys)
    return found


@pytest.mark.parametrize("cost", [PeakCost(), PeakCost(-3, 2, target_height_V=4.0), PeakCost(-10, 5)])
def test_costs_are_those_of_the_scalar_path(cost):
    rows = drawn(5000, seed=0)
    np.testing.assert_allclose(lanes.costs(rows, HEAD, cost), batch.costs(rows, HEAD, cost), rtol=0, atol=3e-10)
    assert {BELOW, BEYOND} == set(kinds(rows))


def test_one_head_for_each_waveform():
    rng = np.random.default_rng(1)
    ranges = ((35e3, 70e3), (0.03, 0.08), (0.7, 1.3), (0.6, 1.4))
    table = batch.varied_head_table(HEAD, *(rng.uniform(*ends, 3000) for ends in ranges))
    rows = drawn(3000, seed=2)
    np.testing.assert_allclose(lanes.costs(rows, table), batch.costs(rows, table), rtol=0, atol=3e-10)


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 11, 16])
def test_laws_of_every_degree(degree):
    rng = np.random.default_rng(degree)
    head = Printhead(4e10, 4e4, 2e4, (*rng.uniform(-0.1, 0.1, degree - 1), 0.8, 0.0), 150.0)
    rows = drawn(2000, seed=3)
    np.testing.assert_allclose(lanes.costs(rows, head), batch.costs(rows, head), rtol=0, atol=3e-10)


def test_edges_of_all_lengths():
    """From nothing to several periods, beside voltages of up to 300 V: many are left to the scalar path."""
    wide = Bounds(lower=(0, -300, 0, 0, 0, 0, 0), upper=(300, 0, *[60e-6] * 5))
    rows = drawn(4000, seed=4, bounds=wide)
    rows[2000:, 2:] *= 10.0 ** np.random.default_rng(5).uniform(-9, 0, (2000, 5))
    found = kinds(rows, window_s=500e-6)
    assert {SCALAR, BELOW, BEYOND} == set(found)
    costs = lanes.costs(rows, HEAD, window_s=500e-6)
    np.testing.assert_allclose(costs, batch.costs(rows, HEAD, window_s=500e-6), rtol=1e-11, atol=3e-10)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 65])
def test_any_number_of_waveforms(count):
    rows = drawn(count, seed=6)
    np.testing.assert_allclose(lanes.costs(rows, HEAD), batch.costs(rows, HEAD), rtol=0, atol=3e-10)
    assert lanes.costs(rows[:0], HEAD).shape == (0,)


def test_the_best_known_waveform_and_its_neighbours():
    near = Bounds().to_unit(BEST) + 0.03 * np.random.default_rng(7).standard_normal((2000, 7))
    rows = Bounds().from_unit(np.clip(near, -1, 1))
    costs = lanes.costs(rows, HEAD)
    np.testing.assert_allclose(costs, batch.costs(rows, HEAD), rtol=0, atol=3e-10)
    assert lanes.costs(BEST, HEAD)[0] == pytest.approx(-22.8301, abs=1e-3)


def test_waveforms_of_nothing():
    nothing = [0, 0, *[5e-6] * 5]
    one_pulse = [80, 0, *[5e-6] * 5]
    np.testing.assert_array_equal(kinds(np.array([nothing, one_pulse], dtype=float)), [SCALAR, SCALAR])
    np.testing.assert_array_equal(
        lanes.costs([nothing, one_pulse, BEST], HEAD)[:2], batch.costs([nothing, one_pulse], HEAD)
    )


def test_what_lanes_cannot_is_refused_in_a_sentence():
    rows = drawn(3, seed=8)
    for cost, window_s in ((PeakCost(effective="first"), 350e-6), (PeakCost(effective=3.0), 350e-6), (None, math.inf)):
        with pytest.raises(ValueError, match=r"lanes need a finite window_s.*batch\.costs computes every cost"):
            lanes.costs(rows, HEAD, cost, window_s)


@njit
def computed(a, b, out):
    x, y = load(a, 0), load(b, 0)
    c, s = cos_sin(x * 7.0)
    low = x < y
    for k, value in enumerate(
        (x + y, x - 2.0, 3.0 * y, x / y, magnitude(x), root(magnitude(y)), floor(x), where(low, x, y), spread(4.0),
         c, s, atan2(x, y), exp(-1.0 * magnitude(x)))
    ):  # fmt: skip
        store(out, 8 * k, value)
    return (
        bits(low), bits(x <= y), bits(x > y), bits(x >= y), bits(same(x, x)), bits(both(low, x < 0.0)),
        bits(either(low, x < 0.0)), bits(differ(low, x < 0.0)),
    )  # fmt: skip


def test_a_vector_computes_eight_numbers():
    rng = np.random.default_rng(9)
    for _ in range(50):
        a, b = rng.uniform(-3, 3, (2, 8))
        out = np.empty(13 * 8)
        masks = computed(a, b, out)
        wanted = (
            a + b, a - 2, 3 * b, a / b, abs(a), np.sqrt(abs(b)), np.floor(a), np.where(a < b, a, b), np.full(8, 4.0),
            np.cos(7 * a), np.sin(7 * a), np.arctan2(a, b), np.exp(-abs(a)),
        )  # fmt: skip
        np.testing.assert_allclose(out, np.concatenate(wanted), rtol=4e-15, atol=4e-15)
        low, negative = a < b, a < 0
        truths = low, a <= b, ~(a <= b), ~low, low | ~low, low & negative, low | negative, low ^ negative
        assert list(masks) == [int(sum(1 << i for i in range(8) if truth[i])) for truth in truths]
