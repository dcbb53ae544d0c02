"""A results folder is gone on with: after a kill, with more or fewer runs, and with no other settings."""

import os
import signal
import subprocess
import sys
import time

import pytest

from inkjet_env.experiments import cli
from inkjet_env.experiments.benchmark.runner import run_bench
from inkjet_env.experiments.benchmark.settings import BenchSettings
from tests.benchmark.small_bench import contents, small_settings
from tests.processes import wait_until, worker

COMMAND = [sys.executable, "-m", "inkjet_env.experiments.cli", "bench", "--workers", "1"]
SMALL = ["--problems", "nominal", "--optimizers", "cma-es,pso,random", "--repeats", "4", "--budget", "1500"]


def with_settings(folder):
    return contents(folder), (folder / "bench.json").read_bytes()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Results of the small bench in one piece."""
    folder = tmp_path_factory.mktemp("whole") / "results"
    with pytest.raises(SystemExit) as ended:
        cli.main(["bench", "--workers", "1", *SMALL, "--results", str(folder)])
    assert ended.value.code == 0
    return folder


def test_a_killed_bench_goes_on_and_ends_as_if_it_had_not_been_killed(inkjet, tmp_path, whole):
    killed = tmp_path / "killed"
    process = subprocess.Popen([*COMMAND, *SMALL, "--results", killed], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    while len(list(killed.glob("runs/*.parquet"))) < 2 and process.poll() is None:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    before = contents(killed)
    assert 2 <= len(before) < 12
    status, _, err = inkjet("bench", "--workers", "1", *SMALL, "--results", killed)
    assert status == 0, err
    assert "runs are finished already; resuming" in err
    after = contents(killed)
    assert after == contents(whole)
    assert len(after) == 12
    for name in ("ranking.csv", "ranking.json"):
        assert (killed / name).read_bytes() == (whole / name).read_bytes()


def test_the_runs_of_a_killed_worker_are_done_again(start, scheduler, tmp_path, whole):
    shared = tmp_path / "shared"
    workers = [worker(start, scheduler) for _ in range(2)]
    bench = start(*COMMAND[1:3], "bench", *SMALL, "--scheduler", scheduler, "--results", shared)
    wait_until(lambda: any(shared.glob("runs/*.parquet")))
    workers[0].kill()
    assert len(list(shared.glob("runs/*.parquet"))) < 12
    _, err = bench.communicate(timeout=120)
    assert bench.returncode == 0, err
    assert contents(shared) == contents(whole)
    assert len(contents(whole)) == 12


def test_a_finished_bench_is_not_run_again(finished, monkeypatch):
    monkeypatch.setattr("inkjet_env.experiments.benchmark.runner._perform_all", lambda *_: pytest.fail("ran again"))
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
    monkeypatch.setattr("inkjet_env.experiments.benchmark.runner._perform_all", lambda *_: pytest.fail("ran again"))
    capsys.readouterr()
    narrowed = run_bench(small_settings(optimizers=("random",)), grown)
    assert f"not in the report: 10 runs in {grown}." in capsys.readouterr().err
    assert [run.key.file_stem for run in narrowed.results] == [f"nominal--random--{k:03d}" for k in range(2)]
    run_bench(wider, grown)
    assert with_settings(grown) == with_settings(new)


def test_a_foreign_folder_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ValueError, match="neither empty nor a bench's results folder"):
        run_bench(small_settings(), tmp_path)
    assert [f.name for f in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_run_that_is_a_link_is_refused_and_nothing_is_written_where_it_leads(tmp_path):
    folder, elsewhere = tmp_path / "results", tmp_path / "elsewhere.parquet"
    (folder / "runs").mkdir(parents=True)
    (folder / "runs" / "nominal--pso--000.parquet").symlink_to(elsewhere)
    with pytest.raises(ValueError, match=r"pso--000\.parquet: is a link"):
        run_bench(small_settings(), folder)
    assert not elsewhere.exists()


@pytest.mark.parametrize("written", ['{"problems": ["nominal"]}', '{"shorter": 3, "optimizers": ["pso"]}', "[]"])
def test_damaged_settings_of_a_bench_are_named(tmp_path, written):
    (tmp_path / "bench.json").write_text(written)
    with pytest.raises(ValueError, match=r"bench\.json is damaged"):
        run_bench(small_settings(), tmp_path)
    assert (tmp_path / "bench.json").read_text() == written
