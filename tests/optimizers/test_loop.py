"""The loop: what it passes on, what it refuses."""

import numpy as np
import pytest

from inkjet_env import optimizers
from inkjet_env.optimizers.base import Optimizer
from inkjet_env.optimizers.loop import Interrupted, NonFiniteCostError, PointOutsideBoxError, minimise


class Sphere:
    def evaluate(self, points):
        return (points**2).sum(axis=1)


class SlopedSphere(Sphere):
    def __init__(self):
        self.seen = []

    def evaluate(self, points):
        raise AssertionError("an optimiser that uses gradients must not call evaluate")

    def evaluate_with_gradient(self, points):
        self.seen.append(points.copy())
        return (points**2).sum(axis=1), 2 * points


class Scripted(Optimizer):
    """Asks for what it is given."""

    name = "scripted"

    def __init__(self, *batches):
        self.batches = [np.atleast_2d(batch) for batch in batches]
        super().__init__(self.batches[0].shape[1], sum(len(batch) for batch in self.batches), 0)
        self.told, self.closed = [], False

    def propose(self):
        return self.batches.pop(0)

    def learn(self, points, costs, gradients):
        self.told.append((points, costs))

    def close(self):
        self.closed = True


def test_a_gradient_counts_as_one_evaluation_and_is_used():
    sphere = SlopedSphere()
    run = minimise(sphere, optimizers.make("lbfgsb-multistart", budget=25, seed=1), 25)
    assert sum(len(points) for points in sphere.seen) == 25 == run.evaluations
    assert np.array_equal(run.gradients, 2 * run.points)
    # On a sphere an exact gradient leads to the minimum within a few evaluations, where differences alone take eight.
    assert run.costs[:8].min() < 1e-12


def test_an_objective_without_gradient_is_refused_where_one_is_needed():
    with pytest.raises(ValueError, match="lbfgsb-multistart needs an objective with evaluate_with_gradient"):
        minimise(Sphere(), optimizers.make("lbfgsb-multistart", budget=5), 5)


def test_costs_are_told_as_the_objective_gave_them():
    optimizer = Scripted([[0.5, 0.0], [0.0, 1.0]], [[0.25, 0.0]])
    run = minimise(Sphere(), optimizer, 3)
    assert np.array_equal(optimizer.told[0][1], [0.25, 1.0])
    assert np.array_equal(run.costs, [0.25, 1.0, 0.0625])
    assert run.history == [[1, 0.25], [3, 0.0625]]
    assert optimizer.closed


def test_history_ends_at_the_last_evaluation_though_it_improves_nothing():
    assert minimise(Sphere(), Scripted([[0.5]], [[0.9]]), 2).history == [[1, 0.25], [2, 0.25]]


def test_an_objective_may_write_into_its_argument():
    class Vandal(Sphere):
        def evaluate(self, points):
            costs = super().evaluate(points)
            points[:] = 7
            return costs

    points = [[0.5, 0.0], [0.0, 1.0]]
    assert np.array_equal(minimise(Vandal(), Scripted(points), 2).points, points)


@pytest.mark.parametrize("value", [1.0000001, -2.0, np.nan])
def test_a_point_outside_the_box_is_named(value):
    optimizer = Scripted([[0.5, 0.0]], [[0.0, 0.0], [0.0, value]])
    with pytest.raises(PointOutsideBoxError, match=r"scripted left the box \[-1, 1\] at evaluation 3, point \[0.0, "):
        minimise(Sphere(), optimizer, 3)
    assert optimizer.closed


def test_an_infinite_gradient_is_named():
    class Cliff:
        def evaluate_with_gradient(self, points):
            return np.zeros(len(points)), np.full(points.shape, np.inf)

    with pytest.raises(NonFiniteCostError, match=r"gradients must be finite; got \[inf, .* at evaluation 1, point"):
        minimise(Cliff(), optimizers.make("lbfgsb-multistart", budget=5), 5)


