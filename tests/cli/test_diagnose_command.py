import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inkjet_env import mismatch
from inkjet_env.estimate import Estimate
from inkjet_env.identification import ModelledRecording
from inkjet_env.mismatch.design.next_experiment import NextExperiment
from inkjet_env.mismatch.diagnosis import Diagnosis, NamedEffect
from inkjet_env.mismatch.localization.location import Location
from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, write_campaign
from inkjet_env.recordings.drive import read_drive
from inkjet_env.reporting import diagnosis_report
from inkjet_env.rig import default_battery, record_campaign, strain_gauge_battery
from inkjet_env.storage import write_json
from tests.cli.command import files_below

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
LABELS = {"trapezoid-60V", "trapezoid-100V", "bipolar-full", "multisine-50V-a", "zero"}
DRIVE_V = tuple(np.repeat([0.0, 60.0, 0.0], (10, 50, 100)))


@pytest.fixture(scope="module")
def campaign():
    battery = [line for line in default_battery() if line.label in LABELS and line.channel == "self_sensing"]
    return record_campaign(HEAD, 1, battery=battery, snr_dB=40)


@pytest.fixture
def folder(campaign, tmp_path):
    write_campaign(tmp_path / "campaign", campaign)
    return tmp_path / "campaign"


@pytest.fixture(scope="module")
def found(campaign):
    """A verdict with everything that can be written: an effect with an open interval, and a next experiment."""
    effect = EFFECTS["sensor_bandwidth"]
    values = {"bandwidth_Hz": 9e5, "second_order": 0.0}
    recordings = []
    for recording in campaign.recordings:
        excitation = Excitation(recording.channel, recording.initial_state, recording.time_s[1], recording.drive_V)
        base, after = (Plant(HEAD, effects=on).signal(excitation) for on in ((), ((effect, values),)))
        fitted = 0 if recording.name == "r002" else base.size
        recordings.append(
            ModelledRecording(
                recording.name,
                recording.channel,
                "V",
                recording.order,
                recording.time_s[1],
                recording.drive_V,
                recording.sensor + after - base,
                {"base": base, "augmented": after},
                fitted,
                0.05,
            )
        )
    return Diagnosis(
        campaign="virtual-rig",
        verdict="set",
        headline="These recordings cannot tell apart: the sensing or the driving amplifier",
        effects=(
            NamedEffect(
                effect,
                effect.description(values),
                40.0,
                0.005,
                {"bandwidth_Hz": Estimate(9e5, 6e5, math.inf), "second_order": Estimate(0.0, 0.0, 0.2)},
                values,
            ),
        ),
        minor=(),
        candidates=(("sensor_bandwidth", "amplifier_bandwidth"),),
        location=Location(sentence="On the edges."),
        recordings=tuple(recordings),
        closure=0.93,
        left_over=0.0,
        held_out_left_over=0.0,
        overlap=0.0,
        p_value=1.0,
        attributions=(),
        untestable={},
        next_experiments=(
            NextExperiment("Record the voltage at the head.", "self_sensing", "periodic", 1e-7, DRIVE_V, 9.0, 0.7),
        ),
        remainder=None,
        printhead=HEAD,
        gains={"self_sensing": HEAD.b1},
        offsets={"self_sensing": 0.01},
        base_printhead=HEAD.varied(damping_ratio=0.05),
        dynamics={name: Estimate(v, 0.9 * v, 1.1 * v) for name in ("a0", "a1", "b1") for v in (getattr(HEAD, name),)},
        probabilities={"sensor_bandwidth": 0.5, "amplifier_bandwidth": 0.4, "none of these": 0.1},
        notes=("A note.",),
        seconds=1.0,
        stages={"base model": 1.0},
    )


@pytest.fixture
def made_by_hand(found, monkeypatch):
    """The command without the work; what it was asked for."""
    asked = {}

    def diagnose(campaign, printhead=None, **options):
        asked.update(campaign=campaign, printhead=printhead, **options)
        options["progress"]("working")
        return found

    monkeypatch.setattr(mismatch, "diagnose", diagnose)
    return asked


