"""A command that runs in a process of its own, so that the page stays quick and its verdict is the command's."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence

TELL_EVERY_S = 1.0
"""Time between two reports of progress, in seconds."""
ASK_AGAIN_S = 5.0
"""Time in seconds after which a command that should end is asked again."""
LAST_WORDS_S = 5.0
"""Longest time in seconds that is waited for what an ended command wrote: a process of its own may hold the pipe."""
MODULE = "inkjet_env.experiments.cli"


class Job:
    """One run of ``inkjet``.

    Parameters
    ----------
    name : str
        Name of the command, such as diagnose.
    arguments : sequence of str
        Its arguments.
    told : callable
        Called from a thread while it runs, and once it has ended.
    """

    def __init__(self, name: str, arguments: Sequence[str], told: Callable[[], object]) -> None:
        self.name, self.told = name, told
        self.begin_s = time.monotonic()
        self.last_line = ""
        self.out, self.err = "", ""
        self.stopped = False
        self._asked_s = 0.0
        environment = os.environ | {"NO_COLOR": "1", "COLUMNS": "200"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", MODULE, name, *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, errors="replace", env=environment,
        )  # fmt: skip
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._read_out, self._read_err)]
        for reader in self._readers:
            reader.start()
        self._watcher = threading.Thread(target=self._watch, daemon=True, name=f"inkjet {name}")
        self.status: int | None = None
        self._watcher.start()

    @property
    def seconds(self) -> float:
        """Time since it was started, in seconds."""
        return time.monotonic() - self.begin_s

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.status is None

    def stop(self) -> None:
        """Ask it to end; what it keeps for a resumption, it keeps."""
        if self.process.poll() is None:
            self.stopped = True
            self._ask_to_end()

    def _ask_to_end(self) -> None:
        self._asked_s = time.monotonic()
        self.process.terminate()  # as Ctrl-C, which a process that was started in the background ignores

    def join(self, timeout_s: float | None = None) -> None:
        """Wait until it has ended and was told of."""
        self._watcher.join(timeout_s)

    def _read_out(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.out += line

    def _read_err(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.err += line
            self.last_line = line.strip() or self.last_line

    def _watch(self) -> None:
        while True:
            try:
                self.process.wait(TELL_EVERY_S)
                break
            except subprocess.TimeoutExpired:
                if self.stopped and time.monotonic() - self._asked_s > ASK_AGAIN_S:  # a library may have swallowed it
                    self._ask_to_end()
                self.told()
        for reader in self._readers:  # a process that it started may still hold what it wrote to
            reader.join(LAST_WORDS_S)
        self.status = self.process.returncode
        self.told()
