import pandas
import psutil
import pytest

from inkjet_env.experiments.benchmark.regret import best_known_cost
from inkjet_env.experiments.benchmark.studies import runner_overhead
from tests.processes import wait_until


def test_their_runner_does_the_job_here_and_its_results_are_counted(tmp_path):
    file = tmp_path / "theirs.csv"
    took_s = runner_overhead.seconds_of(
        runner_overhead.theirs(file, runner_overhead.Job(repeats=1, budget=100, workers=1))
    )
    assert took_s > 0
    rows = pandas.read_csv(file)
    assert runner_overhead.kept(file) == len(rows) == len(runner_overhead.METHODS) * len(runner_overhead.BENCHED)
    assert set(rows["optimizer_name"]) == set(runner_overhead.METHODS)
    for name in runner_overhead.BENCHED:
        assert rows["loss"][rows["name"] == name].min() > best_known_cost(name)


def test_what_has_no_result_is_not_counted(tmp_path):
    file = tmp_path / "theirs.csv"
    assert runner_overhead.kept(file) == 0
    file.write_text("loss,error\n,NameError\n-12.5,\n")
    assert runner_overhead.kept(file) == 1


def ended(pid):
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def test_a_command_is_killed_with_all_that_it_began(tmp_path):
    begun = tmp_path / "pid"
    runner_overhead.seconds_of(["bash", "-c", f"sleep 600 & echo $! > {begun}; wait"], 1.0)
    wait_until(lambda: ended(int(begun.read_text())), 30)  # each dies in its own time


def test_a_command_that_fails_is_told():
    with pytest.raises(RuntimeError, match="no such thing"):
        runner_overhead.seconds_of(["bash", "-c", "echo no such thing; exit 3"])
