import functools
import json
import os
import shutil
import signal
from pathlib import Path
from unittest.mock import Mock

import pytest

from inkjet_env.experiments.execution import cluster, local_processes
from inkjet_env.experiments.execution.jobs import ClusterError
from inkjet_env.experiments.proof import judge, protocol
from inkjet_env.experiments.proof.campaign_files import ProofError, digest
from tests.processes import wait_until, worker

SECONDS = 0.03


def answers(folder):
    return len(list((folder / "answers").glob("*.json"))) if (folder / "answers").exists() else 0


def done(process, seconds=120):
    out, err = process.communicate(timeout=seconds)
    assert process.returncode == 0, err
    return out, err


def test_a_killed_driver_loses_nothing_that_is_finished(start, driver, finished, tmp_path):
    folder = tmp_path / "killed"
    first = start(driver, folder, ANSWER_SECONDS=SECONDS)
    wait_until(lambda: answers(folder) >= 5)
    os.kill(first.pid, signal.SIGKILL)
    first.communicate()
    kept = {path: path.read_bytes() for path in (folder / "answers").glob("*.json")}
    assert 5 <= len(kept) < 60
    out, err = done(start(driver, folder))
    assert "answers are finished already; resuming." in err
    assert out == finished[1]
    assert all(path.read_bytes() == content for path, content in kept.items())


def test_a_killed_driver_leaves_no_process_behind(start, driver, tmp_path):
    folder, at_work = tmp_path / "killed", tmp_path / "at-work"
    at_work.mkdir()
    first = start(driver, folder, ANSWER_SECONDS=SECONDS, AT_WORK=at_work)
    wait_until(lambda: any(at_work.iterdir()))
    (worker,) = (int(path.name) for path in at_work.iterdir())
    os.kill(first.pid, signal.SIGKILL)
    first.communicate()
    wait_until(lambda: not Path(f"/proc/{worker}").exists(), 30)


def test_campaigns_that_were_taken_away_are_recorded_anew_and_must_be_the_same(start, driver, finished, tmp_path):
    folder = tmp_path / "carried"
    shutil.copytree(finished[0], folder)
    sealed = json.loads((folder / "manifest.json").read_text())["campaigns"]
    kept = {path: path.read_bytes() for path in (folder / "answers").glob("*.json")}
    shutil.rmtree(folder / "campaigns")
    shutil.rmtree(folder / "judged")
    out, _ = done(start(driver, folder))
    assert out == finished[1]
    assert {path.name: digest(path) for path in (folder / "campaigns").iterdir()} == sealed
    assert all(path.read_bytes() == content for path, content in kept.items())

    name = next(iter(sealed))
    case = folder / "sealed" / "cases" / f"{name}.json"
    case.write_text(json.dumps(json.loads(case.read_text()) | {"campaign": "0" * 64}))
    shutil.rmtree(folder / "campaigns" / name)
    again = start(driver, folder)
    _, err = again.communicate(timeout=120)
    assert again.returncode
    assert f"{name} differs from its earlier recording" in err
    assert not (folder / "campaigns" / name).exists()


def test_the_cases_of_a_killed_worker_run_again(start, driver, scheduler, finished, tmp_path):
    folder, at_work = tmp_path / "on-a-cluster", tmp_path / "at-work"
    at_work.mkdir()
    workers = [worker(start, scheduler, ANSWER_SECONDS=SECONDS, AT_WORK=at_work) for _ in range(2)]
    first = start(driver, folder, scheduler)
    wait_until(lambda: answers(folder) >= 5 and len(list(at_work.iterdir())) == 2)
    os.kill(workers[0].pid, signal.SIGKILL)
    assert answers(folder) < 60
    out, _ = done(first)
    assert out == finished[1]


class Finished:
    """A Dask client whose jobs have all ended by the time that anyone looks, and its `as_completed`."""

    status, loop = "running", None

    def __init__(self):
        self.futures = []

    def scheduler_info(self, n_workers):
        return {"workers": {"one": {"nthreads": 9}}}

    def submit(self, function, *arguments, key, pure):
        return Mock(status="finished", result=lambda: function(*arguments))

    def add(self, future):
        self.futures.append(future)

    def next_batch(self, block):
        ended, self.futures = self.futures, []
        return ended


@pytest.mark.parametrize("place", [0, 1, 2])
def test_what_other_jobs_returned_is_kept_before_an_exception_of_one_is_raised(place, monkeypatch):
    kept, client = {}, Finished()
    monkeypatch.setattr("distributed.as_completed", lambda loop: client)
    jobs = {f"{k}": functools.partial(tuple, [int(k != place)]) for k in range(3)}
    with pytest.raises(ZeroDivisionError):
        cluster.run_each(client, lambda k: 1 / k, jobs, kept.__setitem__)
    assert kept == {f"{k}": 1.0 for k in range(3) if k != place}


def test_a_scheduler_that_is_not_there_is_told_in_one_sentence(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with (
        pytest.raises(ClusterError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"),
        cluster.workers_of("tcp://127.0.0.1:9", None),
    ):
        pass


def test_a_worker_of_other_code_does_nothing():
    for call in (
        lambda: protocol.conceal_case({}, "head-0", "fake_rig", "0" * 64),
        lambda: protocol.answer_case("head-0", b"", "", "0" * 64),
        lambda: judge.judge_case({}, {}, b"", {}, "fake_rig", "0" * 64),
    ):
        with pytest.raises(ProofError, match="code"):
            call()


def test_a_case_that_kills_every_worker_is_told(fakes, monkeypatch):
    import fake_steps

    monkeypatch.setattr(local_processes, "TRIES", 2)
    jobs = {"case": lambda: ("case",)}
    with (
        cluster.workers_of(None, 1) as client,
        pytest.raises(ClusterError, match="case was started 2 times and never ended"),
    ):
        cluster.run_each(client, fake_steps.deadly, jobs, print)
