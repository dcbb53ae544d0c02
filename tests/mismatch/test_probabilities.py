"""Probabilities of a verdict: limits, order, calibration."""

import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.proof.calibration import calibration_error
from inkjet_env.experiments.publish.calibrate_probabilities import (
    coefficients,
    cross_validated,
    explanation,
    right,
    told,
)
from inkjet_env.mismatch.probabilities import NONE_OF_THESE, NOTHING, Explanation, calibration

IDS = ("creep", "second_mode", "wave_echo")


@pytest.mark.parametrize("weights", [{}, {"creep": 1.0}, {"creep": 1.0, "wave_echo": 0.25}, {NONE_OF_THESE: 1.0}])
def test_they_sum_to_one(weights):
    for left_over in (0.0, 0.3, 1.0):
        for held_out in (0.0, 0.5, 1.0, math.nan):
            best = Explanation(left_over, held_out, ("resonator",)) if weights else None
            found = calibration().probabilities(weights, best, IDS)
            assert sum(found.values()) == pytest.approx(1)
            assert min(found.values()) >= 0


def test_the_more_is_left_the_more_probable_is_none_of_these():
    none = [
        calibration().probabilities({"creep": 1.0}, Explanation(left, 0.001, ("hysteresis",)), IDS)[NONE_OF_THESE]
        for left in (0.0, 0.02, 0.2, 0.9)
    ]
    assert none == sorted(none)
    assert none[0] < 0.2 < 0.5 < none[-1]


def test_the_better_unseen_recordings_are_predicted_the_more_probable_is_the_name():
    named = [
        calibration().probabilities({"creep": 1.0}, Explanation(0.01, left, ("hysteresis",)), IDS)["creep"]
        for left in (1.0, 0.5, 0.1, 0.0)
    ]
    assert named == sorted(named)


def test_weights_divide_what_is_right():
    found = calibration().probabilities({"creep": 1.0, "wave_echo": 0.25}, Explanation(0.0, 0.0, ("hysteresis",)), IDS)
    assert found["creep"] == pytest.approx(4 * found["wave_echo"])


def test_where_nothing_is_found_nothing_is_the_most_probable():
    found = calibration().probabilities({}, None, IDS)
    assert max(found, key=found.get) == NOTHING
    assert calibration().probabilities({}, None, ())[NOTHING] == found[NOTHING]


def test_several_effects_overlap_and_act_in_one_stage_or_do_not():
    one = Explanation(0.03, 0.3, ("drive",), 0.4)
    assert one.features == pytest.approx((1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0), abs=0.03)
    assert replace(one, stages=("drive", "sensing")).features[4:] == (1.0, 0.4, 0.0)
    assert replace(one, stages=("drive", "drive"), overlap=-0.2).features[4:] == (1.0, 0.0, 1.0)
    assert replace(one, held_out=math.nan).features[2:4] == (0.0, 1.0)


def test_the_fit_finds_the_coefficients_that_labels_were_drawn_with():
    """Explanations with known probabilities: coefficients come back, and their error of calibration is small."""
    rng, beta = np.random.default_rng(3), (3.0, -1.5, -0.8, -1.0, -0.7, -2.0, -1.2)

    def left():
        return float(10 ** rng.uniform(-3, 0))

    def drawn():
        stages = (("drive",), ("drive", "sensing"), ("drive", "drive"))[rng.integers(3)]
        return Explanation(left(), math.nan if rng.random() < 0.2 else left(), stages, rng.uniform(0, 0.8))

    made = [drawn() for _ in range(8000)]
    labels = [bool(rng.random() < told(beta, one)) for one in made]
    assert coefficients(made, labels) == pytest.approx(beta, abs=0.3)
    assert calibration_error(cross_validated(made[:2000], labels[:2000])) < 0.05


def test_an_explanation_is_what_was_named_or_what_came_closest():
    fit = {"left_over": 0.1, "heldout_left_over": None, "overlap": 0.2}
    two = {"effects": [{"id": "creep"}, {"id": "wave_echo"}], "attributions": [{"ids": ["creep"]}], "fit": fit}
    by_chance = two | {"effects": [{"id": "mains_hum"}, {"id": "creep"}, {"id": "baseline_drift"}]}
    for verdict, stages in (
        (two, ("hysteresis", "resonator")),
        (two | {"effects": []}, ("hysteresis",)),
        (by_chance, ("hysteresis",)),
    ):
        found = explanation({"answer": {"verdict": verdict}})
        assert (found.left_over, math.isnan(found.held_out), found.stages, found.overlap) == (0.1, True, stages, 0.2)


def test_what_came_closest_counts_where_nothing_is_named():
    verdict = {"effects": [], "candidates": [], "attributions": [{"ids": ["creep"]}]}
    case = {"draw": {"family": "effect", "effects": ["creep"]}, "answer": {"verdict": verdict}}
    assert right(case)
    assert not right(case | {"draw": {"family": "outside", "effects": ["creep"]}})
