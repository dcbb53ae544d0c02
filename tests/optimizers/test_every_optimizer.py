"""What holds for every optimiser, by one suite."""

import pytest

from inkjet_env import optimizers
from inkjet_env.optimizers.loop import minimise
from inkjet_env.optimizers.testing import Bowl, OptimizerTests

NAMES = optimizers.names()
# At this budget NGOpt chooses a method that draws nothing; test_nevergrad.py looks at it at the usual budget.
DETERMINISTIC = {"scipy-direct", "nevergrad-NGOpt"}


class TestRulesOfAnOptimizer(OptimizerTests):
    """Every optimiser passes the tests that one of a user's own must pass."""

    @pytest.fixture(autouse=True, params=NAMES)
    def _one_after_another(self, request):
        self.optimizer = request.param
        self.deterministic = request.param in DETERMINISTIC
        # a Gaussian process takes 50 ms for each point
        self.budget = 36 if request.param == "optuna-gp" else 150
        self.options = {"startup": 30} if request.param == "optuna-gp" else {}


def run(name, budget, seed=5, objective=None, **more):
    return minimise(objective or Bowl(), optimizers.make(name, budget=budget, seed=seed), budget, **more)


def test_all_are_available_here():
    assert optimizers.availability() == dict.fromkeys(NAMES)
    assert len(NAMES) == 20


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
