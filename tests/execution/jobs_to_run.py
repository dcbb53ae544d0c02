"""Functions that the tests have processes run."""

import os
import signal
import tempfile
import time
from pathlib import Path


def double(number):
    return 2 * number


def die_once(folder, number):
    """Kill the own process the first time that it is given 3."""
    mark = folder / str(number)
    begun = len(mark.read_text()) if mark.exists() else 0
    mark.write_text("x" * (begun + 1))
    if number == 3 and begun == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fail_or_sleep(number):
    if number == 0:
        time.sleep(0.5)
        raise ZeroDivisionError("of the job")
    time.sleep(60)


def sleep_in_temporary_folder(place, told):
    """Sleep in a folder below ``place`` that is deleted at the end; it holds the process's number."""
    with tempfile.TemporaryDirectory(dir=place) as folder:
        Path(folder, "pid").write_text(str(os.getpid()))
        Path(told).touch()
        time.sleep(60)


def threads():
    import numpy as np
    import threadpoolctl

    np.ones((2, 2)) @ np.ones((2, 2))
    return [pool["num_threads"] for pool in threadpoolctl.threadpool_info()]
