"""Ctrl-C, a closed terminal and a request to end stop a command alike, and once: what it then writes is not cut off."""

from __future__ import annotations

import math
import signal
import threading
import time

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
AGAIN_AFTER_S = 5.0
"""Seconds after an interruption within which further ones are ignored, so that finished work can be written."""


class _Once:
    """Handler of signals that raises `KeyboardInterrupt`, but not again while the first is being dealt with."""

    def __init__(self) -> None:
        self.stopped_s = -math.inf

    def __call__(self, number: int, frame: object) -> None:
        now_s = time.monotonic()
        if now_s - self.stopped_s > AGAIN_AFTER_S:
            self.stopped_s = now_s
            raise KeyboardInterrupt


def treat_alike() -> None:
    """Let each of `SIGNALS` raise `KeyboardInterrupt`; one that is ignored, as under nohup, remains so."""
    if threading.current_thread() is not threading.main_thread():
        return
    handler = _Once()
    for number in (getattr(signal, name, None) for name in SIGNALS):
        if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, handler)
