"""What nevergrad does behind our interface: repeatably, without threads, unless it is refused."""

import threading

import numpy as np
import pytest

from inkjet_env import optimizers
from inkjet_env.optimizers import nevergrad_threads


def bumpy(points):
    return 10 * ((points - 0.3) ** 2).sum(axis=1) + np.cos(9 * points).sum(axis=1)


def first_points(name, count, seed, budget=2000, disturb=False):
    """The first points of a run, and how many threads and bits of others' randomness it left changed."""
    optimizer = optimizers.make(name, budget=budget, seed=seed)
    seen = []
    while budget - optimizer.remaining < count:
        if disturb:
            np.random.random()  # noqa: NPY002
        points = optimizer.ask()
        seen.append(points)
        optimizer.tell(points, bumpy(points))
    optimizer.close()
    return np.concatenate(seen)


@pytest.fixture(scope="module")
def ngopt_points():
    return first_points("nevergrad-NGOpt", 170, 5)


def test_ngopt_repeats_itself_under_its_seed_whatever_else_draws_random_numbers(ngopt_points):
    """At this budget it runs pycma, which by itself reseeds NumPy from the clock, in a thread."""
    assert np.array_equal(first_points("nevergrad-NGOpt", 170, 5, disturb=True), ngopt_points)
    assert not np.array_equal(first_points("nevergrad-NGOpt", 170, 6), ngopt_points)


def test_no_thread_is_left_and_nothing_stays_exchanged():
    others = set(threading.enumerate())  # of whatever ran in this process before, such as a cluster's
    first_points("nevergrad-NGOpt", 170, 5)
    assert set(threading.enumerate()) <= others
    assert nevergrad_threads.recaster.MessagingThread is not nevergrad_threads.Conversation
    assert str(nevergrad_threads.cma_default_options["seed"]).startswith("time")


def test_others_random_numbers_go_on_undisturbed():
    np.random.seed(3)  # noqa: NPY002
    expected = np.random.random(4)  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    first = np.random.random(2)  # noqa: NPY002
    first_points("nevergrad-NGOpt", 60, 5)
    assert np.array_equal([*first, *np.random.random(2)], expected)  # noqa: NPY002


def test_any_other_name_of_its_registry_works():
    optimizer = optimizers.make("nevergrad-RandomSearch", budget=9)
    assert optimizer.name == "nevergrad-RandomSearch"
    assert (np.abs(optimizer.ask()) <= 1).all()


def test_workers_are_asked_side_by_side_and_never_beyond_the_budget():
    optimizer = optimizers.make("nevergrad-TwoPointsDE", budget=10, workers=4)
    sizes = []
    while optimizer.remaining:
        points = optimizer.ask()
        sizes.append(len(points))
        optimizer.tell(points, bumpy(points))
    assert sizes == [4, 4, 2]


@pytest.mark.parametrize("name", ["nevergrad-BO", "nevergrad-PCABO", "nevergrad-BayesOptimBO"])
def test_its_bayesian_optimizers_are_refused_with_a_reason(name):
    with pytest.raises(optimizers.UnavailableOptimizerError, match="outdated libraries and hang"):
        optimizers.make(name)


def test_bobyqa_is_not_taken_for_a_bayesian_one():
    reasons = optimizers.availability(["nevergrad-BOBYQA", "nevergrad-BO"])
    assert ["Bayesian" in str(reasons[name]) for name in ("nevergrad-BOBYQA", "nevergrad-BO")] == [False, True]


def test_a_mistyped_name_of_its_registry_is_met_with_the_nearest():
    with pytest.raises(optimizers.UnknownOptimizerError, match="Did you mean 'nevergrad-TwoPointsDE'"):
        optimizers.make("nevergrad-TwoPointDE")
