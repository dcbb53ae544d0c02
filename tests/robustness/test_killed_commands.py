"""Killed commands: what is compared, and that the comparison can fail."""

import json
import sys

import pytest

from inkjet_env.experiments.robustness import killed_commands
from inkjet_env.experiments.robustness.killed_commands import COMMANDS, Killed, contents, killed_after, tried

SMALL = Killed(
    ("optimize", "--budget", "40000", "--optimizer", "cma-es", "--out", "best.csv", "--json", "best.json"),
    ("best.csv", "best.json"),
    record="best.csv.evaluations.npz",
)


def test_an_optimisation_that_is_killed_ends_as_one_that_is_not(tmp_path):
    told = []
    assert tried(SMALL, 1, 13, tmp_path, 0.8, told.append) == []
    assert told[0].startswith("undisturbed")
    assert told[1].startswith("killed")


def test_a_run_that_writes_nothing_to_compare_is_told(tmp_path):
    silent = Killed(("--version",), ("other.csv",))
    assert tried(silent, 0, 0, tmp_path, tell=lambda _: None) == ["the undisturbed run wrote none of its outputs"]


def test_times_are_not_compared(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps({"value": [1, {"seconds": 2.0}], "cpu_seconds": 3.0}), "utf-8")
    assert contents(tmp_path, ["*.json"]) == {"a.json": {"value": [1, {}]}}


def test_cases_with_random_names_are_compared_by_their_numbers(tmp_path):
    for folder, names in (("one", ("head-a", "head-b")), ("other", ("head-x", "head-y"))):
        (tmp_path / folder / "answers").mkdir(parents=True)
        for number, name in enumerate(names):
            answer = {"name": name, "campaign": name * 2, "found": number}
            (tmp_path / folder / "answers" / f"{name}.json").write_text(json.dumps(answer), "utf-8")
        cases = {name: {"draw": {"number": number}} for number, name in enumerate(names)}
        (tmp_path / folder / "truth.json").write_text(json.dumps({"cases": cases}), "utf-8")
    one, other = (contents(tmp_path / folder, ["answers/*.json"], "truth.json") for folder in ("one", "other"))
    assert one == other
    assert list(one) == ["answers/case-0.json", "answers/case-1.json"]
    assert one["answers/case-1.json"] == {"name": "case-1", "found": 1}


def test_a_process_that_outlives_its_command_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(killed_commands, "SECONDS_TO_END", 0.3)
    sleeper = "import time; time.sleep(60)"
    parent = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {sleeper!r}]); {sleeper}"
    with pytest.raises(RuntimeError, match=r"left over 0\.3 s after the kill: .*sleep\(60\)"):
        killed_after([sys.executable, "-c", parent], tmp_path, 2.0)
    assert not killed_after([sys.executable, "-c", ""], tmp_path, 20.0)


def test_every_command_that_goes_on_is_tried():
    assert list(COMMANDS) == ["optimize", "bench", "diagnose", "prove", "identify", "tune"]
