"""Processes beside the tests: started, waited for, and those of a small Dask cluster."""

import json
import os
import subprocess
import sys
import time


def started(*command, **environment):
    """A Python process of its own group."""
    return subprocess.Popen(
        [sys.executable, *map(str, command)],
        env=os.environ | {name: str(value) for name, value in environment.items()},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_until(true, seconds=60):
    """Wait until something holds; what it is then."""
    end_s = time.monotonic() + seconds
    while not (found := true()):
        assert time.monotonic() < end_s, "it never came to that"
        time.sleep(0.02)
    return found


def written_json(file):
    """Content of a JSON file; None as long as it is not there or not whole, since another process is writing it."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None


def worker(start, scheduler, **environment):
    """A Dask worker of one thread."""
    return start(
        "-m", "distributed.cli.dask_worker", scheduler, "--nthreads", "1", "--no-nanny", "--no-dashboard", **environment
    )
