"""How sure a0, a1 and b1 are."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification import identify
from inkjet_env.mismatch import DiagnosisSettings, SelectionSettings
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection import base_intervals
from inkjet_env.mismatch.selection.base_intervals import dynamics
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.printhead import Printhead


def test_intervals_of_the_base_model_are_as_wide_as_those_of_the_identification(recorded, fitted):
    """Another fit, another noise model, other sensitivities; or wider, where few conditions scatter by more."""
    campaign = recorded(seed=5)
    joint, identified = fitted(campaign), identify(campaign).dynamics
    classical = DiagnosisSettings(selection=SelectionSettings(least_conditions=1e6))
    alone = dynamics(base_hypothesis(OutputErrorFit(joint.observed, joint.noise, joint.start, classical)))
    for name, estimate in dynamics(base_hypothesis(joint)).items():
        widths = [one.high - one.low for one in (estimate, alone[name], identified[name])]
        assert widths[1] == pytest.approx(widths[2], rel=0.25)
        assert widths[0] >= 0.999 * widths[1]


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
    along = Hypothesis(joint.fit(ActiveEffects.of([(effect, values("quadratic_damping"))])), joint)
    found, alone = dynamics(along), dynamics(base_hypothesis(fitted(recorded(seed=3))))
    widths = [(d["a1"].high - d["a1"].low) / d["a1"].value for d in (found, alone)]
    assert widths[0] > 1.2 * widths[1]
    assert found["a1"].low < joint.start.printhead.a1 < found["a1"].high


def test_what_no_recording_tells_has_an_infinite_interval(recorded, fitted):
    campaign = recorded()
    slow = replace(campaign, recordings=tuple(r for r in campaign.recordings if r.channel == "strain_gauge"))
    found = dynamics(base_hypothesis(fitted(slow)))
    assert {name: (e.low, e.high) for name, e in found.items()} == {
        "a0": (0.0, math.inf),
        "a1": (0.0, math.inf),
        "b1": (-math.inf, math.inf),
    }


def test_a_head_that_answers_the_other_way_round_has_the_same_interval_mirrored(recorded, fitted):
    hypothesis = base_hypothesis(fitted(recorded()))
    head = hypothesis.fit.head
    mirrored = replace(head, printhead=replace(head.printhead, b1=-head.printhead.b1))
    b1 = dynamics(hypothesis)["b1"]
    other = dynamics(replace(hypothesis, fit=hypothesis.fit.moved(head=mirrored)))["b1"]
    assert (other.value, other.low, other.high) == (-b1.value, -b1.high, -b1.low)


def test_a_sum_may_be_told_where_neither_of_its_terms_is():
    columns = np.array([[1e4, 1e4, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    directions = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    weights, unknown = base_intervals._weights(columns, directions, 5.0)
    assert unknown.tolist() == [True, False, True, True]
    assert np.linalg.norm(weights[1]) == pytest.approx(1e-4)


def test_what_is_not_told_stands_in_the_printhead_file_as_an_open_interval(recorded, fitted, tmp_path):
    campaign = recorded()
    slow = replace(campaign, recordings=tuple(r for r in campaign.recordings if r.channel == "strain_gauge"))
    hypothesis = base_hypothesis(fitted(slow))
    intervals = {name: (e.low, e.high) for name, e in dynamics(hypothesis).items()}
    hypothesis.fit.head.printhead.to_json(tmp_path / "head.json", intervals)
    written = json.loads((tmp_path / "head.json").read_text())["dynamics"]
    assert (written["a0"]["low"], written["a0"]["high"]) == (0.0, None)
    assert (written["b1"]["low"], written["b1"]["high"]) == (None, None)
    assert Printhead.from_json(tmp_path / "head.json") == hypothesis.fit.head.printhead
