"""``inkjet scan``: figure, table and JSON of one waveform on published, corrected and recorded heads."""

import csv
import json

import pytest

from inkjet_env.cli.scan import PUBLISHED_BEST
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead, Waveform
from inkjet_env.recordings import write_campaign
from inkjet_env.rig import record_campaign

HEAD = Printhead.published()
SMALL = ["--points", "9"]


@pytest.fixture
def corrected(tmp_path):
    effect = next(e for e in catalogue() if e.id == "second_mode")
    path = tmp_path / "corrected.json"
    AugmentedPrinthead(HEAD, ((effect, effect.example_values(HEAD)),)).to_json(path)
    return path


def test_a_waveform_is_scanned_on_the_published_head(inkjet, tmp_path):
    status, out, _ = inkjet("scan", *SMALL, "--plot", "s.png", "--out", "s.csv", "--json", "s.json")
    assert status == 0
    assert "published" in out
    assert "-22.830" in out
    found = json.loads((tmp_path / "s.json").read_text())
    assert found["format"] == "scan/1"
    (one,) = found["scans"]
    assert list(one) == ["head", "pulse_width", "voltage", "jetting_frequency", "robustness"]
    assert len(one["jetting_frequency"]["values"]) == 18
    rows = list(csv.DictReader((tmp_path / "s.csv").open()))
    assert len(rows) == 9 + 9 + 18
    assert float(rows[-1]["effective_V"]) == pytest.approx(one["jetting_frequency"]["effective_V"][-1])
    assert (tmp_path / "s.png").read_bytes().startswith(b"\x89PNG")


def test_the_waveform_that_is_scanned_by_default_is_as_good_as_the_best_known_one():
    known = problem("nominal").best_known
    assert HEAD.respond(Waveform.from_array(PUBLISHED_BEST)).cost() == pytest.approx(known.cost, abs=0.01)


def test_a_corrected_head_is_shown_with_and_without_its_effects_and_a_recorded_one_beside(inkjet, tmp_path, corrected):
    write_campaign(tmp_path / "recorded", record_campaign(HEAD, 1))
    optimum = {"waveform": [60, 0, 2e-6, 8e-6, 2e-6, 1e-6, 1e-6]}
    (tmp_path / "optimum.json").write_text(json.dumps(optimum))
    arguments = ["scan", "corrected.json", "recorded", "--optimum", "optimum.json", "--vary", "U1,t2", *SMALL]
    status, out, _ = inkjet(*arguments, "--json", "s.json")
    assert status == 0
    found = json.loads((tmp_path / "s.json").read_text())
    names = [one["head"] for one in found["scans"]]
    assert names == ["corrected, base part", "corrected, with second mode", "recorded"]
    assert all(name in out for name in names)
    assert found["waveform"] == optimum["waveform"]
    base, _, recorded = (one["robustness"] for one in found["scans"])
    assert base["names"] == ["U1", "t2"]
    assert recorded["cost_V"][0][0] == pytest.approx(base["cost_V"][0][0], abs=0.5)  # it was recorded from that head


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.json"], "none.json"),
        (["--vary", "t2"], "two different parameters"),
        (["--points", "1"], "points must be at least 3"),
        (["--optimum", "corrected.json"], "corrected.json: it must be the JSON file of optimize"),
        (["--waveform", *["1"] * 7, "--optimum", "corrected.json"], "not both"),
        (["--out", "s.txt"], "--out must end in .csv"),
        (["--plot", "s.gif"], "must end in .png, .svg or .pdf"),
        (["corrected.json"] * 4, "8 heads, with and without effects, do not fit"),
    ],
)
def test_a_bad_scan_is_one_sentence_and_status_2(inkjet, corrected, arguments, said):
    status, out, err = inkjet("scan", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err
