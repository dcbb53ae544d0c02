"""A results folder that one process at a time works in."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

if sys.platform != "win32":
    import fcntl


@contextmanager
def held(folder: Path, what: str) -> Iterator[None]:
    """Hold a folder, which is created if it is missing, while the block runs. The lock ends with the process.

    On Windows, which cannot lock a folder, nothing is held.

    Raises
    ------
    ValueError
        Another process holds it; nothing in it is changed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if sys.platform == "win32":
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"{folder}: another {what} is working in this folder. Wait until it has ended, or give another folder."
            ) from None
        yield
    finally:
        os.close(handle)
