import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
FAKES = HERE / "fakes"
collect_ignore = ["fakes"]


@pytest.fixture(scope="session", autouse=True)
def fakes():
    """The fake rig and its steps, found by this process and by those it starts."""
    sys.path.insert(0, str(FAKES))
    yield
    sys.path.remove(str(FAKES))


def started(*command, **environment):
    """A process of its own group that finds the fakes."""
    path = os.pathsep.join((str(FAKES), str(HERE.parents[1])))
    return subprocess.Popen(
        [sys.executable, *map(str, command)],
        env=os.environ | {"PYTHONPATH": path} | {name: str(value) for name, value in environment.items()},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.fixture
def start():
    """Start processes that find the fakes; what is left of them ends with the test."""
    processes = []

    def begin(*command, **environment):
        processes.append(started(*command, **environment))
        return processes[-1]

    yield begin
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def driver():
    return FAKES / "drive.py"


@pytest.fixture(scope="session")
def finished(driver, tmp_path_factory):
    """A finished proof of the fake rig and its table."""
    folder = tmp_path_factory.mktemp("proof") / "finished"
    process = started(driver, folder)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return folder, out, err
