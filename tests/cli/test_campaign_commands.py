import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments import cli
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, read_campaign, write_campaign
from inkjet_env.rig import default_battery, record_campaign, strain_gauge_battery
from tests.cli.command import files_below

FEW = ("loop-1", "trapezoid-60V", "trapezoid-100V", "bipolar-full", "zero")


def few_recordings(seed=1):
    """A campaign that is identified in less time than the whole battery."""
    lines = [line for line in default_battery() if line.label in FEW]
    return record_campaign(Printhead.published(), seed, battery=lines)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder of a campaign that the command recorded; for tests that do not change it."""
    folder = tmp_path_factory.mktemp("whole") / "campaign"
    with pytest.raises(SystemExit) as exit_:
        cli.main(["record", str(folder), "--seed", "1"])
    assert exit_.value.code == 0
    return folder


def test_four_commands_lead_from_a_head_to_its_waveform(inkjet, tmp_path):
    truth = Printhead.published().varied(frequency_Hz=44e3, damping_ratio=0.06)
    truth.to_json(tmp_path / "truth.json")
    assert inkjet("record", "campaign", "--printhead", "truth.json", "--seed", "1")[0] == 0
    status, out, err = inkjet(
        "identify", "campaign", "--out", "head.json", "--report", "page.html", "--json", "found.json"
    )
    assert status == 0
    assert "warning" not in err  # on a slow machine it says what it is doing
    assert "Resonance 44 kHz" in out
    status, out, _ = inkjet("optimize", "--printhead", "head.json", "--optimizer", "cma-es", "--budget", "300")
    assert status == 0
    drive = np.genfromtxt(tmp_path / "optimum.csv", delimiter=",", names=True)
    assert drive["drive_V"][0] == drive["drive_V"][-1] == 0
    status, out, _ = inkjet("simulate", "--printhead", "truth.json", "--drive", "optimum.csv", "--out", "response.csv")
    assert status == 0
    found = json.loads((tmp_path / "found.json").read_text())
    assert found == json.loads((tmp_path / "head.json").read_text())
    assert found["format"] == "printhead/1"
    for name in ("a0", "a1", "b1"):
        entry = found["dynamics"][name]
        assert list(entry) == ["value", "low", "high"]
        assert entry["low"] < entry["value"] < entry["high"]
        assert entry["value"] == pytest.approx(getattr(truth, name), rel=1e-4)
    assert found["hysteresis"]["full_scale_V"] == 180.0
    assert found["hysteresis"]["degree"] == len(found["hysteresis"]["coefficients"]) - 1 == 8
    assert found["fit"]["heldout_rms_V"] == pytest.approx(found["fit"]["noise_rms_V"], rel=0.05)
    assert set(found["fit"]["heldout"]) < {r.name for r in read_campaign(tmp_path / "campaign").recordings}
    assert (tmp_path / "page.html").read_text().startswith("<!DOCTYPE html>")


def test_evaluate_tells_the_residual_of_each_recording_and_finds_a_wrong_head(inkjet, tmp_path, whole):
    shutil.copytree(whole, tmp_path / "campaign")
    inkjet("identify", "campaign", "--out", "head.json")
    status, out, err = inkjet("evaluate", "campaign", "--printhead", "head.json", "--json", "-")
    assert (status, err) == (0, "")
    found = json.loads(out)
    assert found["format"] == "evaluation/1"
    assert list(found["recordings"]) == [r.name for r in read_campaign(tmp_path / "campaign").recordings]
    assert list(found["recordings"]["r001"]) == ["rms", "output_rms", "unit", "noise_rms", "differs"]
    assert found["same_head"] is True
    assert found["sentence"].startswith("Yes, this is still the same head: it predicts all 38 recordings to within 2 %")
    noise = json.loads((tmp_path / "head.json").read_text())["fit"]["noise_rms_V"]
    assert found["rms"] == pytest.approx(noise, rel=0.05)
    Printhead.published().varied(damping_ratio=0.06).to_json(tmp_path / "wrong.json")
    status, out, err = inkjet("evaluate", "campaign", "--printhead", "wrong.json", "--json", "wrong-found.json")
    assert status == 0
    assert "r001" in out
    assert "gives no gain for strain_gauge" in err
    wrong = json.loads((tmp_path / "wrong-found.json").read_text())
    assert wrong["rms"] > 20 * noise
    assert wrong["same_head"] is False
    assert out.startswith("No, this is not the same head, or it has changed: ")
    assert any(one["differs"] for one in wrong["recordings"].values())


def test_an_effect_is_hidden_for_a_first_diagnosis(inkjet, tmp_path):
    status, out, _ = inkjet("record", "hidden", "--hide", "second_mode", "--seed", "1")
    assert (status, out) == (0, "hidden: 38 recordings; to find what is hidden: inkjet diagnose hidden\n")
    _, out, _ = inkjet("identify", "hidden", "--out", "head.json")
    assert "the model does not explain the held-out recordings of self-sensing" in out
    status, _, err = inkjet("record", "other", "--hide", "mains_hum")  # nothing in these recordings would show it
    assert status == 2
    assert "--hide must be one of air_bubble, " in err
    assert not (tmp_path / "other").exists()


def test_the_same_seed_records_the_same_campaign(inkjet, tmp_path, whole):
    for folder, seed in (("b", 1), ("c", 2)):
        assert inkjet("record", folder, "--seed", seed)[0] == 0
    names = files_below(whole)
    assert names == files_below(tmp_path / "b")
    folders = whole, tmp_path / "b", tmp_path / "c"
    contents = [[(folder / name).read_bytes() for name in names] for folder in folders]
    assert contents[0] == contents[1] != contents[2]


def test_what_was_measured_is_not_replaced_by_what_is_simulated(inkjet, tmp_path, whole):
    shutil.copytree(whole, tmp_path / "campaign")
    status, _, err = inkjet("record", "campaign", "--plan")
    assert status == 2
    assert "holds a campaign" in err
    assert inkjet("record", "campaign", "--seed", "2")[0] == 0  # its own
    measured = replace(read_campaign(tmp_path / "campaign"), description="Head 7, on Monday.")
    write_campaign(tmp_path / "campaign", measured)
    before = {path: path.read_bytes() for path in (tmp_path / "campaign").iterdir()}
    status, _, err = inkjet("record", "campaign", "--seed", "2")
    assert status == 2
    assert "campaign: holds a campaign that the virtual rig did not record" in err
    assert {path: path.read_bytes() for path in (tmp_path / "campaign").iterdir()} == before


def test_a_plan_holds_drives_for_a_generator_and_says_what_each_is_for(inkjet, tmp_path):
    assert inkjet("record", "drives", "--plan", "--json", "plan.json")[0] == 0
    rows = (tmp_path / "drives" / "plan.csv").read_text().splitlines()
    assert rows[0].endswith("purpose")
    assert len(rows) - 1 == json.loads((tmp_path / "plan.json").read_text())["lines"]
    for row in rows[1:]:
        header = (tmp_path / "drives" / row.split(",")[0]).read_text().splitlines()[0]
        assert header == "time_s,drive_V"


def test_several_campaigns_are_identified_side_by_side_and_a_bad_one_stops_no_other(inkjet, tmp_path):
    for seed in (1, 2):
        write_campaign(tmp_path / f"head-{seed}", few_recordings(seed))
    (tmp_path / "empty").mkdir()
    status, out, err = inkjet("identify", "head-1", "empty", "head-2", "--out", "heads", "--workers", "1")
    assert status == 2
    assert "heads: 2 printheads" in out
    assert "empty" in err.splitlines()[-1]
    assert files_below(tmp_path / "heads") == ["head-1.json", "head-2.json"]
    assert Printhead.from_json(tmp_path / "heads" / "head-1.json").frequency_Hz == pytest.approx(51.69e3, rel=1e-3)


@pytest.mark.parametrize("channel", ["strain_gauge", "displacement"])
def test_slow_recordings_alone_give_a_head_that_says_what_it_lacks(channel, inkjet, tmp_path):
    lines = [replace(line, channel=channel) for line in strain_gauge_battery()]
    write_campaign(tmp_path / "slow", record_campaign(Printhead.published(), 0, battery=lines))
    status, out, _ = inkjet("identify", "slow", "--out", "slow.json", "--report", "page.html")
    assert status == 0
    assert "Resonance unknown" in out
    assert "a0, a1 and b1 cannot be known from these recordings" in out
    assert "Ringing" not in (tmp_path / "page.html").read_text()
    assert json.loads((tmp_path / "slow.json").read_text())["dynamics"]["a0"]["value"] is None
    status, out, _ = inkjet("evaluate", "slow", "--printhead", "slow.json", "--json", "-")
    assert status == 0
    noise = json.loads((tmp_path / "slow.json").read_text())["fit"]["channels"][channel]["noise_rms"]
    assert json.loads(out)["rms"] == pytest.approx(noise, rel=0.1)
    for refused in (
        ("simulate", "--waveform", *["100", "-100", "1e-6", "10.49e-6", "13.74e-6", "9.81e-6", "19.96e-6"]),
        ("optimize", "--optimizer", "pso", "--budget", "100"),
        ("record", "other"),
    ):
        status, out, err = inkjet(*refused, "--printhead", "slow.json")
        assert (status, out) == (2, "")
        told = [line for line in err.splitlines() if not line.startswith("compiling ")]
        assert len(told) == 1
        assert told[0].startswith("inkjet: the dynamics a0, a1 and b1 of this printhead are unknown")


def test_displacement_is_recorded_on_demand(inkjet, tmp_path, whole):
    assert inkjet("record", "campaign", "--displacement")[0] == 0
    assert read_campaign(tmp_path / "campaign").select("displacement")
    assert not read_campaign(whole).select("displacement")


def test_oscilloscope_files_are_identified_with_the_channel_told(inkjet, tmp_path, whole):
    write_campaign(tmp_path / "few", few_recordings())
    (tmp_path / "scope").mkdir()
    campaign = read_campaign(whole)
    for r in campaign.select("self_sensing", initial_state="demagnetised"):
        table = np.column_stack([r.time_s, r.sensor, r.drive_V])
        np.savetxt(tmp_path / "scope" / f"{r.name}.csv", table, delimiter=",", header="t,A,B", comments="")
    arguments = ("identify", "scope", "--channel", "self_sensing", "--columns", "time=t,drive=B,sensor=A")
    status, _, err = inkjet(*arguments, "--json", "-", "--initial-state", "demagnetised")
    assert status == 0, err
    assert Printhead.from_json(tmp_path / "printhead.json").frequency_Hz == pytest.approx(51.69e3, rel=1e-4)
    status, _, err = inkjet("identify", "few", "--initial-state", "free")
    assert status == 0
    assert "initial_state is 'periodic' in the descriptor; free was not applied" in err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("identify", "nowhere"), "nowhere"),
        (("identify", "campaign", "--degree", "13"), "degree must be 1 to 12; got 13"),
        (("identify", "campaign", "--degree-rule", "paper"), "--degree-rule must be"),
        (("identify", "campaign", "--held-out", "r01"), "Did you mean"),
        (("identify", "campaign", "--columns", "time"), "--columns must have the form name=value"),
        (("identify", "campaign", "--out", "nowhere/head.json"), "nowhere must be a writable folder"),
        (("identify", "campaign", "campaign"), "2 folders are called 'campaign'"),
        (("identify", "campaign", "other", "--json", "x.json"), "need a single campaign"),
        (("record", "campaign", "--seed", "-1"), "--seed must be at least 0"),
        (("record", "plan", "--plan", "--snr-db", "40"), "leave out --snr-db"),
        (("record", "plan", "--plan", "--seed", "4"), "leave out --snr-db and --seed"),
        (("identify", "campaign", "--out", "campaign/r001.csv"), "would overwrite an input file"),
        (("identify", "campaign", "--json", "campaign/datapackage.json"), "would overwrite an input file"),
        (("identify", "campaign", "--report", "page.pdf"), "--report must end in .html"),
        (("identify", "campaign", "--workers", "0"), "--workers must be at least 1"),
        (("evaluate", "campaign", "--printhead", "odd.json"), "fit.channels.strain_gauge.gain.value must be a number"),
        (("evaluate", "nowhere"), "nowhere"),
        (("record", "head.txt"), "is not a folder"),
        (("record", "full"), "holds files and no campaign"),
        (("record", "campaign", "--printhead", "head.txt"), "head.txt: is not JSON"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_everything_as_it_was(arguments, told, inkjet, tmp_path, whole):
    shutil.copytree(whole, tmp_path / "campaign")
    (tmp_path / "head.txt").write_text("no head")
    odd = Printhead.published().as_json(fit={"channels": {"strain_gauge": {"gain": {"value": "much"}}}})
    (tmp_path / "odd.json").write_text(json.dumps(odd))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "diary.txt").write_text("mine")
    before = files_below(tmp_path)
    status, out, err = inkjet(*arguments)
    assert status == 2
    assert out == ""
    said = [line for line in err.splitlines() if not line.startswith(("identify ", "compiling "))]
    assert len(said) == 1
    assert said[0].startswith("inkjet: ")
    assert told in err
    assert files_below(tmp_path) == before


def test_a_unit_that_cannot_be_meant_stops_identification_and_a_doubtful_one_is_said(inkjet, tmp_path, whole):
    campaign = read_campaign(whole)

    def with_drive(factor):
        recordings = tuple(replace(r, drive_V=factor * r.drive_V) for r in campaign.recordings)
        write_campaign(tmp_path / "wrong", Campaign("wrong", recordings))
        return inkjet("identify", "wrong")

    status, _, err = with_drive(1e3)
    assert status == 2
    assert "wrong/r001.csv, row" in err
    assert "Check the unit, volts" in err
    status, _, err = with_drive(1e-3)
    assert status == 0
    assert "warning: " in err
    assert "more of this kind" in err


def test_help_shows_an_example(inkjet):
    for command in ("record", "identify", "evaluate"):
        status, out, _ = inkjet(command, "--help")
        assert status == 0
        assert f"\n  inkjet {command} " in out
