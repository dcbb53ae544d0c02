import functools
import os
import sys
from pathlib import Path

import pytest

from tests.processes import started

HERE = Path(__file__).parent
FAKES = HERE / "fakes"
PATH = os.pathsep.join((str(FAKES), str(HERE.parents[1])))
collect_ignore = ["fakes"]


@pytest.fixture(scope="session", autouse=True)
def fakes():
    """The fake rig and its steps, found by this process and by those it starts."""
    sys.path.insert(0, str(FAKES))
    yield
    sys.path.remove(str(FAKES))


@pytest.fixture
def start(start):
    """Start processes that find the fakes."""
    return functools.partial(start, PYTHONPATH=PATH)


@pytest.fixture(scope="session")
def driver():
    return FAKES / "drive.py"


@pytest.fixture(scope="session")
def finished(driver, tmp_path_factory):
    """A finished proof of the fake rig and its table."""
    folder = tmp_path_factory.mktemp("proof") / "finished"
    process = started(driver, folder, PYTHONPATH=PATH)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return folder, out, err
