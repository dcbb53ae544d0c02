"""Messages of the commands name options as a user types them, not the arguments of the functions behind them."""

import re

import pytest

from inkjet_env.cli.campaign_reading import notes_of
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, read_campaign, write_campaign
from inkjet_env.rig import record_campaign, strain_gauge_battery

WAVEFORM = ("--waveform", "100", "-100", "1e-6", "10e-6", "13e-6", "9e-6", "20e-6")
PYTHON = re.compile(r"\b[A-Za-z]+_(?:s|V|Hz|dB)\b|\b(?:initial|degree|measurement)_\w+|\b[a-z]+=(?!\w+,)")
WRONG = [
    (("simulate", *WAVEFORM, "--window", "0"), "--window must be a time above 0 s"),
    (("simulate", *WAVEFORM, "--effective", "foo"), "--effective must be"),
    (("simulate", *WAVEFORM, "--cost-a", "1e308"), "--cost-a must be a number"),
    (("simulate", *WAVEFORM, "--target-height", "-1"), "--target-height must be a magnitude"),
    (("simulate", *WAVEFORM, "--initial-state", "x"), "--initial-state must be one of"),
    (("simulate", *WAVEFORM, "--hysteresis", "x"), "--hysteresis must be one of"),
    (("optimize", "--problem", "nowhere"), "--problem must be one of"),
    (
        ("optimize", "--problem", "reading-50mV", "--drop-frequency", "15e3"),
        "--drop-frequency cannot be combined with --problem reading-50mV, which reads peaks with errors",
    ),
    (("optimize", "--problem", "lot-worst", "--drop-frequency", "15e3"), "is judged on a lot of heads"),
    (
        ("optimize", "--problem", "lot-worst", "--printhead", "effects.json"),
        "a --printhead with effects, such as effects.json, cannot be combined with --problem lot-worst",
    ),
    (("scan", "--points", "1"), "--points must be at least 3"),
    (("scan", "--vary", "t2"), "--vary must name two"),
    (("identify", "campaign", "--degree", "99"), "--degree must be 1 to 12"),
    (("identify", "campaign", "--degree-rule", "x"), "--degree-rule must be one of"),
    (("identify", "campaign", "--full-scale", "-1"), "--full-scale must be"),
    (("identify", "scope"), "the sensor is unknown. Give --channel, which is"),
    (("identify", "scope", "--channel", "strain_gauge", "--initial-state", "foo"), "--initial-state must be one of"),
    (("diagnose", "scope"), "Give --channel, which is"),
    (("record", "new", "--snr-db", "nan"), "--snr-db must be at least -40 dB"),
    (("tune", "new", "--rig", "effects.json", "--snr-db", "nan"), "--snr-db must be at least -40 dB"),
    (("bench", "--repeats", "0"), "--repeats must be at least 1"),
    (("bench", "--budget", "0"), "--budget must be at least 1"),
    (("bench", "--problems", ","), "--problems must name at least one"),
]


@pytest.fixture
def campaign():
    head = Printhead.published()
    return record_campaign(head, 1, battery=strain_gauge_battery()[:3])


@pytest.fixture
def files(tmp_path, campaign):
    head, mode = Printhead.published(), next(e for e in catalogue() if e.id == "second_mode")
    AugmentedPrinthead(head, ((mode, mode.example_values(head)),)).to_json(tmp_path / "effects.json")
    write_campaign(tmp_path / "campaign", campaign)
    scope(tmp_path / "scope", campaign)


def scope(folder, campaign):
    """The campaign as files of an oscilloscope with one wiring."""
    folder.mkdir()
    for recording in campaign.recordings:
        columns = zip(recording.time_s, recording.drive_V, recording.sensor, strict=True)
        rows = [",".join(repr(float(value)) for value in row) for row in columns]
        (folder / f"{recording.name}.csv").write_text("\n".join(["Time,CH1,CH2", "s,V,V", *rows, ""]))


@pytest.mark.parametrize(("arguments", "said"), WRONG, ids=[" ".join(a[-4:]) for a, _ in WRONG])
def test_a_refusal_names_the_option(inkjet, files, arguments, said):
    status, _, err = inkjet(*arguments)
    assert status == 2
    last = err.splitlines()[-1]
    assert said in last
    assert not PYTHON.search(last.partition("; got")[0])


def test_files_that_are_read_alike_are_told_in_one_note(inkjet, tmp_path, files, campaign):
    status, _, err = inkjet("evaluate", "scope", "--channel", "strain_gauge", "--initial-state", "periodic")
    notes = [line for line in err.splitlines() if "style" in line]
    assert status == 0
    assert len(campaign.recordings) > 1
    (note,) = notes
    assert note.startswith(
        f"{len(campaign.recordings)} files in scope alike, such as {campaign.recordings[0].name}.csv:"
    )
    assert "drive = CH1" in note


def test_a_file_with_another_wiring_has_a_note_of_its_own(tmp_path, files):
    odd = tmp_path / "scope" / "r002.csv"
    odd.write_text(odd.read_text().replace("Time,CH1,CH2", "Time,CH1,CH3"))
    read = read_campaign(tmp_path / "scope", channel="strain_gauge", initial_state="periodic")
    told = [note for note in notes_of(read) if "style" in note]
    assert len(told) == 2
    assert sum("sensor = CH3" in note and note.startswith(str(odd)) for note in told) == 1


def test_notes_that_name_no_file_stay_as_they_are(campaign):
    noted = Campaign("c", campaign.recordings, notes=("one: 1", "two: 2"))
    assert notes_of(noted) == ["one: 1", "two: 2"]
