"""Tests that every problem must pass, one of your own too.

In a test file of yours, for pytest::

    from inkjet_env.experiments.benchmark.testing import ProblemTests
    from my_lab import tall_drop


    class TestTallDrop(ProblemTests):
        problem = tall_drop
"""

from __future__ import annotations

import json

import numpy as np

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.settings import KNOWN_COST_ERROR
from inkjet_env.typing import Real

STEP = 1e-7
"""Step of the finite differences, in half widths of the box."""


class ProblemTests:
    """Tests of the rules of `Problem`; a subclass names what is tested.

    Attributes
    ----------
    problem : Problem
        The problem.
    tried : int
        Number of random waveforms that are tried.
    """

    problem: Problem
    tried = 64

    def _points(self) -> Real:
        return np.random.default_rng(0).uniform(-1.0, 1.0, (self.tried, 7))

    def test_costs_are_finite_and_of_each_point_alone(self) -> None:
        points = self._points()
        costs = self.problem.evaluate(points)
        assert costs.shape == (len(points),), f"costs of {len(points)} points have shape {costs.shape}"
        assert np.isfinite(costs).all(), f"the cost of {points[~np.isfinite(costs)][0].tolist()} is not finite"
        again = np.array([self.problem.evaluate(point)[0] for point in points[:8]])
        assert np.array_equal(again, costs[:8]), "a point's cost depends on the other points, or on the time"

    def test_a_point_outside_the_box_costs_what_the_nearest_one_within_costs(self) -> None:
        points = 1.5 * self._points()
        inside = self.problem.evaluate(np.clip(points, -1.0, 1.0))
        assert np.array_equal(self.problem.evaluate(points), inside), "points outside the box are not clipped"

    def test_gradients_are_those_of_the_costs(self) -> None:
        if not self.problem.has_gradient:
            return
        points = 0.99 * self._points()[:16]
        costs, gradients = self.problem.evaluate_with_gradient(points)
        assert np.array_equal(costs, self.problem.evaluate(points)), "costs with gradients differ from those without"
        steps = STEP * np.eye(7)
        differences = np.array(
            [(self.problem.evaluate(points + s) - self.problem.evaluate(points - s)) / (2 * STEP) for s in steps]
        ).T
        scale = np.abs(differences).max(axis=1, keepdims=True)
        wrong = (np.abs(gradients - differences) > 1e-3 * scale + 1e-6).any(axis=1)
        # one in eight may lie beside a jump or a kink of the cost
        assert wrong.mean() <= 1 / 8, (
            f"gradients differ from finite differences at {wrong.sum()} of {len(wrong)} points"
        )

    def test_readings_with_errors_depend_on_the_seed_and_their_number_alone(self) -> None:
        points = self._points()[:8]
        first, again = (self.problem.as_measured(3).evaluate(points) for _ in range(2))
        later = self.problem.as_measured(3, 4).evaluate(points[4:])
        assert np.array_equal(first, again), "two runs with one seed read different costs"
        assert np.array_equal(first[4:], later), "a resumed run reads other costs than one in one piece"

    def test_its_settings_are_json_and_say_all_of_a_plain_problem(self) -> None:
        settings = json.loads(json.dumps(self.problem.settings()))
        if type(self.problem) is Problem:
            again = Problem.from_settings(self.problem.name, settings)
            points = self._points()[:8]
            same = np.array_equal(again.evaluate(points), self.problem.evaluate(points))
            assert same, "a problem with the same settings has other costs"

    def test_the_best_known_waveform_has_its_cost_and_no_random_one_a_lower_cost(self) -> None:
        known = self.problem.best_known
        assert known is not None, "it has no best known cost, from which a comparison counts regrets: give known=…"
        best = self.problem.bounds.to_unit(np.array(known.waveform))
        assert (np.abs(best) <= 1 + 1e-9).all(), "the best known waveform lies outside the bounds"
        cost = float(self.problem.evaluate(best)[0])
        assert abs(cost - known.cost) <= KNOWN_COST_ERROR * max(1.0, abs(cost)), (
            f"its cost is {cost} V, not {known.cost} V"
        )
        lowest = float(self.problem.evaluate(self._points()).min())
        assert lowest >= known.cost - 1e-9 * abs(cost), f"a random waveform costs {lowest} V, less than {known.cost} V"
