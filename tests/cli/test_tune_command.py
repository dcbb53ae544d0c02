"""``inkjet tune``: what it says while it waits, what it refuses, and rigs of a user's own."""

import json

import numpy as np
import pytest

from inkjet_env.printhead import DriverLimits, Printhead
from inkjet_env.recordings.drive import read_drive
from tests.tuning.two_rounds import TRUE, put_in_place

RIG = """
from inkjet_env.printhead import DriverLimits, Printhead
from inkjet_env.rig import VirtualRig

class Bench(VirtualRig):
    def __init__(self):
        super().__init__(Printhead.published(), 1, limits=DriverLimits(-80, 80, 20, 20, 0.1))
"""


def test_a_printhead_as_rig_gives_a_waveform_a_table_and_json(inkjet, tmp_path, diagnoses):
    TRUE.to_json(tmp_path / "true.json")
    limits = "lowest_V=-80,highest_V=80,rise_V_per_us=20,fall_V_per_us=20,step_us=0.1"
    arguments = ["tune", "bench", "--rig", "true.json", "--budget", "60", "--limits", limits]
    status, out, _ = inkjet(*arguments, "--waveform", "w.ini", "--json", "t.json")
    assert status == 0
    assert "Diagnosis 2, of 40 recordings: A second mode." in out
    assert out.count("→") == 1
    found = json.loads((tmp_path / "t.json").read_text())
    assert found["format"] == "tune/1"
    assert f"costs {found['worst_V']:.3f} V at worst" in out
    drive = read_drive(tmp_path / "w.ini")
    assert DriverLimits.from_text(limits).excesses(drive.time_s, drive.drive_V) == []
    assert np.abs(drive.drive_V).max() == pytest.approx(max(map(abs, found["waveform"][:2])))
    assert (tmp_path / "bench-tuning" / "log.md").exists()
    assert "Report: bench-tuning/report.html" in out
    page = (tmp_path / "bench-tuning" / "report.html").read_text()
    assert f"<h1>Head ‘bench’: fire U1 = {found['waveform'][0]:.4g} V" in page
    assert page.endswith("</html>")


def test_without_a_rig_it_says_what_to_record_and_goes_on_later(inkjet, tmp_path):
    status, out, _ = inkjet("tune", "bench", "--json", "t.json", "--report", "page.html")
    assert status == 0
    assert "page.html shows the drives" in out
    assert "the session waits for 38 recordings" in (tmp_path / "page.html").read_text()
    assert not (tmp_path / "bench-tuning" / "report.html").exists()
    assert "38 drives to record, listed in requests.csv" in out
    assert "run the same command again" in out
    assert len(json.loads((tmp_path / "t.json").read_text())["waiting_for"]) == 38
    assert len(list((tmp_path / "bench-tuning" / "requests").glob("*.csv"))) == 39


def test_json_on_standard_output_is_nothing_but_json_while_it_waits(inkjet):
    status, out, err = inkjet("tune", "bench", "--json", "-")
    assert status == 0
    assert len(json.loads(out)["waiting_for"]) == 38
    assert "38 drives to record" in err


def test_a_rig_of_ones_own_states_its_limits(inkjet, tmp_path, diagnoses):
    (tmp_path / "my_bench.py").write_text(RIG)
    diagnoses.corrected = Printhead.published()
    status, _, err = inkjet("tune", "bench", "--rig", "my_bench:Bench", "--budget", "60", "--json", "t.json")
    assert status == 0, err
    found = json.loads((tmp_path / "t.json").read_text())
    assert max(map(abs, found["waveform"][:2])) <= 80
    session = json.loads((tmp_path / "bench-tuning" / "session.json").read_text())
    assert session["settings"]["limits"]["rise_V_per_us"] == 20


@pytest.fixture
def diagnoses(monkeypatch):
    return put_in_place(monkeypatch)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--rig", "none.json"], "none.json"),
        (["--rig", "json:JSONDecoder"], "a rig must have the methods record and limits"),
        (["--rig", "nowhere:Bench"], "--rig nowhere:Bench"),
        (["--risk", "cvr"], "Did you mean 'cvar'?"),
        (["--report", "page.txt"], "--report must end in .html"),
        (["--report", "none/page.html"], "must be a writable folder"),
        (["--waveform", "w.txt"], "--waveform must end in .csv or .ini"),
        (["--limits", "lowest_V=5"], "a waveform starts and ends at 0 V"),
    ],
)
def test_a_bad_tune_is_one_sentence_and_status_2(inkjet, tmp_path, arguments, said):
    status, out, err = inkjet("tune", "bench", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err
    assert list(tmp_path.iterdir()) == []
