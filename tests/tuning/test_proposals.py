"""The search for waveforms: many optima, most of them of the base model."""

import numpy as np
import pytest

from inkjet_env.experiments.tuning.proposals import (
    best_points,
    distinct,
    ends_of_searches,
    head_to_use,
    refined,
    searched,
)
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()


class Bowls:
    """Bowls at several places, each of another depth; what was evaluated is counted."""

    def __init__(self, places, depths):
        self.places, self.depths, self.count = np.array(places), np.array(depths), 0

    def evaluate(self, points):
        points = np.atleast_2d(points)
        self.count += len(points)
        squares = ((points[:, None, :] - self.places[None]) ** 2).sum(axis=2)
        return (squares - self.depths).min(axis=1)


def at(value):
    return np.full(7, value)


def test_what_is_known_is_refined_best_first():
    bowls = Bowls([at(0.5), at(-0.5)], [2.0, 1.0])
    first, second = refined(bowls, [at(-0.45), at(0.55)])
    assert np.allclose(first, 0.5, atol=1e-3)
    assert np.allclose(second, -0.5, atol=1e-3)
    assert len(refined(bowls, [at(-0.45), at(0.55)], count=1)) == 1


def test_a_search_goes_on_from_what_is_known_and_stays_within_the_box():
    bowls = Bowls([at(1.3)], [0.0])
    near = searched(bowls, [at(0.9)], 8000, 0, 0)
    assert near.max() <= 1
    assert bowls.evaluate(near)[0] < 0.05 * bowls.evaluate(at(0.9))[0] + bowls.evaluate(at(1.0))[0]
    assert len(ends_of_searches(Bowls([at(0.2)], [0.0]), 50, 3, 1)) == 3


def test_an_optimum_that_only_the_base_model_shows_is_found_for_the_others():
    """The corrected head has the base model's optimum, moved a little and deeper than its own broad one."""
    base = Bowls([at(0.8)], [0.0])

    class Corrected(Bowls):
        def evaluate(self, points):
            broad = super().evaluate(points)
            narrow = 400 * ((np.atleast_2d(points) - 0.79) ** 2).sum(axis=1) - 5.0
            return np.minimum(broad, narrow)

    corrected = Corrected([at(-0.8)], [0.0])
    assert np.allclose(searched(corrected, [], 400, 1, 0), -0.8, atol=0.05)
    found = best_points({"base": base, "fit": corrected, "safe": corrected, "robust": corrected}, 400, 1, 0)
    assert np.allclose(found["base"], 0.8, atol=1e-2)
    assert np.allclose(found["fit"], 0.79, atol=1e-2)
    assert np.allclose(found["robust"], 0.79, atol=1e-2)


def test_points_that_are_the_same_are_tried_once():
    assert distinct({"a": at(0.0), "b": at(0.01), "c": at(0.5)}) == ["a", "c"]


@pytest.mark.parametrize(("before", "after", "used"), [(0.5, 0.1, True), (0.5, 0.5, False), (0.1, 0.5, False)])
def test_a_correction_that_predicts_no_better_is_not_used(before, after, used):
    mode = next(effect for effect in catalogue() if effect.id == "second_mode")
    head = AugmentedPrinthead(HEAD, ((mode, mode.example_values(HEAD)),))
    data = head.as_json(fit={"base_heldout_rms_V": before, "augmented_heldout_rms_V": after})
    assert isinstance(head_to_use(data, HEAD), AugmentedPrinthead) == used
