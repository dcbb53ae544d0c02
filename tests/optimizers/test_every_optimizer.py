"""What holds for every optimiser, by one suite."""

import functools
import tempfile

import numpy as np
import pytest

from inkjet_env import optimizers
from inkjet_env.optimizers.loop import Interrupted, NonFiniteCostError, ReplayMismatchError, minimise

NAMES = [name for name, reason in optimizers.availability().items() if reason is None]
# At this budget NGOpt chooses a method that draws nothing; test_nevergrad.py looks at it at the usual budget.
DETERMINISTIC = {"scipy-direct", "nevergrad-NGOpt"}
CENTRE = np.array([0.3, -0.2, 0.1, 0.5, -0.4, 0.0, 0.25])


class Bowl:
    """``10 |x − centre|²``, with its gradient; counts its evaluations and fails or stops where it is told to."""

    def __init__(self, stop_at=None, nan_at=None):
        self.evaluations, self.stop_at, self.nan_at = 0, stop_at, nan_at

    def evaluate(self, points):
        self.evaluations += len(points)
        if self.stop_at is not None and self.evaluations >= self.stop_at:
            raise KeyboardInterrupt
        costs = 10 * ((points - CENTRE) ** 2).sum(axis=1)
        if self.nan_at is not None and self.evaluations >= self.nan_at:
            costs[self.nan_at - 1 - self.evaluations] = np.nan
        return costs

    def evaluate_with_gradient(self, points):
        return self.evaluate(points), 20 * (points - CENTRE)


def run(name, budget, seed=5, objective=None, **more):
    return minimise(objective or Bowl(), optimizers.make(name, budget=budget, seed=seed), budget, **more)


def length(name):
    """Long enough for several batches of every optimiser; a Gaussian process takes some 50 ms for each point."""
    return 36 if name == "optuna-gp" else 150


@functools.cache
def whole(name):
    """A run of that length."""
    return run(name, length(name))


def test_all_are_available_here():
    assert sorted(NAMES) == sorted(optimizers.names())
    assert len(NAMES) == 20


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("budget", [1, 7, 83])
def test_budget_is_kept_exactly(name, budget):
    bowl, budget = Bowl(), min(budget, length(name))
    result = run(name, budget, objective=bowl)
    assert bowl.evaluations == budget == result.evaluations
    assert result.points.shape == (budget, 7)
    assert result.complete
    assert (np.abs(result.points) <= 1).all()


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_gives_the_same_run(name):
    np.random.seed(1)  # noqa: NPY002  (what others do to the process-wide generator must not matter)
    again = run(name, length(name))
    assert np.array_equal(again.points, whole(name).points)
    assert np.array_equal(again.costs, whole(name).costs)


@pytest.mark.parametrize("name", sorted(set(NAMES) - DETERMINISTIC))
def test_another_seed_gives_another_run(name):
    assert not np.array_equal(run(name, length(name), seed=6).points, whole(name).points)


@pytest.mark.parametrize("name", sorted(DETERMINISTIC))
def test_a_deterministic_optimizer_ignores_the_seed(name):
    assert np.array_equal(run(name, length(name), seed=6).points, whole(name).points)


@pytest.mark.parametrize("name", NAMES)
def test_history_is_the_best_so_far(name):
    result = whole(name)
    evaluations, best = np.array(result.history).T
    assert evaluations[0] == 1
    assert evaluations[-1] == length(name)
    assert (np.diff(evaluations) > 0).all()
    assert (np.diff(best[:-1]) < 0).all()
    assert best[-1] == result.best_cost == result.costs.min()
    assert np.array_equal(result.best_point, result.points[np.argmin(result.costs)])
    for count, cost in result.history:
        assert cost == result.costs[: int(count)].min()


@pytest.mark.parametrize("name", NAMES)
def test_a_cost_that_is_not_finite_ends_the_run_and_is_named(name):
    with pytest.raises(NonFiniteCostError, match=r"costs must be finite; got nan at evaluation 31, point \[") as caught:
        run(name, length(name), objective=Bowl(nan_at=31))
    assert str(whole(name).points[30].tolist()) in str(caught.value)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("share", [0.0, 0.43, 1.0])
