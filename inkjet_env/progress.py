"""Progress on standard error: a bar on a terminal if rich is installed, an occasional plain line elsewhere.

Work that is counted shows how long it will still take at its average speed so far; other work shows how long it has
taken, at first every `PLAIN_LINE_EVERY_S` and ever more rarely.
"""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Protocol

from inkjet_env.interruption import never_swallowed

PLAIN_LINE_EVERY_S = 10.0
"""Shortest time between two plain progress lines, in seconds."""


STEADY_S = 3600.0
"""Time over which a bar averages the speed of the work, in seconds, so that the remaining time does not jump."""
SURE_AFTER_S = 2.0
"""Time after which the speed of the work is known well enough to tell the remaining time, in seconds."""
COUNTED = re.compile(r"(\d+) of (\d+)\)$")
"""How the name of a step ends that says how many of its parts have begun."""


def _drawn() -> bool:
    """Whether progress is drawn in place rather than printed line by line."""
    capable = os.environ.get("TERM", "").lower() not in ("dumb", "unknown")
    return capable and sys.stderr.isatty() and find_spec("rich") is not None


def duration_text(seconds: float) -> str:
    """A time in words, as coarse as an estimate of it is.

    Examples
    --------
    >>> duration_text(3.2), duration_text(48), duration_text(200), duration_text(9000)
    ('5 s', '50 s', '3 min', '2.5 h')
    """
    if seconds < 90:
        return f"{max(5, 5 * round(seconds / 5))} s"
    return f"{int(seconds / 60 + 0.5)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class Pace:
    """How long counted work will still take, at its average speed since it began.

    Parameters
    ----------
    total : int
        Number of parts.
    done : int
        Parts that were finished before it began.
    """

    def __init__(self, total: int, done: int = 0) -> None:
        self.total, self.before, self.began_s = total, done, time.monotonic()

    def left(self, done: int) -> str:
        """``, about … left`` after ``done`` parts; empty as long as the speed is not known, or nothing is left."""
        taken_s, made = time.monotonic() - self.began_s, done - self.before
        if made <= 0 or done >= self.total or taken_s < SURE_AFTER_S:
            return ""
        return f", about {duration_text(taken_s * (self.total - done) / made)} left"


class Progress(Protocol):
    """Callback that displays how much of the work is done."""

    def __call__(self, done: int, note: str = "") -> None:
        """Show that ``done`` items of the total are finished, with an optional ``note``."""


@contextmanager
def shown_progress(label: str, total: int, done: int = 0) -> Iterator[Progress]:
    """Show progress from ``done`` to ``total`` while the block runs; a Ctrl-C that a library swallows ends it too."""
    with never_swallowed() as check, _shown(label, total, done) as show:

        def progress(done: int, note: str = "") -> None:
            check()
            show(done, note)

        yield progress


@contextmanager
def _shown(label: str, total: int, done: int) -> Iterator[Progress]:
    if _drawn():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}", markup=False),
        )
        with Bar(*columns, console=Console(stderr=True), speed_estimate_period=STEADY_S) as bar:
            task = bar.add_task(label, total=total, completed=done, note="")
            yield lambda done, note="": bar.update(task, completed=done, note=note)
        return

    last_s = -float("inf")
    pace = Pace(total, done)

    def plain(done: int, note: str = "") -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if done >= total or now_s - last_s >= PLAIN_LINE_EVERY_S:
            last_s = now_s
            told = f"{label}: {done} of {total}{pace.left(done)}"
            print(told + (f"; {note}" if note else ""), file=sys.stderr, flush=True)

    yield plain


@contextmanager
def shown_steps(label: str, parts: int = 0) -> Iterator[Callable[[str], None]]:
    """Show the current step of work of unknown duration; without a terminal, an occasional plain line.

    Parameters
    ----------
    label : str
        What is done.
    parts : int
        Number of parts of all the work, if a count out of so many is one of all of it, not of a step.
    """
    with never_swallowed() as check, _shown_steps(label, parts) as show:

        def step(name: str) -> None:
            check()
            show(name)

        yield step


class _Step:
    """The step that is being carried out, in words, and how long it will still take if its parts are counted."""

    def __init__(self, label: str, parts: int = 0) -> None:
        self.label, self.name, self.parts, self.began_s = label, "", parts, time.monotonic()
        self._pace: Pace | None = None
        self._done = 0

    def begin(self, name: str) -> None:
        """Begin a step, or its next part."""
        name = str(name)
        found = COUNTED.search(name)
        if found is None:
            self._pace = None
        else:
            self._done, total = int(found[1]) - 1, int(found[2])
            if self._pace is None or self._pace.total != total or self._done < self._pace.before:
                self._pace = Pace(total, self._done)
        self.name = name

    def __str__(self) -> str:
        """The step as a line."""
        told = f"{self.label}: {self.name}" if self.name else self.label
        left = "" if self._pace is None else self._pace.left(self._done)
        of_all = self._pace is not None and self._pace.total == self.parts
        return told + (f"{left}{'' if of_all else ' of this step'}" if left else "")

    @property
    def taken_s(self) -> float:
        """How long all steps have taken, in seconds."""
        return time.monotonic() - self.began_s


@contextmanager
def _shown_steps(label: str, parts: int) -> Iterator[Callable[[str], None]]:
    step = _Step(label, parts)
    if _drawn():
        from rich.console import Console
        from rich.progress import Progress as Bar
        from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(label, total=None)

            def draw(name: str) -> None:
                step.begin(name)
                bar.update(task, description=str(step))

            yield draw
        return

    ended = threading.Event()

    def tell() -> None:
        while not ended.wait(max(PLAIN_LINE_EVERY_S, step.taken_s / 4)):  # a line for every quarter that is added
            print(f"{step}; {duration_text(step.taken_s)} so far", file=sys.stderr, flush=True)

    threading.Thread(target=tell, daemon=True).start()
    try:
        yield step.begin
    finally:
        ended.set()
