"""Probabilities of a verdict: limits, order, calibration."""

import math

import numpy as np
import pytest

from inkjet_env.experiments.proof.calibration import calibration_error
from inkjet_env.experiments.publish.calibrate_probabilities import coefficients, cross_validated, figures, logit, right
from inkjet_env.mismatch.probabilities import NONE_OF_THESE, NOTHING, calibration

IDS = ("creep", "second_mode", "wave_echo")


@pytest.mark.parametrize("weights", [{}, {"creep": 1.0}, {"creep": 1.0, "wave_echo": 0.25}])
def test_they_sum_to_one(weights):
    for left_over in (0.0, 0.3, 1.0):
        for held_out in (0.0, 0.5, 1.0, math.nan):
            found = calibration().probabilities(weights, left_over, held_out, IDS)
            assert sum(found.values()) == pytest.approx(1)
            assert min(found.values()) >= 0


def test_the_more_is_left_the_more_probable_is_none_of_these():
    none = [
        calibration().probabilities({"creep": 1.0}, left, 0.001, IDS)[NONE_OF_THESE] for left in (0.0, 0.02, 0.2, 0.9)
    ]
    assert none == sorted(none)
    assert none[0] < 0.2 < 0.5 < none[-1]


def test_the_better_unseen_recordings_are_predicted_the_more_probable_is_the_name():
    named = [calibration().probabilities({"creep": 1.0}, 0.01, left, IDS)["creep"] for left in (1.0, 0.5, 0.1, 0.0)]
    assert named == sorted(named)


def test_weights_divide_what_is_right():
    found = calibration().probabilities({"creep": 1.0, "wave_echo": 0.25}, 0.0, 0.0, IDS)
    assert found["creep"] == pytest.approx(4 * found["wave_echo"])


def test_where_nothing_is_found_nothing_is_the_most_probable():
    found = calibration().probabilities({}, 0.0, math.nan, IDS)
    assert max(found, key=found.get) == NOTHING
    assert calibration().probabilities({}, 0.0, math.nan, ())[NOTHING] == found[NOTHING]


def test_the_fit_finds_the_coefficients_that_labels_were_drawn_with():
    """Rows with known probabilities: coefficients come back, and their error of calibration is small."""
    rng, beta = np.random.default_rng(3), (3.0, -1.5, -0.8, -1.0, -0.7)

    def left():
        return float(10 ** rng.uniform(-3, 0))

    rows = [(left(), math.nan if rng.random() < 0.2 else left(), bool(rng.random() < 0.4)) for _ in range(6000)]
    labels = [bool(rng.random() < 1 / (1 + math.exp(-logit(beta, *row)))) for row in rows]
    assert coefficients(rows, labels) == pytest.approx(beta, abs=0.25)
    assert calibration_error(cross_validated(rows[:2000], labels[:2000])) < 0.05


def test_several_effects_are_those_named_or_those_that_came_closest():
    fit = {"left_over": 0.1, "heldout_left_over": None}
    two = {"effects": [{"id": "creep"}, {"id": "wave_echo"}], "attributions": [{"ids": ["creep"]}], "fit": fit}
    for verdict, several in (
        (two, True),
        (two | {"effects": []}, False),
        (two | {"effects": [{"id": "creep"}]}, False),
    ):
        left_over, held_out, found = figures({"answer": {"verdict": verdict}})
        assert (left_over, math.isnan(held_out), found) == (0.1, True, several)


def test_what_came_closest_counts_where_nothing_is_named():
    verdict = {"effects": [], "candidates": [], "attributions": [{"ids": ["creep"]}]}
    case = {"draw": {"family": "effect", "effects": ["creep"]}, "answer": {"verdict": verdict}}
    assert right(case)
    assert not right(case | {"draw": {"family": "outside", "effects": ["creep"]}})
