"""Ctrl-C, a closed terminal and a request to end stop a command alike, and once: what it then writes is not cut off."""

from __future__ import annotations

import atexit
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
AGAIN_AFTER_S = 5.0
"""Seconds after an interruption within which further ones are ignored, so that finished work can be written."""


class _Once:
    """Handler of signals that raises `KeyboardInterrupt`, but not again while the first is being dealt with."""

    def __init__(self) -> None:
        self.stopped_s = -math.inf
        self.unanswered = False

    def __call__(self, number: int, frame: object) -> None:
        now_s = time.monotonic()
        if now_s - self.stopped_s > AGAIN_AFTER_S:
            self.stopped_s = now_s
            self.unanswered = True
            raise KeyboardInterrupt


_handler = _Once()


@contextmanager
def never_swallowed() -> Iterator[Callable[[], None]]:
    """A check to call between steps: it raises once more an interruption that a step swallowed, as a bare except does.

    One that leaves the block is answered, and is not raised again.
    """

    def check() -> None:
        if _handler.unanswered:
            raise KeyboardInterrupt

    try:
        yield check
    finally:
        _handler.unanswered = False


def treat_alike() -> None:
    """Let each of `SIGNALS` raise `KeyboardInterrupt`; one that is ignored, as under nohup, remains so.

    While Python ends, all are ignored: everything is written by then, and the exit status is the command's.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number in _numbers():
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, _handler)
    atexit.register(_ignore)


def _ignore() -> None:
    for number in _numbers():
        signal.signal(number, signal.SIG_IGN)


def _numbers() -> list[int]:
    return [getattr(signal, name) for name in SIGNALS if hasattr(signal, name)]
