"""The suite as other libraries take it: each by the library itself, against the problem's own costs."""

import json
import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import differential_evolution, minimize

from inkjet_env.experiments.benchmark.interfaces import Objective, ioh_problem, optuna_problem, pymoo_problem
from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.suite import problem, suite
from inkjet_env.extras import MissingExtraError
from inkjet_env.printhead import Bounds, DriverLimits

POINTS = np.random.default_rng(0).uniform(-1, 1, (6, 7))
NOMINAL = problem("nominal")


def test_every_problem_is_a_function_whose_best_known_point_costs_what_is_known():
    for name in suite():
        found = Objective(name)
        noise_V = found.problem.measurement_noise_V
        assert found(found.best_known_point) == pytest.approx(found.best_known_V, abs=60 * noise_V + 1e-8)
        assert found.evaluations == 1


def test_readings_are_those_of_a_run_of_that_seed_however_they_are_asked_for():
    one_by_one, at_once = Objective("reading-50mV", seed=3), Objective("reading-50mV", seed=3)
    costs = at_once.batch(POINTS)
    np.testing.assert_array_equal([one_by_one(point) for point in POINTS], costs)
    np.testing.assert_array_equal(costs, problem("reading-50mV").as_measured(3).evaluate(POINTS))
    assert (Objective("reading-50mV", seed=4).batch(POINTS) != costs).all()


def test_waveforms_cost_what_their_points_do_and_gradients_are_in_their_units():
    unit, physical = Objective("nominal"), Objective("nominal", physical=True)
    waveforms = NOMINAL.bounds.from_unit(POINTS)
    np.testing.assert_allclose(physical.batch(waveforms), unit.batch(POINTS), rtol=1e-9)
    np.testing.assert_allclose(physical.waveform(waveforms[0]), waveforms[0], rtol=1e-12)
    step = 1e-6 * (physical.upper - physical.lower)
    _, gradient = physical.with_gradient(waveforms[0])
    for k in range(7):
        away = np.zeros(7)
        away[k] = step[k]
        slope = (physical(waveforms[0] + away) - physical(waveforms[0] - away)) / (2 * step[k])
        assert gradient[k] == pytest.approx(slope, rel=1e-4, abs=1e-6 / step[k])


def test_what_cannot_be_is_refused_in_a_sentence():
    legal = Problem("legal", bounds=Bounds(limits=DriverLimits(rise_V_per_us=20)))
    with pytest.raises(ValueError, match="several points are one waveform"):
        Objective(legal, physical=True)
    with pytest.raises(ValueError, match="a point has 7 coordinates"):
        Objective("nominal")([0.0] * 7 + [1.0])
    with pytest.raises(ValueError, match="nominal"):
        Objective("nominall")


def test_scipy_descends_by_gradients_and_searches_a_population_in_one_call():
    found = Objective("nominal")
    descended = minimize(found.with_gradient, [0.9, -0.9, -0.9, 0, 0.3, 0, 0.9], jac=True, bounds=found.bounds)
    assert found.best_known_V - 1e-9 <= descended.fun < -20
    searched = differential_evolution(
        lambda x: found.batch(x.T), found.bounds, vectorized=True, updating="deferred", maxiter=30, polish=False, seed=1
    )
    assert found.best_known_V - 1e-9 <= searched.fun < -10


def test_pymoo_minimises_it_generation_by_generation():
    from pymoo.algorithms.soo.nonconvex.de import DE
    from pymoo.optimize import minimize as pymoo_minimize

    of = pymoo_problem("nominal")
    found = pymoo_minimize(of, DE(pop_size=50), ("n_eval", 1500), seed=1)
    assert found.F[0] == NOMINAL.evaluate(found.X)[0]
    assert of.pareto_front()[0, 0] <= found.F[0] < -10
    assert of.evaluate(of.pareto_set())[0, 0] == pytest.approx(of.pareto_front()[0, 0], abs=1e-8)
    assert of.objective.evaluations == 1501


def test_optuna_suggests_volts_and_microseconds():
    import optuna

    of = optuna_problem("nominal")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(directions=of.directions, sampler=optuna.samplers.TPESampler(seed=1))
    study.optimize(of, n_trials=30)
    values = np.array(list(study.best_params.values()))
    waveform = values * np.array([1.0, 1.0, *[1e-6] * 5])
    assert study.best_value == pytest.approx(NOMINAL.evaluate(NOMINAL.bounds.to_unit(waveform))[0], rel=1e-9)
    assert list(of.search_space) == list(study.best_params)
    assert study.best_value < 0


def test_iohs_logger_keeps_every_improvement(tmp_path):
    import ioh

    of = ioh_problem("nominal")
    assert of.optimum.y == NOMINAL.best_known.cost
    assert of.meta_data.n_variables == 7
    logger = ioh.logger.Analyzer(root=str(tmp_path), folder_name="logs", algorithm_name="random")
    of.attach_logger(logger)
    costs = [of(point) for point in POINTS]
    logger.close()
    np.testing.assert_array_equal(costs, NOMINAL.evaluate(POINTS))
    assert of.state.current_best.y == min(costs)
    (index,) = (tmp_path / "logs").glob("*.json")
    (run,) = json.loads(index.read_text())["scenarios"][0]["runs"]
    assert run["evals"] == len(POINTS)
    assert run["best"]["y"] == pytest.approx(min(costs))
    (data,) = (tmp_path / "logs").rglob("*.dat")
    assert len(data.read_text().splitlines()) == 1 + (np.minimum.accumulate(costs)[:-1] > costs[1:]).sum() + 1


def test_a_library_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ioh", None)
    monkeypatch.delitem(sys.modules, "inkjet_env.experiments.benchmark.interfaces.for_ioh", raising=False)
    with pytest.raises(MissingExtraError, match="a problem for ioh needs ioh, which is not installed"):
        ioh_problem("nominal")


def test_plain_functions_need_no_library():
    code = (
        "import sys; from inkjet_env.experiments.benchmark.interfaces import Objective\n"
        "Objective('nominal')([0.0] * 7)\n"
        "print([m for m in ('pymoo', 'optuna', 'ioh', 'pandas', 'torch') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
