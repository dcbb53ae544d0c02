"""Noise of every kind is noise, and beside it an effect is still named; `make diagnosis ARGS=noise` has 360 heads."""

import pytest

from inkjet_env.experiments.validation.noise_zoo import ZOO
from tests.mismatch.diagnoses import ids


@pytest.mark.parametrize("kind", [kind for kind in ZOO if kind != "white"])
def test_nothing_is_found_in_noise(kind, diagnosed):
    found = diagnosed(seed=21, noise_kind=kind)
    assert (found.verdict, ids(found)) == ("none", []), found.headline


@pytest.mark.parametrize("kind", ["exponential_memory", "grows_with_signal", "level_by_recording", "heavy_tails"])
def test_an_effect_is_named_in_noise(kind, diagnosed):
    assert ids(diagnosed("cubic_stiffness", noise_kind=kind)) == ["cubic_stiffness"]
