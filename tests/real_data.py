"""Measured public campaigns, kept outside the project; a test without them is skipped."""

from pathlib import Path

import pytest

from inkjet_env.recordings import read_campaign

REAL_DATA = Path(__file__).parents[2] / "shared" / "realdata"


def real_campaign(name):
    if not (REAL_DATA / name).is_dir():
        pytest.skip(f"the measured campaign {name} is not at {REAL_DATA / name}")
    return read_campaign(REAL_DATA / name)
