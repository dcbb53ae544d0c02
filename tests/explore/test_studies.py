"""The studies of the page: what they find, on few changes and short recordings; never how long it takes."""

import json
import sys
from pathlib import Path

import pytest

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("panel", reason="panel is not installed")

from inkjet_env.experiments.explore.studies import sliders, speed, tasks  # noqa: E402
from inkjet_env.experiments.explore.studies.browser import find_browser  # noqa: E402

if not Path("/proc/self/status").exists():
    pytest.skip("the study asks Linux for the memory of a process", allow_module_level=True)
try:
    find_browser()
except ValueError as no_browser:
    pytest.skip(str(no_browser), allow_module_level=True)


def test_the_speed_is_measured_and_no_peak_is_lost(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sliders, "WARM", 1)
    file = tmp_path / "speed.json"
    small = ["--changes", "2", "--samples", "20000", "--recordings", "1", "--steps", "8", "--pages", "worst"]
    speed.main([*small, "--json", str(file)])
    found = json.loads(file.read_text())
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
    slider = found["sliders"]["worst"]
    assert slider["changes"] == 2
    assert found["python_ms"]["worst"]["median"] > 0
    assert 0 < slider["painted_ms"]["median"] <= slider["picture_ms"]["median"]
    assert slider["frames_a_change"] < 60  # one message for a change, not one for each of what has changed
    assert found["memory"]["late"]["drags"] == 2
    assert found["memory"]["late"]["server_MB"] > 50
    long = found["recordings"]
    assert long["spike_kept"]
    assert long["whole"]["measured"]["points"] < long["samples"]
    near = long["near"]["measured"]
    assert near["points"] == long["samples_in_near"] < long["whole"]["measured"]["points"]
    assert near["axis"][0] < near["axis"][1]


def test_tasks_can_be_done_on_the_page(tmp_path, capsys):
    file = tmp_path / "tasks.json"
    tasks.main(["--json", str(file), "--only", "2", "3"])  # the others are slow
    found = json.loads(file.read_text())["tasks"]
    assert len(found) == 2
    for task in found.values():
        assert task["fulfilled"], task
        assert task["clicks"] + task["fields"] <= 6
        assert task["keys"] <= 60
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


def test_what_is_missing_is_said_in_a_sentence(monkeypatch, capsys, tmp_path):
    for study in (speed, tasks):
        with pytest.raises(SystemExit) as exit_:
            study.main(["--browser", str(tmp_path / "none")])
        assert exit_.value.code == 2
        assert "there is no such browser. Give the path of a Chromium." in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "playwright", None)
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    with pytest.raises(SystemExit) as exit_:
        tasks.main([])
    assert exit_.value.code == 2
    assert "needs playwright, which is not installed: pip install 'inkjet-env[dev]'" in capsys.readouterr().err
