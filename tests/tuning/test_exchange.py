"""Recordings that are asked for: through the folders, or by a rig."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.tuning.exchange import Exchange, WaitingError
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, CampaignError, writing
from inkjet_env.rig import Request, VirtualRig

HEAD = Printhead.published()
STEP_S = 2e-7
DRIVE_V = np.interp(np.arange(600), [0, 20, 35, 70, 85], [0, 0, 60, 60, 0])
PULSE = Request("request-1", "self_sensing", "periodic", STEP_S, DRIVE_V, purpose="to tell two effects apart")
MONITORED = replace(PULSE, name="request-2", drive_monitor=True)
RIG = VirtualRig(HEAD, 1)


def quietly(_):
    pass


def answer(folder, request, recording, **columns):
    """An answer as a logger writes it."""
    columns = {"time (s)": recording.time_s, "drive (V)": recording.drive_V, "sensor (V)": recording.sensor, **columns}
    rows = np.column_stack([*columns.values()])
    np.savetxt(folder / "answers" / f"{request.name}.csv", rows, "%.10g", ",", header=",".join(columns), comments="")


def test_a_rig_is_asked_at_once_and_never_twice(tmp_path):
    class Counting(VirtualRig):
        asked = 0

        def record(self, request, order):
            self.asked += 1
            return super().record(request, order)

    rig = Counting(HEAD, 1)
    taken = Exchange(tmp_path, rig).obtain([PULSE, MONITORED], 39, quietly)
    assert [(r.name, r.order) for r in taken] == [("request-1", 39), ("request-2", 40)]
    again = Exchange(tmp_path, rig).obtain([PULSE, MONITORED], 39, quietly)
    assert rig.asked == 2
    np.testing.assert_array_equal(again[1].sensor, taken[1].sensor)
    np.testing.assert_array_equal(again[1].drive_monitor_V, taken[1].drive_monitor_V)


def test_what_was_taken_is_written_once_and_a_kill_between_two_files_loses_nothing(tmp_path, monkeypatch):
    again = replace(PULSE, name="request-1-2", repeat_of="request-1")
    asked, rig = [PULSE, again, MONITORED], VirtualRig(HEAD, 1)
    Exchange(tmp_path / "whole", rig).obtain(asked, 1, quietly)
    taken = Exchange(tmp_path / "whole").recorded
    assert [recording.repeat_of for recording in taken] == [None, "request-1", None]
    writing.write_campaign(tmp_path / "at-once", Campaign("recorded", taken))

    written, write = [], writing.write_atomically

    def counted(path, content):
        written.append(path.name)
        if written == ["request-1.csv", "datapackage.json", "request-1-2.csv", "datapackage.json"]:
            raise KeyboardInterrupt
        write(path, content)

    monkeypatch.setattr(writing, "write_atomically", counted)
    with pytest.raises(KeyboardInterrupt):
        Exchange(tmp_path / "killed", rig).obtain(asked, 1, quietly)
    assert [recording.name for recording in Exchange(tmp_path / "killed").recorded] == ["request-1"]
    Exchange(tmp_path / "killed", rig).obtain(asked, 1, quietly)
    assert written.count("request-1.csv") == 1
    files = [
        {file.name: file.read_bytes() for file in folder.iterdir()}
        for folder in (tmp_path / "at-once", tmp_path / "whole" / "recorded", tmp_path / "killed" / "recorded")
    ]
    assert len(files[0]) == 4
    assert files[0] == files[1] == files[2]


def test_without_a_rig_the_drives_are_written_and_their_answers_read(tmp_path):
    exchange = Exchange(tmp_path)
    with pytest.raises(WaitingError) as waiting:
        exchange.obtain([PULSE, MONITORED], 39, quietly)
    assert waiting.value.names == ("request-1", "request-2")
    rows = list(csv.DictReader((tmp_path / "requests" / "requests.csv").open()))
    assert [(row["name"], row["channel"], row["initial_state"], row["drive_monitor"]) for row in rows] == [
        ("request-1", "self_sensing", "periodic", "no"),
        ("request-2", "self_sensing", "periodic", "yes"),
    ]
    asked = np.loadtxt(tmp_path / "requests" / "request-1.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(asked[:, 1], DRIVE_V)
    first = RIG.record(PULSE, 39)
    answer(tmp_path, PULSE, first)
    with pytest.raises(WaitingError) as waiting:
        exchange.obtain([PULSE, MONITORED], 39, quietly)
    assert waiting.value.names == ("request-2",)
    assert [p.name for p in (tmp_path / "requests").iterdir() if p.name != "requests.csv"] == ["request-2.csv"]
    second = RIG.record(MONITORED, 40)
    answer(tmp_path, MONITORED, second, **{"drive_monitor (V)": second.drive_monitor_V})
    taken = exchange.obtain([PULSE, MONITORED], 39, quietly)
    assert not (tmp_path / "requests").exists()
    assert [(r.name, r.order, r.initial_state, r.channel) for r in taken] == [
        ("request-1", 39, "periodic", "self_sensing"),
        ("request-2", 40, "periodic", "self_sensing"),
    ]
    np.testing.assert_allclose(taken[0].sensor, first.sensor, rtol=1e-8)
    np.testing.assert_allclose(taken[1].drive_monitor_V, second.drive_monitor_V, rtol=1e-8)


@pytest.mark.parametrize(
    ("request_", "change", "said"),
    [
        (PULSE, {"drive_V": np.roll(DRIVE_V, 40)}, "its drive differs from the one that was asked for by"),
        (MONITORED, {}, "the voltage at the head was asked for too"),
    ],
)
def test_an_answer_to_another_request_is_refused(tmp_path, request_, change, said):
    (tmp_path / "answers").mkdir()
    answer(tmp_path, request_, replace(RIG.record(request_, 1), **change))
    with pytest.raises(CampaignError, match=said):
        Exchange(tmp_path).obtain([request_], 1, quietly)
    assert Exchange(tmp_path).recorded == ()


def test_an_answer_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "answers").mkdir()
    (tmp_path / "answers" / "request-1.csv").write_text("time_s,drive_V,sensor_V\n0,0,x\n")
    with pytest.raises(CampaignError, match=r"answers/request-1\.csv"):
        Exchange(tmp_path).obtain([PULSE], 1, quietly)
