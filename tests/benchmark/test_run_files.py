"""The files of runs: what they hold, damage to them, and the table of them all."""

import shutil

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.run_files import (
    LABELLED,
    DamagedResultError,
    RunKey,
    RunResult,
    label_of,
    read_run,
    run_path,
    runs_table,
)
from inkjet_env.experiments.benchmark.runner import run_bench
from tests.benchmark.small_bench import small_settings


def damage_by_truncation(path, _):
    path.write_bytes(path.read_bytes()[:200])


def damage_by_another_run(path, folder):
    path.write_bytes(run_path(folder, RunKey("random", "nominal", 0)).read_bytes())


def a_run(folder):
    key, told = RunKey("pso", "nominal", 0), small_settings().to_json()
    return read_run(folder, key, label_of(key, told)), label_of(key, told)


def damage_by_pickle(path, _):
    with open(path, "wb") as file:
        np.savez(file, label=np.array({"a": 1}, dtype=object))


def damage_by_better_costs(path, folder):
    run, label = a_run(folder)
    run.costs_V[2] -= 100
    path.write_bytes(run.to_bytes(label))


def damage_by_rising_costs(path, folder):
    run, label = a_run(folder)
    run.told_V[1] = run.told_V[0]
    path.write_bytes(run.to_bytes(label))


def damage_by_other_code(path, folder):
    run, label = a_run(folder)
    path.write_bytes(run.to_bytes(label | {"code": "0" * 64}))


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (damage_by_truncation, "cannot be read"),
        (damage_by_another_run, "it is the file of another run: optimizer is random there and pso here"),
        (damage_by_pickle, "cannot be read"),
        (damage_by_better_costs, "costs .* V here, not the"),
        (damage_by_rising_costs, "the reported costs do not decrease"),
        (damage_by_other_code, "it is the file of another run: code is 0000"),
    ],
)
def test_a_damaged_result_is_named_and_what_to_do(finished, damage, said):
    path = run_path(finished.folder, RunKey("pso", "nominal", 0))
    whole = path.read_bytes()
    try:
        damage(path, finished.folder)
        with pytest.raises(DamagedResultError, match=f"{path.name} is damaged: .*{said}.*Delete that file"):
            run_bench(small_settings(), finished.folder)
    finally:
        path.write_bytes(whole)


def test_all_runs_are_read_as_one_table(finished):
    table = runs_table(finished.folder).to_pandas()
    for run in finished.results:
        key = run.key
        its = table[(table.optimizer == key.optimizer) & (table.problem == key.problem) & (table.repeat == key.repeat)]
        np.testing.assert_array_equal(its.cost_V, run.costs_V)
        np.testing.assert_array_equal(its.evaluation, run.evaluations)
        assert set(its.seed) == {key.seed(0)}
    assert len(table) == sum(len(run.evaluations) for run in finished.results)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"code": "0" * 64}, "code is"),
        ({"versions": {"numpy": "1.0"}}, "versions"),
        ({"options": {"particles": 3}}, "optimizer pso options"),
        ({"problem_sha256": "0" * 64}, "problem nominal problem_sha256"),
    ],
)
def test_runs_that_do_not_match_are_not_merged(finished, tmp_path, change, said):
    shutil.copytree(finished.folder / "runs", tmp_path / "runs")
    run, label = a_run(finished.folder)
    path = run_path(tmp_path, run.key)
    path.write_bytes(run.to_bytes(label | change))
    with pytest.raises(ValueError, match=f"{path.name} .*must not be merged: {said}"):
        runs_table(tmp_path)


def test_a_run_whose_label_lacks_something_is_named(finished, tmp_path):
    run, label = a_run(finished.folder)
    path = run_path(tmp_path, run.key)
    path.parent.mkdir()
    path.write_bytes(run.to_bytes({name: value for name, value in label.items() if name != "seed"}))
    with pytest.raises(DamagedResultError, match=f"{path.name} is damaged: its label lacks seed"):
        runs_table(tmp_path)


def test_labels_tell_what_a_table_of_all_runs_needs(finished):
    assert set(LABELLED) == set(a_run(finished.folder)[1])


def test_a_folder_without_runs_has_no_table(tmp_path):
    with pytest.raises(ValueError, match="holds no runs"):
        runs_table(tmp_path)


def test_a_run_is_kept_by_its_improvements():
    points = np.linspace(-1, 1, 35).reshape(5, 7)
    run = RunResult.of(RunKey("pso", "nominal", 0), points, np.array([3.0, 4.0, 2.0, 2.0, 1.0]))
    assert run.evaluations.tolist() == [1, 3, 5]
    assert run.told_V.tolist() == [3.0, 2.0, 1.0]
    assert run.kept_V([1, 2, 3, 4, 5]).tolist() == [3.0, 3.0, 2.0, 2.0, 1.0]
    assert (run.best_point(4) == points[2]).all()
    assert (run.best_point() == points[4]).all()
    assert run.budget == 5
