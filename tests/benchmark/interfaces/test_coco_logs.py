"""Runs as logs of COCO, read back by cocopp."""

import csv

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.interfaces.coco_logs import write_coco_logs
from inkjet_env.experiments.benchmark.regret import best_known_cost
from inkjet_env.experiments.benchmark.run_files import RunKey, RunResult
from inkjet_env.experiments.benchmark.settings import BenchOutcome, BenchSettings
from inkjet_env.experiments.benchmark.suite import problem

RUNS, BUDGET = 3, 200
PROBLEMS, OPTIMIZERS = ("nominal", "reading-50mV"), ("pso", "random")


@pytest.fixture(scope="module")
def comparison(tmp_path_factory):
    rng, results = np.random.default_rng(0), []
    for name in PROBLEMS:
        for optimizer in OPTIMIZERS:
            for repeat in range(RUNS):
                points = rng.uniform(-1, 1, (BUDGET, 7))
                results.append(
                    RunResult.of(RunKey(optimizer, name, repeat), points, problem(name).read(points, repeat))
                )
    settings = BenchSettings(PROBLEMS, OPTIMIZERS, RUNS, BUDGET)
    return Comparison(BenchOutcome(settings, tmp_path_factory.mktemp("bench"), results, {}))


def test_cocopp_reads_the_regrets_that_the_comparison_has(comparison, cocopp, tmp_path):
    folders = write_coco_logs(comparison, tmp_path / "logs")
    assert [folder.name for folder in folders] == list(OPTIMIZERS)
    for optimizer, folder in zip(OPTIMIZERS, folders, strict=True):
        read = {data.funcId: data for data in cocopp.pproc.DataSetList([str(folder)])}
        assert sorted(read) == [1, 2]
        for number, name in enumerate(PROBLEMS, 1):
            data, runs = read[number], comparison.runs[optimizer, name]
            assert (data.dim, list(data.maxevals)) == (7, [BUDGET] * RUNS)
            lowest = [run.costs_V.min() - best_known_cost(name) for run in runs]
            np.testing.assert_allclose(data.finalfunvals, lowest, rtol=1e-9)
            targets = [10 ** (k / 5) for k in (7, 6, 5)]  # cocopp keeps five to a decade
            found = data.detEvals([target * (1 + 1e-9) for target in targets])
            np.testing.assert_array_equal(found, [[first_hit(run, name, target) for run in runs] for target in targets])


def first_hit(run, name, target_V):
    """Evaluations until a regret in volts is met, NaN if it never is."""
    met = np.flatnonzero(run.costs_V - best_known_cost(name) <= target_V)
    return run.evaluations[met[0]] if met.size else np.nan


def test_its_numbers_are_told_beside_it(comparison, tmp_path):
    write_coco_logs(comparison, tmp_path)
    rows = list(csv.DictReader((tmp_path / "functions.csv").open(encoding="utf-8")))
    assert rows == [{"function": "f1", "problem": "nominal"}, {"function": "f2", "problem": "reading-50mV"}]
    write_coco_logs(comparison, tmp_path)  # anew, in the same place


def test_logs_of_other_problems_are_not_mixed_with_these(comparison, tmp_path):
    (tmp_path / "functions.csv").write_text("function,problem\nf1,stiff-head\n")
    with pytest.raises(ValueError, match="holds something else than logs of these problems"):
        write_coco_logs(comparison, tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["functions.csv"]


def test_more_problems_than_coco_has_functions_are_refused(comparison, tmp_path, monkeypatch):
    monkeypatch.setattr(comparison, "problems", PROBLEMS * 13)
    with pytest.raises(ValueError, match="COCO has 24 functions; the bench has 26 problems"):
        write_coco_logs(comparison, tmp_path)
