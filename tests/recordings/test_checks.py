"""What is suspicious is found, with its file and row; what is sound is left alone."""

import re
from pathlib import Path

import numpy as np
import pytest

from inkjet_env.printhead import Printhead, Waveform
from inkjet_env.recordings import Campaign, Recording, check_campaign, read_campaign, write_campaign

WAVEFORM = Waveform(90, -60, 2e-6, 10e-6, 4e-6, 8e-6, 2e-6)
RESPONSE = Printhead.published().respond(WAVEFORM)
TIME_S = np.arange(3000) * 1e-7
DRIVE_V = WAVEFORM.drive_V(TIME_S)
SENSOR_V = RESPONSE.sensor_V(TIME_S)


def recording(name="r001", **changed):
    fields = {"time_s": TIME_S, "drive_V": DRIVE_V, "sensor": SENSOR_V, "unit": "V", "channel": "self_sensing"}
    return Recording(name=name, **fields | changed)


def findings(*recordings, frequency_Hz=None):
    return check_campaign(Campaign("c", recordings), frequency_Hz)


def digitised(values, levels):
    step = 2 * np.max(np.abs(values)) / levels
    return np.round(values / step) * step


def test_a_sound_campaign_has_no_findings():
    noise = np.random.default_rng(3).normal(0, 1e-3, len(TIME_S))
    sound = (
        recording("clean"),
        recording("noisy", sensor=SENSOR_V + noise, repeat_of="clean", order=2),
        recording("eight_bit", sensor=digitised(SENSOR_V, 256), drive_monitor_V=digitised(DRIVE_V, 256)),
        recording("gauge", sensor=RESPONSE.hysteretic_V(TIME_S) * 1e-3, channel="strain_gauge", unit="um"),
        recording("silent", drive_V=0 * DRIVE_V, sensor=noise, excitation="zero"),
        recording("dead", drive_V=0 * DRIVE_V, sensor=0 * DRIVE_V, drive_monitor_V=0 * DRIVE_V),
    )
    assert findings(*sound, frequency_Hz=1e5) == []


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("levels", [None, 256])
@pytest.mark.parametrize("part", [0.95, 0.7])
def test_a_clipped_sensor_is_found_at_its_row(sign, levels, part):
    values = sign * SENSOR_V if levels is None else digitised(sign * SENSOR_V, levels)
    limit = part * np.max(values)
    (found,) = findings(recording(sensor=np.minimum(values, limit)))
    assert (found.level, found.recording, found.file) == ("warning", "r001", "r001.csv")
    assert "sensor_V stays at its maximum" in found.message
    assert np.minimum(values, limit)[found.row - 2] == limit


def test_one_finding_names_the_file_the_row_and_the_fix(tmp_path):
    lines = ["Model,MSO46", "TIME,drive,sensor"]
    lines += [f"{t:.9e},{d},{s}" for t, d, s in zip(TIME_S.tolist(), 2 * DRIVE_V, SENSOR_V, strict=True)]
    (tmp_path / "scope.csv").write_text("\n".join(lines))
    (found,) = check_campaign(read_campaign(tmp_path, channel="self_sensing"))
    row = int(np.argmax(np.abs(2 * DRIVE_V) > 100)) + 3
    assert found.row == row
    assert str(found).startswith(f"{tmp_path}/scope.csv, row {row}: drive_V should be within ±100 V; it goes to 180 V")
    assert float(lines[row - 1].split(",")[1]) > 100 >= float(lines[row - 2].split(",")[1])


@pytest.mark.parametrize(
    ("changed", "level", "message"),
    [
        ({"drive_V": DRIVE_V / 1000}, "warning", "at most 0.09 V, where tens of volts are usual"),
        ({"drive_V": DRIVE_V * 1000}, "error", r"within ±100 V; it goes to 90000 V"),
        ({"time_s": TIME_S * 1e6}, "error", "sample rate of 10 Hz is implausibly low.*microseconds"),
        ({"time_s": TIME_S * 1e3}, "warning", "sample rate of 1e\\+04 Hz is implausibly low.*milliseconds"),
        ({"time_s": TIME_S * 1e-6}, "error", "sample rate of 1e\\+13 Hz is implausibly high"),
        ({"time_s": TIME_S * 1e6, "channel": "displacement"}, "warning", "10 Hz is too low for a displacement to show"),
        ({"time_s": TIME_S * 1e9, "channel": "displacement"}, "error", "sample rate of 0.01 Hz is implausibly low"),
        ({"time_s": TIME_S * 20}, "warning", "5 samples a period of 1e\\+05 Hz"),
        ({"drive_monitor_V": DRIVE_V / 10}, "warning", "drive_monitor_V has 0.1 times the drive's range"),
        ({"drive_monitor_V": np.clip(DRIVE_V, -50, 100)}, "warning", "drive_monitor_V stays at its minimum, -50"),
        ({"excitation": "bipolr"}, "warning", "Did you mean 'bipolar'"),
    ],
)
def test_each_doubt_is_found(changed, level, message):
    (found,) = findings(recording(**changed), frequency_Hz=1e5)
    assert found.level == level
    assert re.search(message, found.message)


def test_a_slow_gauge_needs_no_fast_sampling():
    gauge = recording(time_s=TIME_S * 1e3, channel="strain_gauge", sensor=DRIVE_V)
    assert findings(gauge, frequency_Hz=1e5) == []


@pytest.mark.parametrize(
    "changed", [{"drive_V": DRIVE_V * 0.9}, {"channel": "displacement"}, {"time_s": TIME_S * 1.01}]
)
def test_a_repeat_with_another_drive_is_none(changed):
    (found,) = findings(recording(), recording("r002", repeat_of="r001", **changed))
    assert "repeats r001, but has another" in found.message
    assert found.row is None


def test_a_frequency_that_is_none_is_refused():
    with pytest.raises(ValueError, match="frequency_Hz must be a positive number"):
        findings(recording(), frequency_Hz=0.0)


def test_rows_are_those_of_the_written_file(tmp_path):
    campaign = Campaign("c", (recording(drive_V=2 * DRIVE_V),))
    write_campaign(tmp_path / "c", campaign)
    (before,), (after,) = check_campaign(campaign), check_campaign(read_campaign(tmp_path / "c"))
    assert (before.row, before.message) == (after.row, after.message)
    assert Path(after.file) == tmp_path / "c" / "r001.csv"
