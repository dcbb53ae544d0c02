"""Work on several processes."""

import signal
import subprocess
import sys

import pytest

from inkjet_env.mismatch.fitting.process_pool import ProcessPool


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_results_come_in_the_order_of_the_tasks(workers):
    offset = 100  # what the function refers to reaches the processes too

    def work(task):
        return sum(range(50_000 // (task + 1))) * 0 + offset + task  # the first task takes longest

    assert list(ProcessPool(workers).map(work, range(12))) == [100 + task for task in range(12)]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_a_task_comes_through_and_the_crew_works_on(workers):
    def work(task):
        if task == 2:
            raise FloatingPointError("the motion of task 2 grows without bound")
        return task

    pool = ProcessPool(workers)
    with pytest.raises(FloatingPointError, match="task 2"):
        list(pool.map(work, range(4)))
    assert list(pool.map(str, range(3))) == ["0", "1", "2"]


@pytest.mark.parametrize("workers", [1, 2])
def test_no_task_gives_no_result(workers):
    assert list(ProcessPool(workers).map(str, [])) == []


def test_work_that_is_given_up_leaves_the_crew_ready():
    pool = ProcessPool(2)
    results = pool.map(abs, range(6))
    assert next(results) == 0
    results.close()
    assert list(pool.map(abs, [-1, -2])) == [1, 2]


@pytest.mark.parametrize("workers", [0, -1])
def test_a_crew_of_nobody_is_refused(workers):
    with pytest.raises(ValueError, match=f"workers must be at least 1; got {workers}"):
        ProcessPool(workers)


@pytest.mark.parametrize("ended_by", [signal.SIGKILL, signal.SIGTERM])
def test_processes_end_with_their_parent(ended_by):
    script = (
        "import os, time\n"
        "from inkjet_env.mismatch.fitting.process_pool import ProcessPool\n"
        "def work(task):\n    os.write(1, b'begun\\n')\n    time.sleep(600)\n"
        "list(ProcessPool(2).map(work, range(2)))\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        begun = [parent.stdout.readline() for _ in range(2)]
        parent.send_signal(ended_by)
        parent.communicate(timeout=60)  # returns once no worker holds the output any more
    assert begun == ["begun\n", "begun\n"]
