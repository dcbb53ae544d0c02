"""Optimisers by name."""

import subprocess
import sys

import pytest

from inkjet_env import optimizers
from inkjet_env.optimizers import registry
from inkjet_env.optimizers.particle_swarm import ParticleSwarm


@pytest.fixture
def fresh_probes():
    registry._fault.cache_clear()
    yield
    registry._fault.cache_clear()


@pytest.mark.parametrize(("typed", "meant"), [("psoo", "pso"), ("cmaes", "cma-es"), ("sb3-pp0", "sb3-ppo")])
def test_an_unknown_name_is_met_with_the_nearest(typed, meant):
    with pytest.raises(optimizers.UnknownOptimizerError, match=f"no optimiser '{typed}'. Did you mean '{meant}'"):
        optimizers.make(typed)


def test_an_unknown_option_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match="pso has no option 'particle'; it has particles, c1, c2, c3"):
        optimizers.make("pso", particle=3)
    with pytest.raises(ValueError, match="random has no option 'x'; it has none"):
        optimizers.make("random", x=1)
    with pytest.raises(ValueError, match="nevergrad-PSO has no option 'method'; it has workers"):
        optimizers.make("nevergrad-PSO", method="BO")


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"budget": 0}, ValueError, "budget must be at least 1; got 0"),
        ({"dimension": 0}, ValueError, "dimension must be at least 1; got 0"),
        ({"seed": -1}, ValueError, "seed must be at least 0; got -1"),
        ({"budget": 2.5}, TypeError, "budget must be an integer; got 2.5"),
        ({"particles": 0}, ValueError, "particles must be at least 1; got 0"),
        ({"c2": float("nan")}, ValueError, "c2 must be a finite number; got nan"),
    ],
)
def test_numbers_out_of_range_are_refused(changed, error, message):
    with pytest.raises(error, match=message):
        optimizers.make("pso", **changed)


def test_cma_es_says_that_one_dimension_is_too_few():
    with pytest.raises(ValueError, match="dimension must be at least 2 for cma-es; got 1"):
        optimizers.make("cma-es", dimension=1)


def test_a_broken_optimizer_is_reported_with_its_reason_and_the_others_are_not(monkeypatch, fresh_probes):
    def broken(self, *_):
        raise TypeError("only 0-dimensional arrays can be converted")

    monkeypatch.setattr(ParticleSwarm, "learn", broken)
    found = optimizers.availability(["pso", "random"])
    assert found["random"] is None
    assert found["pso"] == "it fails in this installation: TypeError: only 0-dimensional arrays can be converted"


def test_a_missing_package_is_the_reason(monkeypatch, fresh_probes):
    monkeypatch.setitem(sys.modules, "inkjet_env.optimizers.cma_es", None)  # importing it raises ModuleNotFoundError
    monkeypatch.delitem(sys.modules, "inkjet_env.optimizers.cma_es")
    monkeypatch.setitem(sys.modules, "cma", None)
    reason = optimizers.availability(["cma-es"])["cma-es"]
    assert reason == "cma-es needs cma, which is not installed: pip install 'inkjet-env[bench]'."
    with pytest.raises(optimizers.UnavailableOptimizerError):
        optimizers.make("cma-es")


def test_importing_the_package_imports_nothing_heavy():
    heavy = "scipy,numba,nevergrad,torch,stable_baselines3,cma,matplotlib,pandas,gymnasium,sklearn"
    code = f"import sys, inkjet_env.optimizers.loop; print([m for m in {heavy!r}.split(',') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
