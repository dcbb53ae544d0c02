"""Jobs done by processes on this machine."""

import functools
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from inkjet_env.experiments.execution.cluster import run_each, worker_count, workers_of

sys.path.append(str(Path(__file__).parent))  # the processes get the same path
import jobs_to_run


def jobs_of(*arguments):
    return {f"job {k}": functools.partial(tuple, given) for k, given in enumerate(arguments)}


@pytest.fixture(scope="module")
def workers():
    with workers_of(None, 2) as processes:
        yield processes


def test_every_result_is_kept_under_the_name_of_its_job(workers):
    kept = {}
    run_each(workers, jobs_to_run.double, jobs_of(*([k] for k in range(9))), kept.__setitem__)
    assert kept == {f"job {k}": 2 * k for k in range(9)}
    assert worker_count(workers) == 2


def test_only_the_job_of_a_killed_process_is_begun_again(workers, tmp_path):
    kept = {}
    run_each(workers, jobs_to_run.die_once, jobs_of(*([tmp_path, k] for k in range(6))), kept.__setitem__)
    assert sorted(kept.values()) == list(range(6))
    assert {file.name: len(file.read_text()) for file in tmp_path.iterdir()} == {str(k): 1 + (k == 3) for k in range(6)}


def test_an_exception_of_a_job_ends_the_others_at_once_and_the_workers_go_on(workers):
    began_s = time.monotonic()
    with pytest.raises(ZeroDivisionError, match="of the job"):
        run_each(workers, jobs_to_run.fail_or_sleep, jobs_of([0], [1]), print)
    assert time.monotonic() - began_s < 30
    test_every_result_is_kept_under_the_name_of_its_job(workers)


def test_linear_algebra_has_one_thread(workers):
    kept = {}
    run_each(workers, jobs_to_run.threads, jobs_of([]), kept.__setitem__)
    assert set(kept["job 0"]) <= {1}


PARENT = """
import functools, sys
sys.path.append(sys.argv[1])
import jobs_to_run
from inkjet_env.interruption import treat_alike
from inkjet_env.experiments.execution.cluster import run_each, workers_of
if __name__ == "__main__":
    treat_alike()
    with workers_of(None, 1) as processes:
        jobs = {"job": functools.partial(tuple, sys.argv[2:])}
        run_each(processes, jobs_to_run.sleep_in_temporary_folder, jobs, print)
"""


@pytest.mark.parametrize("ended_by", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_a_job_cleans_up_however_its_parent_ends(tmp_path, ended_by):
    script, place, told = tmp_path / "parent.py", tmp_path / "place", tmp_path / "told"
    script.write_text(PARENT)
    place.mkdir()
    arguments = [sys.executable, script, Path(__file__).parent, place, told]
    parent = subprocess.Popen(
        arguments,
        stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job ignores it
    )
    wait_until(told.exists)
    pid = int(next(place.glob("*/pid")).read_text())
    parent.send_signal(getattr(signal, ended_by))
    parent.wait(timeout=30)
    wait_until(lambda: not list(place.iterdir()))
    wait_until(lambda: not Path(f"/proc/{pid}").exists())


def wait_until(true, seconds=30):
    end_s = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end_s, "it never happened"
        time.sleep(0.05)
