"""Progress of an identification: it only grows, reaches its total, and changes nothing."""

import re

import numpy as np
import pytest

from inkjet_env.identification import identify
from inkjet_env.identification.work_done import PARTS, WorkDone
from inkjet_env.printhead import Printhead
from inkjet_env.rig import default_battery, record_campaign

LABELS = ("loop-1", "minor-loops", "trapezoid-60V", "bipolar-full", "multisine-50V-a", "zero")


def campaign(channels):
    battery = [line for line in default_battery() if line.label in LABELS and line.channel in channels]
    return record_campaign(Printhead.published(), 1, battery=battery, snr_dB=50.0)


def parts(told):
    found = [re.fullmatch(r".+ \((\d+) of (\d+)\)", name) for name in told]
    assert all(found), "every name ends in the part"
    assert {int(one[2]) for one in found} == {PARTS}
    return [int(one[1]) for one in found]


@pytest.mark.parametrize("channels", [("strain_gauge", "self_sensing"), ("self_sensing",), ("strain_gauge",)])
def test_what_is_done_only_grows_and_reaches_the_total(channels):
    told = []
    found = identify(campaign(channels), progress=told.append)
    seen = parts(told)
    assert np.all(np.diff(seen) >= 0)
    assert seen[0] == 1
    assert seen[-1] == PARTS
    silent = identify(campaign(channels))
    assert found.printhead == silent.printhead
    if "self_sensing" in channels:
        within_fits = {part for part, name in zip(seen, told, strict=True) if name.startswith("fitting all")}
        checking = {part for part, name in zip(seen, told, strict=True) if name.startswith("checking")}
        assert len(within_fits) > 15  # a long fit is not silent between its start and its end
        assert len(checking) > 15


def test_a_stage_never_takes_more_than_its_share():
    told = []
    work = WorkDone(told.append)
    work.begin("first", 0.5)
    for _ in range(1000):
        work.passed(0.5)
    assert work.done == pytest.approx(0.5)
    work.begin("second", 0.5)
    assert work.done == pytest.approx(0.5)
    work.passed(6.0)
    assert 0.6 < work.done < 0.75
    work.finish()
    assert work.done == 1.0
    assert np.all(np.diff(parts(told)) >= 0)
    assert told[-1] == "describing the head (100 of 100)"
