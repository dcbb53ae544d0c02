"""The table of measured campaigns, on campaigns of the virtual rig."""

import functools
import json
from dataclasses import replace

import pytest

from inkjet_env.experiments.validation import measured
from inkjet_env.mismatch import diagnose
from inkjet_env.plant import catalogue
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import write_campaign
from inkjet_env.rig import default_battery, record_campaign
from tests.real_data import real_campaign

LABELS = ("loop-1", "trapezoid-40V", "trapezoid-60V", "trapezoid-100V", "bipolar-full", "zero")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two campaigns below a folder, one of them deeper."""
    battery = [line for line in default_battery() if line.label in LABELS]
    battery = [
        replace(line, drive_V=line.drive_V[:600]) if line.channel == "self_sensing" else line for line in battery
    ]
    here = tmp_path_factory.mktemp("measured")
    for name, seed in (("a", 0), ("below/b", 1)):
        write_campaign(here / name, record_campaign(Printhead.published(), seed, battery=battery))
    return here


@pytest.fixture
def few_effects(monkeypatch):
    few = [effect for effect in catalogue() if effect.id in ("feedthrough", "cubic_stiffness")]
    monkeypatch.setattr(measured, "diagnose", functools.partial(diagnose, effects=few))


def test_every_campaign_below_the_folder_has_a_line(folder, few_effects, tmp_path, capsys):
    measured.main([str(folder), "--hold-out", "b:r003", "--workers", "1", "--out", str(tmp_path)])
    printed = capsys.readouterr().out
    lines = printed.strip().splitlines()
    assert [line.split(" | ")[0].strip("| ") for line in lines[2:]] == ["a", "b"]
    assert (tmp_path / "measured.md").read_text().strip() == printed.strip()
    found = json.loads((tmp_path / "measured.json").read_text())["campaigns"]
    assert "r003" in found[1]["heldout"]  # with its repeats
    assert found[0]["diagnosis"]["verdict"] == "none"
    assert found[0]["rms"]["with_remainder"] is None
    assert found[0]["rms"]["base"] > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere: no campaign (datapackage.json) is there or below"),
        (["{folder}", "--hold-out", "c:r003"], "--hold-out c: no campaign of that name"),
        (["{folder}", "--hold-out", "c"], "--hold-out must read NAME:r1,r2; got 'c'"),
    ],
)
def test_bad_input_is_refused_in_a_sentence(folder, arguments, message, capsys):
    with pytest.raises(SystemExit) as ended:
        measured.main([argument.format(folder=folder) for argument in arguments])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_the_measured_campaigns_are_found_where_they_are():
    for name in ("silverbox", "piezo-actuator"):
        assert real_campaign(name).recordings