def test_an_interrupted_run_goes_on_bit_for_bit(name, share):
    stop_at = 1 + int(share * (length(name) - 2))
    with pytest.raises(Interrupted) as caught:
        run(name, length(name), objective=Bowl(stop_at=stop_at))
    part = caught.value.run
    assert part.evaluations < stop_at
    assert not part.complete
    bowl = Bowl()
    result = run(name, length(name), objective=bowl, recorded=part)
    assert bowl.evaluations == length(name) - part.evaluations
    assert np.array_equal(result.points, whole(name).points)
    assert np.array_equal(result.costs, whole(name).costs)


@pytest.mark.parametrize("name", NAMES)
def test_a_record_may_end_within_a_batch(name):
    full, kept = whole(name), length(name) * 71 // 150
    arrays = (full.points, full.costs) if full.gradients is None else (full.points, full.costs, full.gradients)
    bowl = Bowl()
    result = run(name, length(name), objective=bowl, recorded=tuple(array[:kept] for array in arrays))
    assert bowl.evaluations == length(name) - kept
    assert np.array_equal(result.points, full.points)


@pytest.mark.parametrize("name", sorted(set(NAMES) - DETERMINISTIC))
def test_replay_under_another_seed_is_refused(name):
    with pytest.raises(ReplayMismatchError, match=f"{name} asked for .* at evaluation .* is recorded"):
        run(name, length(name), seed=6, recorded=whole(name))


@pytest.mark.parametrize("name", sorted(set(NAMES) - DETERMINISTIC))
def test_two_optimizers_side_by_side_do_not_disturb_each_other(name):
    bowl = Bowl()
    pair = [optimizers.make(name, budget=length(name), seed=seed) for seed in (5, 6)]
    seen = []
    while pair[0].remaining:
        for optimizer in pair:
            if not optimizer.remaining:
                continue
            points = optimizer.ask()
            if optimizer is pair[0]:
                seen.append(points)
            costs, gradients = bowl.evaluate_with_gradient(points)
            optimizer.tell(points, costs, gradients if optimizer.uses_gradient else None)
    for optimizer in pair:
        optimizer.close()
        optimizer.close()
    assert np.array_equal(np.concatenate(seen), whole(name).points)


@pytest.mark.parametrize("name", NAMES)
def test_asking_twice_repeats_the_answer_and_a_spent_budget_is_said(name):
    optimizer = optimizers.make(name, budget=1)
    points = optimizer.ask()
    assert np.array_equal(optimizer.ask(), points)
    optimizer.tell(points, np.zeros(1), np.zeros((1, 7)))
    with pytest.raises(RuntimeError, match="the budget of 1 evaluations is spent"):
        optimizer.ask()
    optimizer.close()


@pytest.mark.parametrize(
    ("name", "budget", "within"),
    [
        ("random", 600, 8.0),
        ("sobol", 600, 8.0),
        ("pso", 1200, 0.1),
        ("pso-printed", 1200, 0.1),
        ("cma-es", 1200, 1e-8),
        ("bipop-cma-es", 1200, 1e-8),
        ("coordinate", 1200, 1e-4),
        ("nevergrad-TwoPointsDE", 600, 8.0),
        ("nevergrad-OnePlusOne", 600, 1e-3),
        ("pymoo-pso", 1200, 0.1),
        ("pymoo-de", 1200, 2.0),
        ("optuna-gp", 60, 0.1),
        ("scipy-differential-evolution", 1200, 2.0),
        ("scipy-dual-annealing", 600, 1e-8),
        ("scipy-direct", 1200, 1e-2),
        ("lbfgsb-multistart", 20, 1e-12),
        ("sb3-ppo", 800, 4.0),
        ("sb3-sac", 800, 4.0),
    ],
)
def test_the_minimum_of_a_bowl_is_found_as_well_as_it_should_be(name, budget, within):
    """Random points reach about 5 in 600; the mean cost over the box is about 29."""
    assert run(name, budget).best_cost < within


@pytest.mark.parametrize("name", NAMES)
def test_a_run_leaves_no_files_behind(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    run(name, 36)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif("optuna-gp" not in NAMES, reason="optuna is not installed")
@pytest.mark.parametrize("startup", [3, 10])
def test_bayesian_optimisation_listens_once_its_start_is_over(startup):
    class Mirrored(Bowl):
        def evaluate(self, points):
            return super().evaluate(-points)

    ways = []
    for objective in (Bowl(), Mirrored()):
        optimizer = optimizers.make("optuna-gp", budget=startup + 1, seed=1, startup=startup)
        ways.append(minimise(objective, optimizer, startup + 1).points)
    same = (ways[0] == ways[1]).all(axis=1)
    assert same[:startup].all()
    assert not same[startup]