@pytest.mark.parametrize("planted", [(), ("feedthrough",)])
def test_a_campaign_leads_to_a_verdict_a_page_and_a_printhead(planted, campaign, inkjet, tmp_path):
    """By the whole way through: nothing is found where nothing is, and what is planted is found."""
    on = tuple((EFFECTS[name], complete(EFFECTS[name], capacitive_s=2e-8)) for name in planted)
    changed = []
    for recording in campaign.recordings:
        excitation = Excitation(recording.channel, recording.initial_state, recording.time_s[1], recording.drive_V)
        added = Plant(HEAD, effects=on).signal(excitation) - Plant(HEAD).signal(excitation)
        changed.append(replace(recording, sensor=recording.sensor + added))
    write_campaign(tmp_path / "campaign", Campaign("head-17", tuple(changed)))
    arguments = ("--json", "found.json", "--report", "page.html", "--printhead-out", "head.json")
    status, out, err = inkjet("diagnose", "campaign", *arguments, "--hold-out", "r002", "--seed", "3")
    assert status == 0, err
    verdict = json.loads((tmp_path / "found.json").read_text())
    assert verdict["format"] == "diagnosis/1"
    assert (verdict["verdict"] == "none") == (not planted)
    assert "r002" in verdict["fit"]["heldout"]
    assert verdict["headline"] in out
    assert ("the corrected printhead, ready for --printhead" in out) == bool(planted)
    assert ("the base printhead: no effect was found" in out) == (not planted)
    assert "</html>" in (tmp_path / "page.html").read_text()
    head = read_printhead(tmp_path / "head.json")
    assert head.frequency_Hz == pytest.approx(HEAD.frequency_Hz, rel=1e-3)
    written = json.loads((tmp_path / "head.json").read_text())["dynamics"]
    assert all(one["low"] < one["value"] < one["high"] for one in written.values())
    assert [e["id"] for e in verdict["effects"]] == list(planted)
    if planted:
        (found,) = verdict["effects"]
        assert found["parameters"]["capacitive_s"]["value"] == pytest.approx(2e-8, rel=0.02)


def test_all_that_was_found_is_printed(made_by_hand, inkjet, folder):
    status, out, _ = inkjet("diagnose", "campaign")
    assert status == 0
    for words in (
        "These recordings cannot tell apart: the sensing or the driving amplifier",
        "sensor_bandwidth, amplifier_bandwidth",
        "600 … ∞",
        "kHz",
        "self-sensing, held out",
        "On the edges.",
        "Next experiment: Record the voltage at the head.",
        "- A note.",
    ):
        assert words in out
    assert [path.name for path in folder.parent.iterdir()] == ["campaign"]


def test_options_reach_the_diagnosis(made_by_hand, inkjet, folder, tmp_path):
    HEAD.varied(frequency_Hz=44e3).to_json(tmp_path / "start.json")
    arguments = ("--printhead", "start.json", "--hold-out", "r001, r003", "--seed", "7", "--workers", "1")
    assert inkjet("diagnose", "campaign", *arguments)[0] == 0
    assert made_by_hand["held_out"] == ("r001", "r003")
    assert made_by_hand["workers"] == 1
    assert made_by_hand["printhead"].frequency_Hz == pytest.approx(44e3)
    assert made_by_hand["rng"].integers(1 << 60) == np.random.default_rng(7).integers(1 << 60)


@pytest.mark.parametrize(
    ("arguments", "drive_csv", "file"),
    [
        (("--json", "out/found.json"), "next.csv", "out/next.csv"),
        (("--json", "out/found.json", "--next-out", "drive.csv"), "../drive.csv", "drive.csv"),
        (("--json", "-", "--next-out", "out/drive.csv"), "out/drive.csv", "out/drive.csv"),
        (("--json", "-"), None, None),
    ],
)
def test_the_verdict_names_the_drive_from_its_own_folder(
    arguments, drive_csv, file, made_by_hand, inkjet, folder, tmp_path
):
    (tmp_path / "out").mkdir()
    status, out, err = inkjet("diagnose", "campaign", *arguments)
    assert status == 0, err
    verdict = json.loads(out if "-" in arguments else (tmp_path / "out" / "found.json").read_text())
    assert verdict["next_experiment"] == {
        "sentence": "Record the voltage at the head.", "drive_csv": drive_csv, "channel": "self_sensing",
        "initial_state": "periodic", "step_s": 1e-7, "repeats": 1, "drive_monitor": False, "information_bits": 0.7,
    }  # fmt: skip
    assert verdict["further_experiments"] == []
    assert [p for p in tmp_path.rglob("*.csv") if p.parent != folder] == ([] if file is None else [tmp_path / file])
    if file is not None:
        read = read_drive(tmp_path / file)
        assert tuple(read.drive_V) == DRIVE_V
        assert read.time_s == pytest.approx(1e-7 * np.arange(len(DRIVE_V)))


