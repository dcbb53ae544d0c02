import json

import numpy as np
import pytest

from inkjet_env.experiments.benchmark import entrants
from inkjet_env.experiments.benchmark.data import data_file
from inkjet_env.experiments.benchmark.regret import best_known_cost, scale_V
from inkjet_env.experiments.benchmark.run_files import RunKey, label_of
from inkjet_env.experiments.benchmark.runner import perform
from inkjet_env.experiments.benchmark.settings import BenchSettings
from inkjet_env.experiments.benchmark.studies import tune_optimizers
from inkjet_env.experiments.benchmark.suite import suite
from inkjet_env.optimizers import UnknownOptimizerError, make, uses_gradient
from inkjet_env.optimizers.loop import minimise


@pytest.fixture
def found(monkeypatch):
    """Settings of a swarm of eight, as if they had been found."""
    monkeypatch.setattr(entrants, "tuned_settings", lambda: {"pso": {"options": {"particles": 8}}})


def test_an_entrant_with_found_settings_is_the_optimizer_made_with_them(found):
    settings = BenchSettings(("nominal",), ("pso", "pso-tuned"), repeats=1, budget=64)
    key = RunKey("pso-tuned", "nominal", 0)
    result = perform(key, settings)[1]
    from inkjet_env.experiments.benchmark.suite import problem

    again = minimise(problem("nominal"), make("pso", 7, 64, key.seed(0), particles=8), 64)
    assert result.costs_V[-1] == again.best_cost
    label = label_of(key, settings.to_json())
    assert label["options"] == {"particles": 8}
    assert label_of(RunKey("pso", "nominal", 0), settings.to_json())["options"] == {}


def test_who_has_no_found_settings_is_refused(found):
    with pytest.raises(ValueError, match=r"there are no tuned settings for 'random'; there are for pso"):
        entrants.entrant("random-tuned")
    with pytest.raises(UnknownOptimizerError, match="'psq'"):
        entrants.entrant("psq-tuned")


def test_heads_to_tune_on_are_not_those_of_the_suite_nor_those_of_the_second_trial():
    of_suite = {problem.printhead for problem in suite().values() if problem.has_gradient}
    first, second = (
        tune_optimizers.training_problems(seed) for seed in (tune_optimizers.TRYING, tune_optimizers.AGAIN)
    )
    heads = [problem.printhead for problem in (*first, *second)]
    assert len(set(heads)) == len(heads) == 2 * tune_optimizers.HEADS
    assert not of_suite & set(heads)


def test_every_setting_that_may_be_tried_is_one_that_the_optimizer_has():
    optuna = pytest.importorskip("optuna")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    for name, asked in tune_optimizers.SPACES.items():
        assert not uses_gradient(name)
        study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=1))
        for _ in range(3):
            make(name, 7, 100, 0, **asked(study.ask())).close()


def test_tuning_counts_what_it_spends_repeats_itself_and_keeps_the_defaults_where_nothing_is_better(monkeypatch):
    pytest.importorskip("optuna")
    monkeypatch.setattr(tune_optimizers, "REFERENCE_BUDGET", 500)  # of the best cost nothing but a scale is made
    entry = tune_optimizers.tune("pso", trials=6, budget=240, heads=2)
    assert entry["evaluations"] == (6 + 6) * 2 * tune_optimizers.REPEATS * 240
    assert entry["quality"] <= entry["quality_of_defaults"]
    again = tune_optimizers.training_problems(tune_optimizers.AGAIN, 2)
    assert tune_optimizers.quality("pso", entry["options"], again, tune_optimizers.AGAIN, 240) == entry["quality"]
    assert entry == tune_optimizers.tune("pso", trials=6, budget=240, heads=2)


def test_what_is_kept_is_of_optimizers_that_can_be_tuned():
    file = data_file(entrants.TUNED_FILE)
    kept = json.loads(file.read_text(encoding="utf-8"))["optimizers"]
    assert set(kept) <= set(tune_optimizers.SPACES)
    for name, entry in kept.items():
        make(name, 7, 100, 0, **entry["options"]).close()
        assert entry["quality"] <= entry["quality_of_defaults"]
        assert entry["evaluations"] == (
            tune_optimizers.TRIALS + tune_optimizers.FINALISTS + 1
        ) * tune_optimizers.HEADS * tune_optimizers.REPEATS * (tune_optimizers.BUDGET)


def test_the_scale_of_a_training_problem_is_that_of_the_comparison():
    nominal = suite()["nominal"]
    best_V, scale = tune_optimizers.best_and_scale_V(nominal)
    assert best_V == pytest.approx(best_known_cost("nominal"), abs=0.5)
    assert scale + best_V == pytest.approx(scale_V("nominal") + best_known_cost("nominal"))
    assert np.isfinite(scale)
