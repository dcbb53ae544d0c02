"""Jobs done by processes on this machine."""

import functools
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