def test_further_experiments_have_files_of_their_own(found, inkjet, folder, tmp_path, monkeypatch):
    (first,) = found.next_experiments
    second = replace(first, drive_V=(0.0, -5.0, 0.0), neighbour_V=(1.0, 2.0, 3.0))
    three = replace(found, next_experiments=(first, NextExperiment("Record anything."), second))
    monkeypatch.setattr(mismatch, "diagnose", lambda *given, **options: three)
    status, out, err = inkjet("diagnose", "campaign", "--json", "found.json")
    assert status == 0, err
    assert out.count("- Next experiment:") == 3
    verdict = json.loads((tmp_path / "found.json").read_text())
    asked = [verdict["next_experiment"], *verdict["further_experiments"]]
    assert [one["drive_csv"] for one in asked] == ["next.csv", None, "next-3.csv"]
    rows = np.loadtxt(tmp_path / "next-3.csv", delimiter=",", skiprows=1)
    assert (tmp_path / "next-3.csv").read_text().startswith("time_s,drive_V,neighbour_V\n")
    assert rows[:, 1:].tolist() == [[0, 1], [-5, 2], [0, 3]]


def test_the_printhead_that_is_written_answers_with_its_effects(made_by_hand, found, inkjet, folder, tmp_path):
    assert inkjet("diagnose", "campaign", "--printhead-out", "head.json")[0] == 0
    written = json.loads((tmp_path / "head.json").read_text())
    parameters = {
        "bandwidth_Hz": {"value": 9e5, "low": 6e5, "high": None, "unit": "Hz"},
        "second_order": {"value": 0.0, "low": 0.0, "high": 0.2, "unit": "1"},
    }
    assert written["effects"] == [{"id": "sensor_bandwidth", "parameters": parameters}]
    assert written["fit"]["channels"]["self_sensing"]["gain"]["value"] == HEAD.b1
    read = read_printhead(tmp_path / "head.json")
    recording = found.recordings[0]
    excitation = Excitation(recording.channel, "periodic", recording.step_s, recording.drive_V)
    on = ((EFFECTS["sensor_bandwidth"], {"bandwidth_Hz": 9e5, "second_order": 0.0}),)
    np.testing.assert_allclose(read.plant.signal(excitation), Plant(HEAD, effects=on).signal(excitation), atol=1e-9)
    status, out, err = inkjet("evaluate", "campaign", "--printhead", "head.json", "--json", "-")
    assert status == 0, err
    assert json.loads(out)["format"] == "evaluation/1"


def test_a_law_of_which_parts_are_off_is_written_whole(found, tmp_path):
    """Slipping elements alone: the loss ratio of the other part tells nothing, and no simulation does without it."""
    effect = EFFECTS["ferroelastic_softening"]
    values = complete(effect, rayleigh_per_V=1.3e-4, power=0.15, loss_ratio=10.0)
    told = {"rayleigh_per_V": Estimate(1.3e-4, 1.2e-4, 1.4e-4), "power": Estimate(0.15, 0.14, 0.16)}
    named = NamedEffect(effect, effect.description(values), 40.0, 0.005, told, values)
    write_json(tmp_path / "head.json", replace(found, effects=(named,)).augmented_json())
    ((_, read),) = read_printhead(tmp_path / "head.json").effects
    assert read == values


