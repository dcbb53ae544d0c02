"""Recordings on the page: what was read can be corrected, and verdicts are those of the commands."""

import json
import shlex
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.job import Job
from inkjet_env.experiments.explore.reading import GUESS, Reading
from inkjet_env.experiments.explore.recordings_state import DIAGNOSE, IDENTIFY
from inkjet_env.experiments.explore.recordings_table import REMARK, choices, rows
from inkjet_env.experiments.explore.traces import MOST_POINTS, decimated
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import read_campaign, write_campaign
from inkjet_env.rig import record_campaign

HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings") / "campaign"
    whole = record_campaign(Printhead.published(), seed=0)
    some = [
        replace(one, repeat_of=None) for one in (*whole.select("strain_gauge")[:4], *whole.select("self_sensing")[:8])
    ]
    write_campaign(folder, replace(whole, recordings=some))
    return folder


@pytest.fixture
def state(tmp_path):
    exploration = Exploration(tmp_path / "session.json")
    yield exploration.recordings
    exploration.recordings.close()


def scope_text(scale=1.0, drive_last=True):
    """A file of an oscilloscope whose columns' names tell nothing."""
    time_s = np.arange(2000) * 5e-8
    drive_V = 50 * np.sin(2 * np.pi * 3e4 * time_s)
    sensor_V = scale * 2 * np.cos(2 * np.pi * 3e4 * time_s)
    columns = (sensor_V, drive_V) if drive_last else (drive_V, sensor_V)
    lines = [f"{t:.9g},{a:.9g},{b:.9g}" for t, a, b in zip(time_s, *columns, strict=True)]
    return "\n".join(["time_s,CH1,CH2", *lines]).encode()


def test_a_campaign_is_read_simulated_and_judged(state, campaign):
    state.open(campaign)
    state.join()
    assert (state.trouble, state.busy) == ("", "")
    modelled = state.modelled["published"]
    assert modelled.sentence.startswith("Yes, this is still the same head")
    assert [row["recording"] for row in rows(state)] == [one.name for one in read_campaign(campaign).recordings]
    evaluation = modelled.evaluations[state.shown]
    assert float(rows(state)[0]["residual"]) == pytest.approx(modelled.evaluations["r001"].rms, rel=5e-3)
    assert evaluation.rms < 1.2 * modelled.noise_rms[state.shown]


def test_what_cannot_be_read_is_told_and_can_be_mended(state, tmp_path):
    state.open(tmp_path / "nowhere")
    state.join()
    assert "nowhere: must be a folder; there is none" in state.trouble
    with pytest.raises(ValueError, match="give the folder of a campaign, or drop its files"):
        state.open(type(tmp_path)("."))


def test_dropped_files_are_read_and_their_roles_can_be_corrected(state):
    state.drop({f"{HOSTILE}.csv": scope_text()})
    state.join()
    assert f"{HOSTILE}.csv" in state.trouble
    state.drop({"a.csv": scope_text(), "../b.csv": scope_text(2.0)})
    state.join()
    assert state.trouble != ""  # which channel it is, nothing says
    state.open(state.folder, Reading(channel="self_sensing"))
    state.join()
    assert state.trouble == ""
    assert state.campaign[state.shown].drive_V.max() == pytest.approx(50, rel=0.01)  # guessed by its range
    state.open(state.folder, Reading("drive=CH1,sensor=CH2", "self_sensing"))
    state.join()
    assert {round(one.drive_V.max()) for one in state.campaign.recordings} == {2, 4}
    assert sorted(path.name for path in state.folder.iterdir()) == ["a.csv", "b.csv"]


def test_a_correction_is_seen_by_the_commands_and_kept(tmp_path, campaign):
    exploration = Exploration(tmp_path / "session.json")
    state = exploration.recordings
    state.open(campaign)
    state.join()
    name = state.campaign.select("self_sensing")[0].name
    before = state.modelled["published"].evaluations[name].rms
    state.correct(name, "initial_state", "demagnetised")
    state.join()
    assert state.campaign[name].initial_state == "demagnetised"
    assert state.modelled["published"].evaluations[name].rms != before
    assert state.command_text(DIAGNOSE) == ""  # nothing is written yet
    state.write_corrected()
    _, told, folder, *options = shlex.split(state.command_text(DIAGNOSE))
    assert told == DIAGNOSE
    assert read_campaign(folder)[name].initial_state == "demagnetised"
    assert read_campaign(campaign)[name].initial_state != "demagnetised"  # the files themselves stay
    assert "--printhead-out" in options
    exploration.save()
    again = Exploration.restored(exploration.file).recordings
    again.join()
    assert again.campaign[name].initial_state == "demagnetised"
    assert again.as_json() == state.as_json()
    for what, value, sentence in (
        ("order", "1", "what is corrected must be one of"),
        ("drive", "CH9", "has no column 'CH9' for the drive; it has time_s, drive_V, sensor_V"),
        ("channel", "sound", "channel must be one of"),
    ):
        with pytest.raises(ValueError, match=sentence):
            state.correct(name, what, value)


