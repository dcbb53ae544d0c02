"""Files of one folder from two instruments: each recording may have its own columns and channel."""

import numpy as np
import pytest

from inkjet_env.recordings import CampaignError, read_campaign, write_campaign
from inkjet_env.recordings.survey import survey_folder
from inkjet_env.recordings.wiring import Wiring

TIME_s = np.arange(40) * 1e-6
LARGE_V, SMALL_V = 50 * np.sin(TIME_s * 2e5), 2 * np.cos(TIME_s * 2e5)


def write(file, names, *columns):
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(TIME_s, *columns, strict=True)]
    file.write_text("\n".join([f"time_s,{names}", *rows]))


@pytest.fixture
def folder(tmp_path):
    """Two files wired alike, one the other way round, with names that tell nothing."""
    write(tmp_path / "a.csv", "CH1,CH2", LARGE_V, SMALL_V)
    write(tmp_path / "b.csv", "CH1,CH2", LARGE_V, SMALL_V)
    write(tmp_path / "c.csv", "CH1,CH2", SMALL_V, LARGE_V)
    return tmp_path


def drives_V(campaign):
    return {one.name: round(float(np.abs(one.drive_V).max())) for one in campaign.recordings}


def test_a_recording_has_its_own_columns_and_the_others_are_guessed(folder):
    with pytest.raises(CampaignError, match="which of them is the drive cannot be guessed"):
        read_campaign(folder, channel="self_sensing")
    found = read_campaign(folder, channel="self_sensing", columns_of={"c": {"drive": "CH2"}})
    assert drives_V(found) == {"a": 50, "b": 50, "c": 50}
    assert [dict(found.sources[name].roles) for name in "ac"] == [
        {"time": "time_s", "drive": "CH1", "sensor": "CH2"},
        {"time": "time_s", "drive": "CH2", "sensor": "CH1"},
    ]
    assert found.sources["a"].columns == ("time_s", "CH1", "CH2")


@pytest.mark.parametrize("columns", [{"drive": "CH1", "sensor": "CH2"}, {"drive": "2", "sensor": 3}])
def test_its_own_columns_come_before_those_of_all(folder, columns):
    told = {"c": {"drive": "CH2"}, "b": {"sensor": "2"}}
    found = read_campaign(folder, channel="self_sensing", columns=columns, columns_of=told)
    assert drives_V(found) == {"a": 50, "b": 2, "c": 50}


def test_a_recording_has_its_own_channel(folder):
    told = {"a": "strain_gauge", "b": "displacement"}
    found = read_campaign(
        folder, channel="self_sensing", channel_of=told, columns={"drive": "CH1"}, columns_of={"c": {"drive": "CH2"}}
    )
    assert [one.channel for one in found.recordings] == ["strain_gauge", "displacement", "self_sensing"]
    assert [note for note in found.notes if "guessed from the sensor" in note] == []


def test_a_data_package_is_read_with_columns_and_channel_of_its_recordings(folder, tmp_path):
    found = read_campaign(folder, channel="self_sensing", columns={"drive": "CH1", "sensor": "CH2"})
    write_campaign(tmp_path / "package", found)
    told = {"c": {"drive": "sensor_V", "sensor": "drive_V"}}
    again = read_campaign(tmp_path / "package", columns_of=told, channel_of={"b": "strain_gauge"})
    assert (drives_V(found)["c"], drives_V(again)["c"]) == (2, 50)
    assert [one.channel for one in again.recordings] == ["self_sensing", "strain_gauge", "self_sensing"]
    assert again.sources["a"].roles == {"time": "time_s", "drive": "drive_V", "sensor": "sensor_V"}


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        ({"columns_of": {"d": {"drive": "CH1"}}}, "has no recording 'd', of which columns"),
        ({"channel_of": {"d": "strain_gauge"}}, "has no recording 'd', of which columns"),
        ({"columns_of": {"c": {"drive": "CH9"}}}, r"c.csv: has no column 'CH9' for the drive; it has time_s, CH1"),
        ({"columns_of": {"c": "CH1"}}, "columns must map roles to columns"),
        ({"channel_of": {"c": "sound"}}, "channel must be one of"),
        ({"columns_of": {"c": {"drive": "CH1", "sensor": "CH1"}}}, "two roles"),
    ],
)
def test_what_cannot_be_told_is_refused(folder, told, sentence):
    with pytest.raises(CampaignError, match=sentence):
        read_campaign(folder, **({"channel": "self_sensing"} | told))


def test_headers_tell_what_can_be_corrected_where_reading_fails(folder):
    write(folder / "d.csv", "drive_V,strain_V,CH3,CH4", LARGE_V, SMALL_V, LARGE_V, SMALL_V)
    write(folder / "e.csv", "CH1,CH2,CH3", LARGE_V, SMALL_V, LARGE_V)
    found = {one.name: one for one in survey_folder(folder, Wiring(columns_of={"c": {"drive": "CH2"}}))}
    assert list(found) == ["a", "b", "c", "d", "e"]
    assert (found["a"].roles, found["a"].channel, found["a"].problem) == ({"time": "time_s"}, None, "")
    assert found["c"].roles == {"time": "time_s", "drive": "CH2"}
    assert found["d"].roles == {"time": "time_s", "drive": "drive_V", "sensor": "strain_V"}
    assert found["d"].channel == "strain_gauge"
    assert found["e"].columns == ("time_s", "CH1", "CH2", "CH3")
    assert "e.csv: the column of the drive and the sensor is unknown" in found["e"].problem