@pytest.mark.parametrize("where", ["diagnosis", "page"])
def test_an_interrupt_leaves_nothing_half_written(where, made_by_hand, monkeypatch, inkjet, folder, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    module, name = (mismatch, "diagnose") if where == "diagnosis" else (diagnosis_report, "diagnosis_html")
    monkeypatch.setattr(module, name, interrupted)
    (tmp_path / "found.json").write_text("before")
    before = files_below(tmp_path)
    arguments = ("--json", "found.json", "--report", "page.html", "--printhead-out", "head.json")
    status, out, _ = inkjet("diagnose", "campaign", *arguments)
    assert (status, out) == (130, "")
    assert files_below(tmp_path) == before
    assert (tmp_path / "found.json").read_text() == "before"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("nowhere",), "nowhere"),
        (("campaign", "--hold-out", "r02"), "Did you mean"),
        (("campaign", "--seed", "-1"), "--seed must be at least 0"),
        (("campaign", "--workers", "0"), "--workers must be at least 1"),
        (("campaign", "--report", "page.pdf"), "--report must end in .html"),
        (("campaign", "--printhead-out", "head.txt"), "--printhead-out must end in .json"),
        (("campaign", "--next-out", "next.json"), "--next-out must end in .csv"),
        (("campaign", "--json", "campaign/datapackage.json"), "would overwrite an input file"),
        (("campaign", "--next-out", "campaign/r001.csv"), "would overwrite an input file"),
        (("campaign", "--json", "x.json", "--printhead-out", "x.json"), "must be different files"),
        (("campaign", "--report", "nowhere/page.html"), "nowhere must be a writable folder"),
        (("campaign", "--printhead", "campaign/r001.csv"), "is not JSON"),
        (("campaign", "--columns", "time"), "--columns must have the form name=value"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_everything_as_it_was(arguments, told, inkjet, folder, tmp_path):
    before = files_below(tmp_path)
    status, out, err = inkjet("diagnose", *arguments)
    assert (status, out) == (2, "")
    said = [line for line in err.splitlines() if not line.startswith(("diagnose ", "compiling "))]
    assert len(said) == 1
    assert said[0].startswith("inkjet: ")
    assert told in said[0]
    assert files_below(tmp_path) == before


def test_help_shows_an_example(inkjet):
    status, out, _ = inkjet("diagnose", "--help")
    assert status == 0
    assert "\n  inkjet diagnose campaign " in out


def test_an_interrupted_diagnosis_says_what_is_kept(inkjet, folder, tmp_path, monkeypatch):
    asked = []

    def diagnose(*_, checkpoint, **__):
        asked.append(checkpoint)
        raise KeyboardInterrupt

    monkeypatch.setattr(mismatch, "diagnose", diagnose)
    status, _, err = inkjet("diagnose", "campaign", "--json", "found.json", "--report", "page.html")
    assert status == 130
    assert err.endswith("Interrupted; finished fits are kept in found.json.fits. Run the same command to resume.\n")
    assert inkjet("diagnose", "campaign", "--checkpoint", "mine", "--report", "page.html")[0] == 130
    err = inkjet("diagnose", "campaign")[2]
    assert err.endswith("Interrupted; no fits were kept. Use --checkpoint FOLDER to keep finished fits.\n")
    assert asked == [Path("found.json.fits"), Path("mine"), None]
    assert [path.name for path in tmp_path.iterdir()] == ["campaign"]


def test_a_printhead_of_another_head_altogether_is_refused(inkjet, folder, tmp_path):
    HEAD.varied(frequency_Hz=30.0).to_json(tmp_path / "other.json")
    status, _, err = inkjet("diagnose", "campaign", "--printhead", "other.json", "--json", "found.json")
    assert status == 2
    assert err.splitlines()[-1].startswith(
        "inkjet: the given printhead, with a resonance at 30 Hz, explains almost nothing"
    )
    assert not (tmp_path / "found.json").exists()


def test_slow_recordings_alone_are_diagnosed_and_every_file_is_written(inkjet, tmp_path):
    write_campaign(tmp_path / "slow", record_campaign(HEAD, 0, battery=strain_gauge_battery()))
    arguments = ("--printhead-out", "head.json", "--report", "page.html", "--json", "verdict.json", "--workers", "1")
    status, out, _ = inkjet("diagnose", "slow", *arguments)
    assert status == 0
    assert "second_mode cannot be tested here, because every recording is too slow to show the resonance" in out
    assert json.loads((tmp_path / "verdict.json").read_text())["verdict"] == "none"
    assert "too slow to show the resonance" in (tmp_path / "page.html").read_text()
    assert not read_printhead(tmp_path / "head.json").has_dynamics
    status, out, _ = inkjet("identify", "slow", "--out", "identified.json")
    assert status == 0
    assert out.splitlines()[-1].startswith("identified.json: ready for `inkjet evaluate` and `inkjet diagnose`")
    assert inkjet("evaluate", "slow", "--printhead", "head.json")[0] == 0
    status, _, err = inkjet("simulate", "--drive", "slow/r001.csv", "--printhead", "head.json")
    assert status == 2
    assert "a0, a1 and b1 of this printhead are unknown" in err
