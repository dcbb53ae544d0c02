import itertools

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.cost_check import first_other_cost
from inkjet_env.experiments.benchmark.suite import problem


@pytest.fixture(scope="module")
def jump():
    """Two neighbouring points of a problem between which its cost jumps, and their costs."""
    of = problem("augmented-mode")
    points = np.random.default_rng(1).uniform(-1, 1, (400, 7))
    for a, b in itertools.pairwise(points):
        for _ in range(60):  # the half in which the cost changes more
            middle = (a + b) / 2
            at_a, at, at_b = of.evaluate(np.array([a, middle, b]))
            a, b = (a, middle) if abs(at - at_a) > abs(at_b - at) else (middle, b)
        if np.abs(a - b).max() < 1e-14 and abs(at_a - at_b) > 0.1:
            return of, a, b
    raise RuntimeError("the cost jumps nowhere between these points")


def test_a_cost_at_a_jump_may_be_that_of_either_side(jump):
    of, a, b = jump
    at_a, at_b = of.evaluate(np.array([a, b]))
    assert abs(at_a - at_b) > 0.1
    assert first_other_cost(of, np.array([a, b]), np.array([at_b, at_a]), seed=0) == ""


def test_a_cost_of_neither_side_is_named(jump):
    of, a, b = jump
    wrong = 0.5 * of.evaluate(np.array([a, b])).sum()
    said = first_other_cost(of, np.array([a]), np.array([wrong]), seed=0)
    assert said.startswith("evaluation 1 costs ")
    assert said.endswith(f"not the {wrong:.9g} V it records")


def test_away_from_a_jump_no_other_cost_is_right():
    of = problem("nominal")
    points = np.random.default_rng(2).uniform(-1, 1, (20, 7))
    costs = of.evaluate(points)
    assert first_other_cost(of, points, costs, seed=0) == ""
    assert first_other_cost(of, points, costs + 1e-6, seed=0).startswith("evaluation 1 costs ")
