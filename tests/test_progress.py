"""Progress: never silent for long, with the time that is left where work is counted, and plain where it must be."""

import sys

import pytest

from inkjet_env import progress
from inkjet_env.progress import Pace, shown_progress, shown_steps


@pytest.fixture
def clock(monkeypatch):
    """A clock that only the test moves."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])

    def pass_s(seconds):
        now[0] += seconds

    return pass_s


def test_the_time_left_follows_from_the_average_speed_since_the_work_was_resumed(clock):
    pace = Pace(100, done=40)
    assert pace.left(40) == ""
    clock(1.0)
    assert pace.left(41) == ""  # too early to tell
    clock(29.0)
    assert pace.left(50) == ", about 3 min left"  # 50 parts at three seconds
    assert pace.left(100) == ""


def test_one_slow_part_does_not_make_the_time_left_jump(clock):
    pace = Pace(100)
    clock(60.0)
    before = pace.left(50)
    clock(6.0)  # five times as long as a part usually takes
    assert (before, pace.left(51)) == (", about 60 s left", ", about 65 s left")


def test_plain_lines_tell_what_is_done_and_what_is_left(clock, capsys):
    with shown_progress("bench", 10) as show:
        show(1)
        clock(20.0)
        show(5, "pso")
        clock(1.0)
        show(6)  # too soon after the last line
        show(10)
    assert capsys.readouterr().err.splitlines() == [
        "bench: 1 of 10", "bench: 5 of 10, about 20 s left; pso", "bench: 10 of 10",
    ]  # fmt: skip


def test_a_step_that_takes_long_is_told_again_and_again(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PLAIN_LINE_EVERY_S", 0.01)
    told = progress.threading.Event()
    real = print

    def printed(*texts, **options):
        real(*texts, **options)
        told.set()

    monkeypatch.setattr("builtins.print", printed)
    with shown_steps("identify camp") as step:
        step("fitting")
        told.clear()
        assert told.wait(10)
    assert "identify camp: fitting; 5 s so far" in capsys.readouterr().err.splitlines()


def test_parts_of_a_step_tell_when_it_will_be_done(clock):
    step = progress._Step("diagnose camp")
    step.begin("score test of creep (1 of 40)")
    clock(30.0)
    step.begin("score test of wave_echo (11 of 40)")
    assert str(step) == "diagnose camp: score test of wave_echo (11 of 40), about 2 min left of this step"
    step.begin("testing the residuals")
    assert str(step) == "diagnose camp: testing the residuals"


def test_parts_of_all_the_work_tell_when_all_will_be_done(clock):
    step = progress._Step("identify camp", 100)
    step.begin("looking for the resonance (1 of 100)")
    clock(30.0)
    step.begin("fitting all recordings, degree 8 (21 of 100)")
    assert str(step) == "identify camp: fitting all recordings, degree 8 (21 of 100), about 2 min left"
    step.begin("reading r002.csv (2 of 3)")
    clock(2.5)
    assert str(step).startswith("identify camp: reading r002.csv (2 of 3)")


@pytest.mark.parametrize(("terminal", "drawn"), [("xterm", True), ("dumb", False), ("unknown", False)])
def test_progress_is_drawn_only_where_a_terminal_can(monkeypatch, terminal, drawn):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", terminal)
    assert progress._drawn() is drawn


def test_progress_into_a_pipe_is_not_drawn(monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False)
    monkeypatch.setenv("TERM", "xterm")
    assert progress._drawn() is False
