import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.benchmark import runner
from experiments.benchmark.analysis import Comparison
from experiments.benchmark.conclusions import ranking_sentences
from experiments.benchmark.page import page_data
from experiments.benchmark.problem import Problem
from experiments.benchmark.report import ranking_csv, ranking_json, write_report
from experiments.benchmark.run_files import (
    LABELLED,
    DamagedResultError,
    RunKey,
    RunResult,
    label_of,
    read_run,
    run_path,
    runs_table,
)
from experiments.benchmark.runner import perform, perform_some, run_bench
from experiments.benchmark.settings import LONGEST, BenchOutcome, BenchSettings
from experiments.benchmark.suite import problem
from experiments.execution.provenance import first_difference
from optimizers.base import Optimizer
from tests.processes import wait_until, worker

COMMAND = [sys.executable, "-m", "experiments.cli", "bench", "--workers", "1"]
SMALL = ["--problems", "nominal,stiff-head", "--optimizers", "cma-es,pso,random", "--repeats", "4", "--budget", "1500"]


def small_settings(**changes):
    return BenchSettings(
        **{"problems": ("nominal",), "optimizers": ("pso", "random"), "repeats": 2, "budget": 90} | changes
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A small bench, done."""
    folder = tmp_path_factory.mktemp("bench") / "results"
    outcome = run_bench(small_settings(), folder, workers=1)
    write_report(Comparison(outcome))
    return outcome


def contents(folder):
    return {file.name: file.read_bytes() for file in folder.glob("runs/*.parquet")}


def with_settings(folder):
    return contents(folder), (folder / "bench.json").read_bytes()


def test_a_killed_bench_goes_on_and_ends_as_if_it_had_not_been_killed(tmp_path):
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    process = subprocess.Popen([*COMMAND, *SMALL, "--results", killed], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    while len(list(killed.glob("runs/*.parquet"))) < 4 and process.poll() is None:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    before = contents(killed)
    assert 4 <= len(before) < 24
    for folder in (killed, whole):
        done = subprocess.run([*COMMAND, *SMALL, "--results", folder], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert ("runs are finished already; resuming" in done.stderr) == (folder == killed)
    after = contents(killed)
    assert after == contents(whole)
    assert len(after) == 24
    for name in ("ranking.csv", "ranking.json"):
        assert (killed / name).read_bytes() == (whole / name).read_bytes()


def test_the_runs_of_a_killed_worker_are_done_again(start, scheduler, tmp_path):
    shared, whole = tmp_path / "shared", tmp_path / "whole"
    workers = [worker(start, scheduler) for _ in range(2)]
    bench = start(*COMMAND[1:3], "bench", *SMALL, "--scheduler", scheduler, "--results", shared)
    wait_until(lambda: any(shared.glob("runs/*.parquet")))
    workers[0].kill()
    assert len(list(shared.glob("runs/*.parquet"))) < 24
    _, err = bench.communicate(timeout=120)
    assert bench.returncode == 0, err
    done = subprocess.run([*COMMAND, *SMALL, "--results", whole], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert contents(shared) == contents(whole)
    assert len(contents(whole)) == 24


def test_a_run_depends_on_nothing_but_its_names_budget_and_seed():
    key = RunKey("pso", "nominal", 1)

    def file(settings):
        return perform(key, settings)[1].to_bytes(label_of(key, settings.to_json()))

    alone = file(small_settings())
    assert file(small_settings(optimizers=("random", "pso"), repeats=7)) == alone
    assert file(small_settings(seed=1)) != alone


def test_whatever_of_ours_a_run_uses_is_in_the_code_that_it_is_labelled_with():
    script = """if True:
        import sys
        from pathlib import Path
        import experiments
        import optimizers
        from experiments.benchmark.run_files import RunKey
        from experiments.benchmark.runner import applies, perform
        from experiments.benchmark.settings import SOURCES, BenchSettings
        from experiments.benchmark.suite import families

        for problems in families().values():
            name = problems[0].name
            for optimizer in ("pso-tuned", "lbfgsb-multistart"):
                if applies(optimizer, name):
                    assert perform(RunKey(optimizer, name, 0), BenchSettings((name,), (optimizer,), 1, 60))[1]
        root = Path(experiments.__file__).resolve().parents[1]
        known = {file for pattern in SOURCES for file in root.glob(pattern)}
        files = [Path(module.__file__) for module in sys.modules.values() if getattr(module, "__file__", None)]
        ours = [file for file in files if root in file.parents and ".venv" not in file.parts]
        print(*[str(file.relative_to(root)) for file in ours if file not in known], sep="\\n")
    """
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    around = set(done.stdout.split())
    assert "experiments/benchmark/runner.py" in around
    assert {name for name in around if not name.startswith("experiments/")} == set()
    numbers = {"problem", "suite", "entrants"}
    assert not {f"experiments/benchmark/{name}.py" for name in numbers} & around


def test_an_optimizer_of_shorter_runs_is_compared_as_far_as_they_go(monkeypatch, tmp_path):
    monkeypatch.setitem(LONGEST, "random", 60)
    settings = small_settings()
    keys = [RunKey(optimizer, "nominal", repeat) for optimizer in settings.optimizers for repeat in range(2)]
    outcome = BenchOutcome(settings, tmp_path, [perform(key, settings)[1] for key in keys], {})
    assert [run.budget for run in outcome.results] == [90, 90, 60, 60]
    labels = [label_of(key, settings.to_json())["budget"] for key in keys]
    assert labels == [90, 90, 60, 60]
    compared = Comparison(outcome)
    assert compared.ranking.optimizers == ("pso",)
    assert "not in this ranking: random (60 evaluations)." in " ".join(ranking_sentences(compared))
    for budget, there in ((50, {"pso", "random"}), (90, {"pso"})):
        rows = compared.standings("all", budget).rows
        assert {row.optimizer for row in rows} == there
    drawn = page_data(compared)
    cut = {name: drawn["evaluations"][len(drawn["ecdf"]["all"][name]) - 1] for name in settings.optimizers}
    assert cut["pso"] == 90
    assert 50 <= cut["random"] <= 60
    with pytest.raises(ValueError, match="budget must be at most 60 for random alone; got 90"):
        small_settings(optimizers=("random",))


def test_a_worker_of_other_code_or_packages_does_nothing(monkeypatch):
    monkeypatch.setattr("experiments.benchmark.runner.perform", lambda *_: pytest.fail("ran"))
    told = small_settings().to_json()
    keys = [RunKey("pso", "nominal", 0)]
    with pytest.raises(ValueError, match="the code differs, here or at a worker"):
        perform_some(keys, small_settings(), "0" * 64, told["versions"])
    others = told["versions"] | {"numpy": "1.0"}
    with pytest.raises(ValueError, match=r"packages differ .* numpy is 1\.0 there and .* here\. Install the same"):
        perform_some(keys, small_settings(), told["code"], others)


def test_a_finished_bench_is_not_run_again(finished, monkeypatch):
    monkeypatch.setattr("experiments.benchmark.runner._perform_all", lambda *_: pytest.fail("ran again"))
    again = run_bench(small_settings(), finished.folder)
    assert [r.to_bytes({}) for r in again.results] == [r.to_bytes({}) for r in finished.results]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"budget": 91}, "budget is 90 there and 91 here"),
        ({"seed": 3}, "seed is 0 there and 3 here"),
        ({"budget": 91, "optimizers": ("sobol",)}, "budget is 90 there and 91 here"),
    ],
)
def test_other_settings_are_refused_and_change_nothing(finished, change, said):
    before = with_settings(finished.folder)
    with pytest.raises(ValueError, match=f"holds a bench with other settings: {said}"):
        run_bench(small_settings(**change), finished.folder)
    assert with_settings(finished.folder) == before


@pytest.mark.parametrize("changed", ["options", "problems", "versions", "shorter", "code"])
def test_what_decides_a_run_of_both_benches_must_agree(finished, changed, monkeypatch):
    before = with_settings(finished.folder)
    told = small_settings().to_json()
    other = {
        "options": {"pso": {"particles": 3}},
        "problems": {"nominal": told["problems"]["nominal"] | {"window_s": 1e-4}},
        "versions": told["versions"] | {"cma": "0"},
        "shorter": {"random": 60},
        "code": "0" * 64,
    }[changed]
    monkeypatch.setattr(BenchSettings, "to_json", lambda _: told | {changed: other})
    with pytest.raises(ValueError, match=f"holds a bench with other settings: {changed}"):
        run_bench(small_settings(), finished.folder)
    assert with_settings(finished.folder) == before


def test_a_bench_is_extended_and_narrowed_and_its_runs_are_those_of_a_new_one(tmp_path, monkeypatch, capsys):
    grown, new = tmp_path / "grown", tmp_path / "new"
    run_bench(small_settings(optimizers=("pso",)), grown, workers=1)
    first = {file.name: file.stat().st_mtime_ns for file in (grown / "runs").iterdir()}
    wider = small_settings(optimizers=("random", "pso"), problems=("nominal", "soft-head"), repeats=3)
    outcomes = [run_bench(wider, folder, workers=1) for folder in (grown, new)]
    assert len(outcomes[0].results) == 12
    assert with_settings(grown) == with_settings(new)
    assert all((grown / "runs" / name).stat().st_mtime_ns == at for name, at in first.items())
    monkeypatch.setattr("experiments.benchmark.runner._perform_all", lambda *_: pytest.fail("ran again"))
    capsys.readouterr()
    narrowed = run_bench(small_settings(optimizers=("random",)), grown)
    assert f"10 runs in {grown} were not requested" in capsys.readouterr().err
    assert [run.key.file_stem for run in narrowed.results] == [f"nominal--random--{k:03d}" for k in range(2)]
    run_bench(wider, grown)
    assert with_settings(grown) == with_settings(new)


def test_a_foreign_folder_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ValueError, match="neither empty nor a bench's results folder"):
        run_bench(small_settings(), tmp_path)
    assert [f.name for f in tmp_path.iterdir()] == ["thesis.txt"]


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


@pytest.mark.parametrize("written", ['{"problems": ["nominal"]}', '{"shorter": 3, "optimizers": ["pso"]}', "[]"])
def test_damaged_settings_of_a_bench_are_named(tmp_path, written):
    (tmp_path / "bench.json").write_text(written)
    with pytest.raises(ValueError, match=r"bench\.json is damaged"):
        run_bench(small_settings(), tmp_path)
    assert (tmp_path / "bench.json").read_text() == written


def test_a_folder_without_runs_has_no_table(tmp_path):
    with pytest.raises(ValueError, match="holds no runs"):
        runs_table(tmp_path)


def test_what_was_read_is_told_apart_from_what_it_costs(tmp_path):
    outcome = run_bench(small_settings(problems=("reading-200mV",), optimizers=("random",)), tmp_path, workers=1)
    for run in outcome.results:
        told_V, cost_V = (float(of(90)) for of in (run.lowest_told_V, run.kept_V))
        assert told_V == run.told_V.min()
        assert told_V != cost_V == pytest.approx(problem("reading-200mV").evaluate([run.best_point()])[0])
    rows = page_data(Comparison(outcome))["physical"]["reading-200mV"]["90"]
    assert rows[0]["told_V"] in [run.told_V.min() for run in outcome.results]


def test_an_optimiser_that_breaks_down_is_reported_and_not_scored(tmp_path, monkeypatch):
    import optimizers

    monkeypatch.setattr(
        optimizers, "availability", lambda names: {name: "too old" if name == "pso" else None for name in names}
    )
    outcome = run_bench(small_settings(), tmp_path / "r", workers=1)
    assert outcome.unavailable == {"pso": "too old"}
    assert {r.key.optimizer for r in outcome.results} == {"random"}
    page = write_report(Comparison(outcome))[0].read_text()
    assert "too old" in page


@pytest.fixture
def here(monkeypatch):
    """Have a bench do its runs in this process, one job after another."""

    def one_by_one(_, function, jobs, keep):
        for name, arguments in jobs.items():
            keep(name, function(*arguments()))

    monkeypatch.setattr("experiments.benchmark.runner.workers_of", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr("experiments.benchmark.runner.worker_count", lambda _: 1)
    monkeypatch.setattr("experiments.benchmark.runner.run_each", one_by_one)


class Broken(Optimizer):
    """Breaks down when it is told costs."""

    name = "broken"

    def propose(self):
        return np.zeros((1, self.dimension))

    def learn(self, points, costs, gradients):
        raise ZeroDivisionError("my own")


def failing(method):
    """A method of a problem that fails at points of a first coordinate above a half."""

    def fails(self, points):
        if np.max(np.atleast_2d(points)[:, 0]) > 0.5:
            raise ZeroDivisionError("of ours")
        return method(self, points)

    return fails


def test_an_exception_of_an_optimiser_leaves_it_out_and_goes_on(tmp_path, monkeypatch, here):
    entrant = SimpleNamespace(optimizer="random", options={}, made=lambda budget, seed: Broken(7, budget, seed))
    known = runner.entrant
    monkeypatch.setattr(runner, "entrant", lambda name: entrant if name == "random" else known(name))
    outcome = run_bench(small_settings(), tmp_path / "r")
    assert outcome.unavailable == {"random": "failed on nominal, repeat 0: ZeroDivisionError: my own"}
    assert {r.key.optimizer for r in outcome.results} == {"pso"}


OBJECTIVES = [("nominal", "pso"), ("lot-worst", "random"), ("nominal", "lbfgsb-multistart")]


@pytest.mark.parametrize(("problem", "optimizer"), OBJECTIVES)
def test_an_exception_of_the_objective_is_no_fault_of_the_optimiser(monkeypatch, problem, optimizer):
    key, settings = RunKey(optimizer, problem, 0), small_settings(problems=(problem,), optimizers=(optimizer,))
    assert perform(key, settings)[1] is not None
    for method in ("evaluate", "evaluate_with_gradient"):
        monkeypatch.setattr(Problem, method, failing(getattr(Problem, method)))
    told = f"objective of {problem} failed, in repeat 0 of {optimizer}, seed {key.seed(0)}: ZeroDivisionError: of ours"
    with pytest.raises(
        runner.ObjectiveFailedError, match=rf"{told} at evaluation \d+, point \[0\.[5-9]\d+, .*\]$"
    ) as caught:
        perform(key, settings)
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def test_a_cost_that_is_not_finite_is_no_fault_of_the_optimiser(monkeypatch):
    evaluate = Problem.evaluate
    monkeypatch.setattr(
        Problem, "evaluate", lambda of, points: np.where(points[:, 0] > 0.5, np.nan, evaluate(of, points))
    )
    told = r"nominal failed, in repeat 0 .*: costs must be finite; got nan at evaluation \d+, point \[0\.[5-9]"
    with pytest.raises(runner.ObjectiveFailedError, match=told):
        perform(RunKey("random", "nominal", 0), small_settings())


def test_a_reading_that_fails_is_named_by_the_evaluation_that_reads_it(monkeypatch):
    """Each evaluation of a run is read with an error of its own: a point without its number tells too little."""
    read = Problem.read

    def fails(self, points, seed, first=0):
        if first <= 50 < first + len(points):
            raise ZeroDivisionError("of ours")
        return read(self, points, seed, first)

    monkeypatch.setattr(Problem, "read", fails)
    with pytest.raises(runner.ObjectiveFailedError, match=r"of ours at evaluation 51, point \["):
        perform(RunKey("random", "reading-200mV", 0), small_settings(problems=("reading-200mV",)))


def test_runs_that_were_finished_before_the_objective_fails_are_kept(tmp_path, monkeypatch, here):
    whole, folder = tmp_path / "whole", tmp_path / "r"
    run_bench(small_settings(), whole)
    first = RunKey("pso", "nominal", 1).seed(0)
    known = Problem.as_measured

    def fails_in_one_run(self, seed, first_evaluation=0):
        if seed == first:
            raise ZeroDivisionError("of ours")
        return known(self, seed, first_evaluation)

    with monkeypatch.context() as patched:
        patched.setattr(Problem, "as_measured", fails_in_one_run)
        with pytest.raises(ZeroDivisionError, match="of ours") as caught:
            run_bench(small_settings(), folder)
    assert "At the worker:" in caught.value.__notes__[0]
    assert list(contents(folder)) == ["nominal--pso--000.parquet"]
    run_bench(small_settings(), folder)
    assert contents(folder) == contents(whole)


def test_an_optimiser_that_needs_gradients_is_left_out_where_there_are_none(tmp_path):
    """It ranks last there, and its place in the tables is empty."""
    settings = small_settings(problems=("nominal", "reading-200mV"), optimizers=("lbfgsb-multistart", "random"))
    outcome = run_bench(settings, tmp_path / "r", workers=1)
    assert [key for key in (r.key for r in outcome.results) if key.problem != "nominal"] == [
        RunKey("random", "reading-200mV", repeat) for repeat in range(2)
    ]
    compared = Comparison(outcome)
    assert set(compared.ranking.median_regrets_V) == {
        ("lbfgsb-multistart", "nominal"),
        ("random", "nominal"),
        ("random", "reading-200mV"),
    }
    page, ranking = write_report(compared)
    assert "–" in page.read_text()
    json.dumps(ranking, allow_nan=False)
    told, true = ([getattr(r, part)[-1] for r in outcome.results[-2:]] for part in ("told_V", "costs_V"))
    assert (np.array(told) != true).all()


def test_tables_for_machines_agree_with_each_other(finished):
    compared = Comparison(finished)
    lines = ranking_csv(compared).splitlines()
    found = ranking_json(compared)
    assert found["format"] == "ranking/1"
    assert len(lines) == 1 + 2 * 1
    best = dict(zip(lines[0].split(","), lines[1].split(","), strict=True))
    first = found["ranking"][0]
    assert best["optimizer"] == first["optimizer"] == compared.ranking.optimizers[0]
    assert float(best["median_regret_V"]) == first["problems"]["nominal"]["median_regret_V"]
    json.dumps(found, allow_nan=False)


def test_a_run_is_kept_by_its_improvements():
    points = np.linspace(-1, 1, 35).reshape(5, 7)
    run = RunResult.of(RunKey("pso", "nominal", 0), points, np.array([3.0, 4.0, 2.0, 2.0, 1.0]))
    assert run.evaluations.tolist() == [1, 3, 5]
    assert run.told_V.tolist() == [3.0, 2.0, 1.0]
    assert run.kept_V([1, 2, 3, 4, 5]).tolist() == [3.0, 3.0, 2.0, 2.0, 1.0]
    assert (run.best_point(4) == points[2]).all()
    assert (run.best_point() == points[4]).all()
    assert run.budget == 5


def test_first_difference_names_the_place():
    assert first_difference({"a": {"b": [1, 2]}}, {"a": {"b": [1, 3]}}) == "a b is 1, 2 there and 1, 3 here"
    assert first_difference({"a": 1}, {"a": 1, "c": 2}) == "c is new here"
    assert first_difference({"a": 1}, {"a": 1}) == ""
