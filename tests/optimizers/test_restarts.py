"""Searches that end before the budget does begin again elsewhere."""

import numpy as np
import pytest

from inkjet_env import optimizers
from inkjet_env.optimizers.callback import CallbackOptimizer
from inkjet_env.optimizers.loop import minimise


class Sphere:
    def evaluate(self, points):
        return (points**2).sum(axis=1)

    def evaluate_with_gradient(self, points):
        return self.evaluate(points), 2 * points


class Flat(Sphere):
    def evaluate(self, points):
        return np.zeros(len(points))

    def evaluate_with_gradient(self, points):
        return np.zeros(len(points)), np.zeros_like(points)


def test_a_descent_with_nowhere_to_go_gives_way_to_the_next_start():
    run = minimise(Flat(), optimizers.make("lbfgsb-multistart", budget=30), 30)
    assert len(np.unique(run.points, axis=0)) == 30


def test_cma_es_doubles_its_population_when_it_begins_again():
    optimizer = optimizers.make("cma-es", dimension=2, budget=3000, seed=1)
    sizes = []
    while optimizer.remaining:
        points = optimizer.ask()
        sizes.append(len(points))
        optimizer.tell(points, Sphere().evaluate(points))
    assert {6, 12, 24} <= set(sizes)
    assert sum(sizes) == 3000


def test_differential_evolution_begins_anew_where_it_has_converged():
    run = minimise(Sphere(), optimizers.make("scipy-differential-evolution", dimension=2, budget=6000, seed=1), 6000)
    spread = np.array([batch.std() for batch in run.points[:6000].reshape(-1, 30, 2)])
    converged = int(np.argmax(spread < 0.05))
    assert 0 < converged < len(spread)
    assert spread[converged:].max() > 0.4


def test_differential_evolution_goes_on_below_a_per_cent_of_the_cost():
    class Sunken(Sphere):
        def evaluate(self, points):
            return super().evaluate(points) - 10.0

    run = minimise(Sunken(), optimizers.make("scipy-differential-evolution", dimension=2, budget=3000, seed=1), 3000)
    assert run.best_cost + 10.0 < 1e-9


def test_a_practitioner_measures_no_waveform_twice_in_a_search():
    class Aside(Sphere):
        def evaluate(self, points):
            return super().evaluate(points - 0.337)

    run = minimise(Aside(), optimizers.make("coordinate", budget=600, seed=3), 600)
    assert len(np.unique(run.points.round(6), axis=0)) == 600
    assert run.best_cost < 1e-3


def test_direct_goes_on_where_its_rectangles_cannot_be_divided_further():
    optimizer = optimizers.make("scipy-direct", dimension=2, budget=18000, locally_biased=False)
    assert minimise(Sphere(), optimizer, 18000).evaluations == 18000
    assert optimizer._locally_biased


def test_closing_ends_the_library_even_if_it_clings_to_its_objective():
    ended = []

    class Clinging(CallbackOptimizer):
        name = "clinging"

        def search(self):
            try:
                self.evaluate(np.zeros((1, self.dimension)))
            finally:
                ended.append(True)
                self.evaluate(np.ones((1, self.dimension)))

    optimizer = Clinging(2, 10, 0)
    optimizer.ask()
    optimizer.close()
    assert ended == [True]
    optimizer.close()


def test_cma_es_begins_where_it_is_told_to():
    start = np.full(3, 0.7)
    optimizer = optimizers.make("cma-es", dimension=3, budget=100, seed=1, start=start.tolist(), first_step=1e-3)
    assert np.abs(optimizer.ask() - start).max() < 0.01
    for options, said in (({"start": [0.0, 2.0, 0.0]}, "start must be 3 numbers"), ({"first_step": 0}, "first_step")):
        with pytest.raises(ValueError, match=said):
            optimizers.make("cma-es", dimension=3, **options)


class Rugged(Sphere):
    """Many minima: searches stop early and begin again."""

    def evaluate(self, points):
        return (10 * points**2 - 3 * np.cos(20 * points)).sum(axis=1)


def test_bipop_shares_its_evaluations_between_two_kinds_of_restarts():
    optimizer = optimizers.make("bipop-cma-es", dimension=3, budget=20_000, seed=2)
    searches = {}
    while optimizer.remaining:
        points = optimizer.ask()
        searches.setdefault(id(optimizer._search), [optimizer._search, optimizer._now_small, 0])[2] += len(points)
        optimizer.tell(points, Rugged().evaluate(points))
    kinds = [(search.popsize, small, used) for search, small, used in searches.values()]
    default = kinds[0][0]
    large = [(population, used) for population, small, used in kinds[1:] if not small]
    small = [(population, used) for population, small, used in kinds[1:] if small]
    assert [population for population, _ in large] == [default * 2**k for k in range(1, len(large) + 1)]
    assert len(large) >= 2
    assert len(small) >= 2
    assert all(default <= population <= large[-1][0] / 2 for population, _ in small)
    assert sum(used for _, used in small) < 2 * sum(used for _, used in large)


def test_coordinate_search_moves_one_parameter_at_a_time_and_narrows_its_scans():
    optimizer = optimizers.make("coordinate", dimension=4, budget=400, seed=3)
    widths = []
    while optimizer.remaining:
        points = optimizer.ask()
        extent = np.ptp(points, axis=0)
        if len(points) > 1:
            assert np.count_nonzero(extent) == 1
            widths.append(float(extent.max()))
        optimizer.tell(points, Sphere().evaluate(points - 0.3))
    assert widths[0] == 2.0
    assert min(widths) < 0.1
