"""The record from which an interrupted optimisation goes on: believed only where it can be checked."""

import json

import numpy as np
import pytest

from inkjet_env.experiments.benchmark import single_run
from inkjet_env.experiments.benchmark.single_run import Optimisation, RunningRecord, read_record, write_record
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.optimizers.loop import Run
from inkjet_env.storage import archive_bytes

PLAN = Optimisation(problem("nominal"), "pso", 80, 3)


@pytest.fixture
def evaluations():
    points = np.random.default_rng(0).uniform(-1, 1, (40, 7))
    return {"label": PLAN.label(), "points": points, "costs": PLAN.problem.evaluate(points)}


def stored(path, arrays):
    path.write_bytes(archive_bytes({**arrays, "label": np.array(json.dumps(arrays["label"]))}))
    return path


def test_a_record_is_read_as_it_was_written(tmp_path, evaluations):
    run = Run(evaluations["points"], evaluations["costs"], None, False, 0.0, 0.0)
    write_record(tmp_path / "r.npz", PLAN, run)
    plan, (points, costs) = read_record(tmp_path / "r.npz")
    assert plan == PLAN
    np.testing.assert_array_equal(points, run.points)
    np.testing.assert_array_equal(costs, run.costs)


class Killed(BaseException):
    """Stands for a signal that no process survives."""


@pytest.mark.parametrize("batches", [1, 3, 7])
def test_a_killed_run_ends_as_one_that_was_never_killed(tmp_path, monkeypatch, batches):
    monkeypatch.setattr(single_run, "RECORD_EVERY_S", 0.0)
    monkeypatch.setattr(single_run, "LARGEST_SHARE", 0.0)
    plan = Optimisation(problem("nominal"), "cma-es", 120, 3)
    record, seen = RunningRecord(tmp_path / "r.npz", plan), []

    def keep(run):
        record(run)
        seen.append(run.evaluations)
        if len(seen) == batches:
            raise Killed

    with pytest.raises(Killed):
        plan.carry_out(keep=keep)
    again, recorded = read_record(tmp_path / "r.npz")
    assert (again, len(recorded[1])) == (plan, seen[-1])
    ended, whole = again.carry_out(recorded), plan.carry_out()
    np.testing.assert_array_equal(ended.points, whole.points)
    np.testing.assert_array_equal(ended.costs, whole.costs)


def test_a_replay_never_shortens_the_record(tmp_path, monkeypatch, evaluations):
    monkeypatch.setattr(single_run, "RECORD_EVERY_S", 0.0)
    record = RunningRecord(tmp_path / "r.npz", PLAN, replayed=40)
    record(Run(evaluations["points"], evaluations["costs"], None, False, 0.0, 0.0))
    assert not (tmp_path / "r.npz").exists()


def test_a_record_that_cannot_be_written_is_told_of_once(tmp_path, monkeypatch, evaluations, capsys):
    monkeypatch.setattr(single_run, "RECORD_EVERY_S", 0.0)
    record = RunningRecord(tmp_path / "missing" / "r.npz", PLAN)
    for _ in range(2):
        record(Run(evaluations["points"], evaluations["costs"], None, False, 0.0, 0.0))
    assert capsys.readouterr().err.count("if this run is killed, it cannot be resumed") == 1


def changed(name, change):
    def damage(arrays):
        arrays[name] = change(arrays[name])

    return damage


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (changed("costs", lambda c: np.where(np.arange(40) == 3, np.nan, c)), "its costs are not"),
        (changed("costs", lambda c: c + 1), "evaluation 1 costs"),
        (changed("costs", lambda c: c - (np.arange(40) == 17)), "evaluation 18 costs"),
        (changed("costs", lambda c: c.astype(str)), "its costs are not"),
        (changed("points", lambda p: p + 0j), "its points are not"),
        (changed("points", lambda p: 2 * p), "do not fit"),
        (changed("label", lambda d: {**d, "budget": "x"}), "its budget is 'x'"),
        (changed("label", lambda d: {**d, "budget": 400.5}), r"its budget is 400\.5"),
        (changed("label", lambda d: {**d, "budget": -5}), "do not fit a budget of -5"),
        (changed("label", lambda d: {**d, "budget": 10**14}), "do not fit a budget"),
        (changed("label", lambda d: {**d, "seed": "x"}), "its seed is 'x'"),
        (changed("label", lambda d: {**d, "options": [1]}), r"its options is \[1\]"),
        (changed("label", lambda d: {**d, "optimizer": ["pso"]}), "its optimizer is"),
        (
            changed("label", lambda d: {**d, "settings": {**d["settings"], "initial_state": "zz"}}),
            "initial_state must be",
        ),
        (changed("label", lambda d: [d]), "its label is not of evaluations/1"),
    ],
)
def test_a_record_that_cannot_be_is_refused_by_name(tmp_path, evaluations, damage, said):
    damage(evaluations)
    with pytest.raises(ValueError, match=rf"r\.npz: is not a complete record .*{said}"):
        read_record(stored(tmp_path / "r.npz", evaluations))


def test_a_pickle_is_never_loaded(tmp_path):
    np.savez(tmp_path / "r.npz", label=np.array({"a": 1}, dtype=object))
    with pytest.raises(ValueError, match="pickled objects, which are never loaded"):
        read_record(tmp_path / "r.npz")


def test_another_kind_of_file_is_not_called_a_pickle(tmp_path):
    (tmp_path / "w.csv").write_text("time_s,drive_V\n0,0\n")
    with pytest.raises(ValueError, match=r"w\.csv: .*it is not an \.npz archive.* Give the \.npz file that"):
        read_record(tmp_path / "w.csv")