def test_roles_are_corrected_file_by_file(state):
    state.drop({"a.csv": scope_text(), "b.csv": scope_text(drive_last=False), "c.csv": scope_text(2.0)})
    state.join()
    assert "cannot be guessed" in state.trouble  # the drive is CH2 in two files, CH1 in one
    assert [row["sensor"] for row in rows(state)] == ["", "", ""]
    assert choices(state)["drive"] == [GUESS, "time_s", "CH1", "CH2"]
    state.correct("b", "drive", "CH1")
    state.join()
    assert "the sensor is unknown" in state.trouble
    assert [row["drive"] for row in rows(state)] == ["", "CH1", ""]
    for name in "abc":
        state.correct(name, "channel", "self_sensing")
        state.join()
    assert state.trouble == ""
    assert [(row["drive"], row["sensor"]) for row in rows(state)] == [("CH2", "CH1"), ("CH1", "CH2"), ("CH2", "CH1")]
    assert {round(one.drive_V.max()) for one in state.campaign.recordings} == {50}
    assert all("corrected by you" in row[REMARK] for row in rows(state))
    state.correct("a", "sensor", "CH2")  # as which it was not guessed
    state.join()
    assert [row["drive"] for row in rows(state)] == ["CH1", "CH1", "CH2"]
    state.correct("a", "sensor", GUESS)
    state.join()
    assert [row["drive"] for row in rows(state)] == ["CH2", "CH1", "CH2"]
    assert state.corrections.as_json()["b"] == {"drive": "CH1", "channel": "self_sensing"}


def test_the_verdict_and_the_head_are_those_of_the_command(state, campaign, inkjet, tmp_path):
    state.open(campaign)
    state.join()
    state.start(IDENTIFY)
    with pytest.raises(ValueError, match="identify is under way"):
        state.start(DIAGNOSE)
    state.join()
    state.join()
    assert state.trouble == ""
    status, out, _ = inkjet("identify", campaign, "--out", tmp_path / "mine.json")
    assert status == 0
    assert state.verdicts[IDENTIFY] == out.splitlines()[0]
    assert state.shelf.heads["identified"].data == json.loads((tmp_path / "mine.json").read_text())
    assert state.model == "identified"
    assert state.modelled["identified"].evaluations


def test_a_command_that_refuses_is_told_in_its_sentence(state, campaign):
    state.open(campaign)
    state.join()
    state.reading = Reading(columns="time=nosuch")
    state.start(IDENTIFY)
    state.join()
    assert IDENTIFY not in state.verdicts
    assert "nosuch" in state.trouble or "columns" in state.trouble


def test_a_job_can_be_stopped(inkjet, tmp_path):
    assert inkjet("record", tmp_path / "campaign", "--hide", "second_mode")[0] == 0
    begun = threading.Event()
    heard = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in a process that was started in the background
    try:
        job = Job("diagnose", [str(tmp_path / "campaign"), "--json", str(tmp_path / "d.json")], begun.set)
    finally:
        signal.signal(signal.SIGINT, heard)
    assert job.running
    assert begun.wait(30)  # it has run for a second, and takes many more, in which it is asked again
    job.stop()
    job.join(60)
    assert not job.running
    assert job.stopped
    assert job.status not in (None, 0)


def test_a_peak_between_many_samples_is_drawn():
    signal = np.zeros(1_000_003)
    signal[777_777], signal[123_456] = 5.0, -3.0
    time_s, values = decimated(0.0, 1e-8, signal, 0.0, 0.01)
    assert values.size <= MOST_POINTS + 2
    assert (values.max(), values.min()) == (5.0, -3.0)
    assert time_s[int(values.argmax())] == pytest.approx(777_777e-8)
    assert (np.diff(time_s) > 0).all()
    near_s, near = decimated(0.0, 1e-8, signal, 777_700e-8, 777_800e-8)
    assert near.size == pytest.approx(102, abs=2)
    assert near_s[int(near.argmax())] == pytest.approx(777_777e-8)
