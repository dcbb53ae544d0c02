"""How sure a0, a1 and b1 are."""

from dataclasses import replace

import pytest

from inkjet_env.identification import identify
from inkjet_env.mismatch.selection.base_intervals import dynamics
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis
from inkjet_env.plant.effect import coordinates


def test_intervals_of_the_base_model_are_as_wide_as_those_of_the_identification(recorded, fitted):
    """Another fit, another noise model, other sensitivities."""
    campaign = recorded(seed=5)
    found, identified = dynamics(base_hypothesis(fitted(campaign))), identify(campaign).dynamics
    for name, estimate in found.items():
        other = identified[name]
        assert estimate.high - estimate.low == pytest.approx(other.high - other.low, rel=0.25)


def test_intervals_hold_the_truth_about_as_often_as_they_say(recorded, fitted, head):
    """90 % of 45: 34 or fewer has a probability below 0.4 %."""
    hits = 0
    for seed in range(15):
        found = dynamics(base_hypothesis(fitted(recorded(seed=seed))))
        hits += sum(found[name].low < getattr(head, name) < found[name].high for name in ("a0", "a1", "b1"))
    assert hits >= 35


def test_an_effect_fitted_along_leaves_the_head_less_sure(recorded, fitted, effects, values):
    joint = fitted(recorded("quadratic_damping"))
    effect = effects["quadratic_damping"]
    along = Hypothesis(joint.fit([effect], coordinates(effect, values("quadratic_damping"))), joint)
    found, alone = dynamics(along), dynamics(base_hypothesis(fitted(recorded(seed=3))))
    widths = [(d["a1"].high - d["a1"].low) / d["a1"].value for d in (found, alone)]
    assert widths[0] > 1.2 * widths[1]
    assert found["a1"].low < joint.start.printhead.a1 < found["a1"].high


def test_what_no_recording_tells_has_no_interval(recorded, fitted):
    campaign = recorded()
    slow = replace(campaign, recordings=tuple(r for r in campaign.recordings if r.channel == "strain_gauge"))
    for estimate in dynamics(base_hypothesis(fitted(slow))).values():
        assert estimate.low == estimate.value == estimate.high
