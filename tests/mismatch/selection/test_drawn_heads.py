"""Heads that recordings leave possible: as wide as the intervals, and with the effects that were found."""

import math

import numpy as np
import pytest

from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.mismatch.selection.base_intervals import dynamics
from inkjet_env.mismatch.selection.drawn_heads import drawn_heads
from inkjet_env.mismatch.selection.hypotheses import base_hypothesis
from inkjet_env.mismatch.settings import EnsembleSettings
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import ensemble_of
from inkjet_env.plant.printhead_file import printhead_of


@pytest.fixture(scope="module")
def base(fitted, recorded):
    return base_hypothesis(fitted(recorded()))


def drawn(hypothesis, heads, seed=0):
    rng = np.random.default_rng(seed)
    return drawn_heads([(hypothesis, 1.0)], 1, None, EnsembleSettings(heads=heads), rng)


def test_draws_scatter_as_the_intervals_say(base):
    found = drawn(base, 400)
    for name in ("a0", "a1"):
        estimate = dynamics(base)[name]
        spread = np.std([math.log(getattr(head, name)) for head in found.heads])
        assert spread == pytest.approx(math.log(estimate.high / estimate.value) / QUANTILE_90, rel=0.2)


def test_the_first_head_is_the_fit_itself(base):
    first = drawn(base, 5).heads[0]
    assert first == base.fit.head.printhead


def test_rivals_share_the_heads_by_their_probabilities(base):
    found = drawn_heads([(base, 3.0), (base, 1.0)], 1, None, EnsembleSettings(heads=16), np.random.default_rng(0))
    assert found.weights[:12] == pytest.approx([0.75 / 12] * 12)
    assert found.weights[12:] == pytest.approx([0.25 / 4] * 4)


def test_the_heads_of_a_diagnosis_have_its_effect_near_its_values(diagnosed):
    found = diagnosed("cubic_stiffness")
    stiffening = [dict(head.effects[0][1])["stiffening_per_V2"] for head in found.ensemble.heads]
    named = found.effects[0].parameters["stiffening_per_V2"]
    assert stiffening[0] == pytest.approx(named.value)
    error = (named.high - named.low) / 2 / QUANTILE_90
    assert np.abs(np.array(stiffening) - named.value).max() < 6 * error
    assert np.std(stiffening) > 0.3 * error


def test_a_head_without_effects_is_drawn_where_nothing_is_missing(diagnosed):
    heads = diagnosed().ensemble.heads
    assert len(heads) == EnsembleSettings().heads
    assert not any(isinstance(head, AugmentedPrinthead) for head in heads)


def test_the_printhead_file_holds_them(diagnosed):
    found = diagnosed("cubic_stiffness")
    content = found.augmented_json()
    again = ensemble_of(content)
    assert again.weights == pytest.approx(found.ensemble.weights)
    waveform = np.array([[100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6]])
    np.testing.assert_allclose(again.costs(waveform), found.ensemble.costs(waveform), atol=1e-6)
    assert printhead_of(content).effects[0][0].id == "cubic_stiffness"