def test_wrong_shapes_are_refused():
    class Wide(Sphere):
        def evaluate(self, points):
            return np.zeros((len(points), 1))

    with pytest.raises(ValueError, match=r"must return costs of shape \(2,\); got \(2, 1\)"):
        minimise(Wide(), Scripted([[0.0], [1.0]]), 2)


@pytest.mark.parametrize("budget", [0, -3])
def test_a_budget_below_one_is_refused(budget):
    with pytest.raises(ValueError, match="budget must be at least 1"):
        minimise(Sphere(), optimizers.make("random", budget=5), budget)


def test_a_budget_other_than_the_optimizers_own_is_refused():
    with pytest.raises(ValueError, match="budget must be the optimiser's own, 5; got 6"):
        minimise(Sphere(), optimizers.make("random", budget=5), 6)


def test_a_used_optimizer_is_refused():
    optimizer = optimizers.make("random", budget=200)
    points = optimizer.ask()
    optimizer.tell(points, points[:, 0])
    with pytest.raises(ValueError, match="random has already received costs"):
        minimise(Sphere(), optimizer, 200)


def test_costs_of_other_points_are_refused():
    optimizer = optimizers.make("random", budget=200)
    points = optimizer.ask()
    with pytest.raises(ValueError, match="exactly the points that ask returned"):
        optimizer.tell(points / 2, points[:, 0])


def test_on_batch_sees_the_run_grow_and_may_interrupt_it():
    counts = []

    def watch(run):
        counts.append((run.evaluations, run.best_cost, run.complete))
        if run.evaluations == 80:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="interrupted after 80 evaluations") as caught:
        minimise(Sphere(), optimizers.make("pso", budget=200), 200, on_batch=watch)
    assert [count for count, _, _ in counts] == [40, 80]
    assert counts[-1][1] == caught.value.run.best_cost
    assert not any(complete for _, _, complete in counts)


def test_a_run_interrupted_before_its_first_cost_is_empty():
    class Stopped(Sphere):
        def evaluate(self, points):
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        minimise(Stopped(), optimizers.make("pso", budget=200), 200)
    run = caught.value.run
    assert (run.evaluations, run.best_cost, run.best_point, run.history) == (0, np.inf, None, [])


def test_an_interrupt_within_a_library_is_an_interrupt_of_the_run(monkeypatch):
    from inkjet_env.optimizers import scipy_global

    def interrupted(self, point):
        self.evaluate(point[None, :])
        raise KeyboardInterrupt

    monkeypatch.setattr(scipy_global._ScipyOptimizer, "_cost", interrupted)
    with pytest.raises(Interrupted) as caught:
        minimise(Sphere(), optimizers.make("scipy-direct", budget=9), 9)
    assert caught.value.run.evaluations == 1


@pytest.mark.parametrize(
    ("recorded", "message"),
    [
        ((np.zeros((3, 2)), np.zeros(3)), r"recorded must hold points \(n, 1\)"),
        ((np.zeros((3, 1)), np.zeros(2)), r"recorded must hold points \(n, 1\)"),
        ((np.zeros((3, 1)), np.zeros(3)), "recorded holds 3 evaluations, more than the budget of 2"),
        ((np.zeros((1, 1)),), "recorded must be a Run or .points, costs. for scripted; got 1 arrays"),
    ],
)
def test_a_record_that_does_not_fit_is_refused(recorded, message):
    with pytest.raises(ValueError, match=message):
        minimise(Sphere(), Scripted([[0.0]], [[1.0]]), 2, recorded=recorded)


def test_a_record_without_its_gradients_is_refused_where_they_are_used():
    optimizer = optimizers.make("lbfgsb-multistart", budget=5)
    with pytest.raises(ValueError, match=r"recorded must be a Run or \(points, costs, gradients\)"):
        minimise(SlopedSphere(), optimizer, 5, recorded=(np.zeros((1, 7)), np.zeros(1)))
