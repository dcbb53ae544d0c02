"""Progress on standard error: a bar on a terminal if rich is installed, an occasional plain line elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Protocol

from inkjet_env.interruption import never_swallowed

PLAIN_LINE_EVERY_S = 10.0
"""Shortest time between two plain progress lines, in seconds."""


def _drawn() -> bool:
    """Whether progress is drawn in place rather than printed line by line."""
    return sys.stderr.isatty() and find_spec("rich") is not None


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
        with Bar(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task(label, total=total, completed=done, note="")
            yield lambda done, note="": bar.update(task, completed=done, note=note)
        return

    last_s = -float("inf")

    def plain(done: int, note: str = "") -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if done >= total or now_s - last_s >= PLAIN_LINE_EVERY_S:
            last_s = now_s
            print(f"{label}: {done} of {total}" + (f"; {note}" if note else ""), file=sys.stderr, flush=True)

    yield plain


@contextmanager
def shown_steps(label: str) -> Iterator[Callable[[str], None]]:
    """Show the current step of work of unknown duration; without a terminal, an occasional plain line."""
    with never_swallowed() as check, _shown_steps(label) as show:

        def step(name: str) -> None:
            check()
            show(name)

        yield step


@contextmanager
def _shown_steps(label: str) -> Iterator[Callable[[str], None]]:
    if _drawn():
        from rich.console import Console
        from rich.text import Text

        with Console(stderr=True).status(Text(label)) as status:
            yield lambda step: status.update(Text(f"{label}: {step}"))
        return

    last_s = time.monotonic()

    def plain(step: str) -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if now_s - last_s >= PLAIN_LINE_EVERY_S:
            last_s = now_s
            print(f"{label}: {step}", file=sys.stderr, flush=True)

    yield plain
