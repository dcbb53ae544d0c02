"""What enters the fit: repeats together, whole drives held out, units that agree."""

import re
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification.measurements import measurements
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.rig import record_campaign

CAMPAIGN = record_campaign(Printhead.published(), 0)


def recording(name, level_V=50.0, unit="V", channel="self_sensing", scale=1.0, **labels):
    drive_V = np.interp(np.arange(200), [20, 30, 60, 70], [0, level_V, level_V, 0])
    sensor = scale * drive_V + np.arange(200) % 2
    labels = {"initial_state": "demagnetised", **labels}
    return Recording(name, 1e-6 * np.arange(200), drive_V, sensor, unit, channel, **labels)


def test_repeats_are_one_measurement():
    gathered = measurements(CAMPAIGN)
    by_name = {name: m for m in gathered for name in m.names}
    assert set(by_name) == {r.name for r in CAMPAIGN.recordings}
    for first, group in CAMPAIGN.repeats().items():
        assert set(by_name[first].names) >= {r.name for r in group}
    for m in gathered:
        np.testing.assert_allclose(m.mean, np.mean([CAMPAIGN[name].sensor for name in m.names], axis=0))


def test_what_is_held_out_is_held_out_with_all_its_repeats():
    (group, *_) = CAMPAIGN.repeats().values()
    gathered = measurements(CAMPAIGN, [group[1].name])
    assert {name for m in gathered if m.fitted == 0 for name in m.names} == {r.name for r in group}


def test_of_every_channel_whole_drives_are_held_out_but_never_the_strongest():
    gathered = measurements(CAMPAIGN)
    for channel in ("strain_gauge", "self_sensing"):
        mine = [m for m in gathered if m.channel == channel and not m.still]
        assert {m.fitted for m in mine if m.fitted < m.drive_V.size} == {0}
        swings = [np.ptp(m.drive_V) for m in mine if m.fitted]
        assert max(swings) == max(np.ptp(m.drive_V) for m in mine)


def test_the_only_drive_with_the_voltage_at_the_head_is_fitted():
    usually = {name for m in measurements(CAMPAIGN) if m.fitted == 0 for name in m.names}
    first, second = [r for r in CAMPAIGN.recordings if r.channel == "self_sensing" and r.name in usually][:2]

    def held(*monitored):
        recordings = [
            replace(r, drive_monitor_V=r.drive_V) if r in monitored else r for r in CAMPAIGN.recordings
        ]  # fmt: skip
        gathered = measurements(replace(CAMPAIGN, recordings=tuple(recordings), sources={}))
        return {name for m in gathered if m.fitted == 0 for name in m.names}

    assert first.name not in held(first)  # what shows the amplifier alone must not be kept from the fit
    assert held(first) < usually
    assert held(first, second) == usually


def test_the_strongest_drive_is_kept_where_two_are_alike_and_both_would_be_held_out():
    levels = (10, 20, 100, 40, 50, 60, 100)
    recordings = [recording(f"r{i}", level) for i, level in enumerate(levels)]
    # Places 2 and 6 by strength: a short full-swing pulse, and a long one.
    short = np.interp(np.arange(200), [20, 21, 23, 24], [0, 100, 100, 0])
    recordings[2] = replace(recordings[2], drive_V=short)
    gathered = measurements(Campaign("c", tuple(recordings)))
    order = sorted(gathered, key=lambda m: np.std(m.drive_V))
    assert [np.ptp(order[i].drive_V) for i in (2, 6)] == [100, 100]
    assert any(m.fitted for m in gathered if np.ptp(m.drive_V) == 100)


def test_what_is_held_out_does_not_depend_on_the_order_of_the_recordings():
    turned = replace(CAMPAIGN, recordings=CAMPAIGN.recordings[::-1])
    held = [{name for m in measurements(c) if m.fitted == 0 for name in m.names} for c in (CAMPAIGN, turned)]
    assert held[0] == held[1] != set()


def test_free_recordings_of_one_drive_are_not_averaged():
    free = Campaign("c", tuple(recording(name, initial_state="free") for name in "ab"))
    assert [m.names for m in measurements(free)] == [("a",), ("b",)]


def test_the_end_of_the_longest_is_held_out_where_there_are_too_few_drives():
    (alone,) = measurements(Campaign("c", (recording("a"),)))
    assert alone.fitted == 150
    (periodic,) = measurements(Campaign("c", (recording("a", initial_state="periodic"),)))
    assert periodic.fitted == 200


def test_nanometres_and_micrometres_are_one_unit():
    mixed = Campaign(
        "c",
        (recording("a", 50, "um", "displacement"), recording("b", 60, "nm", "displacement", scale=1e3)),
    )
    um, nm = measurements(mixed)
    assert um.unit == nm.unit == "um"
    assert np.abs(nm.mean - 1.2 * um.mean).max() < 1.5
    assert np.corrcoef(um.mean, nm.mean)[0, 1] > 0.99


def test_volts_and_micrometres_in_one_channel_are_refused():
    mixed = Campaign("c", (recording("a", channel="displacement"), recording("b", 60, "um", "displacement")))
    with pytest.raises(ValueError, match="'b': channel displacement is in um here and in V elsewhere; a channel has"):
        measurements(mixed)


def test_an_unknown_held_out_recording_suggests_the_nearest():
    campaign = Campaign("lab", (recording("pulse-1"), recording("sweep", 60)))
    with pytest.raises(ValueError, match=re.escape("'pulse-2' is not in campaign 'lab'.") + ".*pulse-1"):
        measurements(campaign, ["pulse-2"])


def test_holding_out_everything_is_refused():
    with pytest.raises(ValueError, match="all recordings of campaign 'c' are held out"):
        measurements(Campaign("c", (recording("a"),)), ["a"])


def test_an_empty_choice_holds_nothing_out():
    assert all(m.fitted == m.drive_V.size for m in measurements(CAMPAIGN, []))
