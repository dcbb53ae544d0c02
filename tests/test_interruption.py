"""Signals: one interruption is heard once, wherever it falls."""

import signal
from contextlib import suppress

import pytest

from inkjet_env import interruption
from inkjet_env.progress import shown_progress, shown_steps


@pytest.fixture
def interrupt(monkeypatch):
    monkeypatch.setattr(interruption, "_handler", handler := interruption._Once())
    return lambda: handler(signal.SIGINT, None)


def interrupted_work(shown, interrupt, done):
    """Work in whose every step a library catches all exceptions."""
    with shown() as progress:
        for step in range(3):
            progress(step)
            done.append(step)
            with suppress(BaseException):
                interrupt()


@pytest.mark.parametrize("shown", [lambda: shown_progress("work", 3), lambda: shown_steps("work")])
def test_an_interruption_that_a_library_swallows_ends_the_work_at_the_next_step(interrupt, shown):
    done = []
    with pytest.raises(KeyboardInterrupt):
        interrupted_work(shown, interrupt, done)
    assert done == [0]
    with shown() as progress:  # it was answered: what is done afterwards is not cut off
        progress(2)


def test_a_second_interruption_at_once_does_not_cut_off_what_is_written(interrupt):
    with suppress(KeyboardInterrupt), shown_progress("work", 2) as progress:
        progress(1)
        interrupt()
    with shown_progress("writing", 2) as writing:
        interrupt()
        writing(2)
