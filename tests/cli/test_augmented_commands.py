"""The commands on a printhead with effects."""

import json
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.single_run import Optimisation, read_record, write_record
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import HeadEnsemble, ensemble_of
from inkjet_env.plant.remainder import ChannelRemainder, Remainder, Term
from inkjet_env.plant.remainder_features import TIMES
from inkjet_env.printhead import Printhead, Waveform
from inkjet_env.recordings import Campaign, Recording, write_campaign
from tests.cli.command import run

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
AUGMENTED = AugmentedPrinthead(HEAD, ((EFFECTS["sensor_saturation"], {"limit": 5.0, "hardness": 20.0}),))
WAVEFORM = (90.0, -70.0, 3e-6, 9e-6, 5e-6, 8e-6, 7e-6)


@pytest.fixture
def head_file(tmp_path):
    AUGMENTED.to_json(tmp_path / "head.json")
    return tmp_path / "head.json"


def test_simulate_shows_the_head_with_its_effects(tmp_path, head_file):
    out = tmp_path / "simulation.json"
    status = run(
        "simulate", "--waveform", *WAVEFORM, "--printhead", head_file, "--json", out, "--plot", tmp_path / "p.png"
    )
    assert status == 0
    found, expected = json.loads(out.read_text()), AUGMENTED.respond(Waveform(*WAVEFORM))
    assert found["peaks_V"] == expected.peaks_V.tolist()
    assert found["cost"] == expected.cost()
    assert max(map(abs, found["peaks_V"])) < 5.0
    assert (tmp_path / "p.png").stat().st_size > 1000


def test_simulate_follows_any_drive(tmp_path, head_file):
    time_s = 2e-7 * np.arange(600)
    drive_V = Waveform(*WAVEFORM).drive_V(time_s)
    rows = "\n".join(f"{t:.9g},{u:.9g}" for t, u in zip(time_s, drive_V, strict=True))
    (tmp_path / "drive.csv").write_text(f"time_s,drive_V\n{rows}\n")
    out = tmp_path / "out.csv"
    assert run("simulate", "--drive", tmp_path / "drive.csv", "--printhead", head_file, "--out", out) == 0
    shown = np.loadtxt(out, delimiter=",", skiprows=1)[:, 2]
    assert shown == pytest.approx(AUGMENTED.respond_sampled(time_s, drive_V).sensor_V, abs=1e-6)


def test_optimize_finds_a_waveform_for_the_head_with_its_effects(tmp_path, head_file):
    found_file, out = tmp_path / "optimum.json", tmp_path / "optimum.csv"
    settings = ("--particles", 6, "--generations", 3, "--printhead", head_file, "--window", 2e-4)
    assert run("optimize", *settings, "--json", found_file, "--out", out, "--plot", tmp_path / "p.png") == 0
    found = json.loads(found_file.read_text())
    assert found["problem"] == "custom"
    assert found["cost"] == AUGMENTED.costs([found["waveform"]], window_s=2e-4)[0]


def test_an_interrupted_run_on_such_a_head_goes_on_from_its_record(tmp_path):
    plan = Optimisation(Problem("custom", AUGMENTED), "random", 12, 3, {})
    whole = plan.carry_out()
    write_record(tmp_path / "record.npz", plan, whole)
    again, recorded = read_record(tmp_path / "record.npz")
    assert again.problem.settings() == plan.problem.settings()
    assert again.carry_out(recorded).best_cost == whole.best_cost


def test_evaluate_takes_the_effects_along(tmp_path, head_file, capsys):
    time_s = 2e-7 * np.arange(1000)
    drive_V = Waveform(*WAVEFORM).drive_V(time_s)
    signal = AUGMENTED.respond_sampled(time_s, drive_V, "demagnetised").sensor_V
    recording = Recording("r", time_s, drive_V, signal, "V", "self_sensing", initial_state="demagnetised")
    write_campaign(tmp_path / "campaign", Campaign("c", (recording,)))
    HEAD.to_json(tmp_path / "base.json")
    rms = {}
    for name in ("head", "base"):
        out = tmp_path / f"{name}-evaluation.json"
        assert run("evaluate", tmp_path / "campaign", "--printhead", tmp_path / f"{name}.json", "--json", out) == 0
        rms[name] = json.loads(out.read_text())["rms"]
    assert rms["head"] < 1e-3 < 0.05 < rms["base"]


REMAINDER = Remainder(
    {
        "self_sensing": ChannelRemainder(
            {"drive": 80.0, "hysteretic": 100.0, "deflection": 150.0, "speed": 150.0},
            {"speed*|speed|": Term(-3.0, 1.0)},
            {"drive": Term(0.2, 1.0)},
            dict.fromkeys(TIMES, ()),
        )
    }
)


@pytest.fixture
def with_remainder(tmp_path):
    AugmentedPrinthead(HEAD, AUGMENTED.effects, remainder=REMAINDER).to_json(tmp_path / "whole.json")
    return tmp_path / "whole.json"


def told_of_it(capsys):
    """Whether standard error has one line about the remainder."""
    lines = [line for line in capsys.readouterr().err.splitlines() if "remainder" in line]
    assert len(lines) <= 1
    return bool(lines)


@pytest.mark.parametrize("option", ["--remainder", "--no-remainder"])
def test_simulate_uses_the_remainder_unless_told_not_to(tmp_path, with_remainder, option, capsys):
    out = tmp_path / "simulation.json"
    assert run("simulate", "--waveform", *WAVEFORM, "--printhead", with_remainder, option, "--json", out) == 0
    whole = AugmentedPrinthead(HEAD, AUGMENTED.effects, remainder=REMAINDER)
    expected = (AUGMENTED if option == "--no-remainder" else whole).respond(Waveform(*WAVEFORM))
    assert json.loads(out.read_text())["peaks_V"] == expected.peaks_V.tolist()
    assert told_of_it(capsys) == (option == "--remainder")


@pytest.mark.parametrize("option", ["--remainder", "--no-remainder"])
def test_optimize_uses_the_remainder_unless_told_not_to(tmp_path, with_remainder, option, capsys):
    found_file, out = tmp_path / "optimum.json", tmp_path / "optimum.csv"
    settings = ("--particles", 4, "--generations", 2, "--printhead", with_remainder, option, "--window", 2e-4)
    assert run("optimize", *settings, "--json", found_file, "--out", out) == 0
    found = json.loads(found_file.read_text())
    whole = AugmentedPrinthead(HEAD, AUGMENTED.effects, remainder=REMAINDER)
    head = AUGMENTED if option == "--no-remainder" else whole
    assert found["cost"] == head.costs([found["waveform"]], window_s=2e-4)[0]
    assert told_of_it(capsys) == (option == "--remainder")


def test_a_problem_on_a_head_with_a_remainder_comes_back_from_its_settings():
    problem = Problem("custom", AugmentedPrinthead(HEAD, (), remainder=REMAINDER))
    again = Problem.from_settings("custom", json.loads(json.dumps(problem.settings())))
    points = np.zeros((1, 7))
    assert again.evaluate(points) == problem.evaluate(points) != Problem("custom", HEAD).evaluate(points)


@pytest.mark.parametrize("option", ["--remainder", "--no-remainder"])
def test_evaluate_uses_the_remainder_unless_told_not_to(tmp_path, with_remainder, option, capsys):
    time_s = 2e-7 * np.arange(1000)
    drive_V = Waveform(*WAVEFORM).drive_V(time_s)
    whole = AugmentedPrinthead(HEAD, AUGMENTED.effects, remainder=REMAINDER)
    signal = whole.respond_sampled(time_s, drive_V, "demagnetised").sensor_V
    recording = Recording("r", time_s, drive_V, signal, "V", "self_sensing", initial_state="demagnetised")
    write_campaign(tmp_path / "campaign", Campaign("c", (recording,)))
    out = tmp_path / "evaluation.json"
    assert run("evaluate", tmp_path / "campaign", "--printhead", with_remainder, option, "--json", out) == 0
    rms = json.loads(out.read_text())["rms"]
    assert rms > 0.01 if option == "--no-remainder" else rms < 1e-3
    assert told_of_it(capsys) == (option == "--remainder")


def test_a_malformed_remainder_is_bad_input(tmp_path, with_remainder, capsys):
    data = json.loads(with_remainder.read_text())
    data["remainder"]["channels"]["self_sensing"]["push"]["speed*|speed|"]["weight"] = None
    with_remainder.write_text(json.dumps(data))
    assert run("simulate", "--waveform", *WAVEFORM, "--printhead", with_remainder) == 2
    assert "weight: must be a finite number; got None" in capsys.readouterr().err.strip().splitlines()[-1]


def test_a_head_that_has_no_rest_where_a_recording_starts_is_told_in_a_sentence(tmp_path, capsys):
    strong = AugmentedPrinthead(HEAD, ((EFFECTS["cubic_stiffness"], {"stiffening_per_V2": 5e-4}),))
    strong.to_json(tmp_path / "head.json")
    time_s = 2e-7 * np.arange(1000)
    recording = Recording(
        "r", time_s, 40 + Waveform(*WAVEFORM).drive_V(time_s), np.sin(np.arange(1000) / 20), "V", "self_sensing",
        initial_state="demagnetised",
    )  # fmt: skip
    write_campaign(tmp_path / "campaign", Campaign("c", (recording,)))
    assert run("evaluate", tmp_path / "campaign", "--printhead", tmp_path / "head.json") == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert told[-1].endswith(
        "head.json: the printhead cannot be simulated on these recordings: no rest was found under the first drive: "
        "forces grow faster than the spring's."
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("simulate", "--waveform", *WAVEFORM, "--window", "inf"), "infinite window needs a printhead without effects"),
        (("simulate", "--waveform", *WAVEFORM, "--hysteresis", "one_point"), "must be one of full_memory"),
        (("optimize", "--optimizer", "lbfgsb-multistart", "--budget", 10), "has no gradients"),
    ],
)
def test_what_such_a_head_cannot_do_is_one_sentence(tmp_path, head_file, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert run(*arguments, "--printhead", head_file) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert message in told[-1]


@pytest.fixture
def uncertain_file(tmp_path):
    """A head without effects that may as well be 2 % faster or slower."""
    heads = tuple(HEAD.varied(HEAD.frequency_Hz * factor) for factor in (0.98, 1.0, 1.02))
    content = HEAD.as_json() | {"ensemble": HeadEnsemble(heads, (1.0, 2.0, 1.0)).as_json()}
    (tmp_path / "uncertain.json").write_text(json.dumps(content))
    return tmp_path / "uncertain.json"


def test_a_robust_waveform_is_better_where_it_is_judged_and_its_spread_is_told(inkjet, tmp_path, uncertain_file):
    arguments = ["optimize", "--printhead", "uncertain.json", "--optimizer", "cma-es", "--budget", "1500"]
    plain, robust = {}, {}
    assert inkjet(*arguments, "--json", "plain.json")[0] == 0
    for risk in ("mean", "worst"):
        status, out, _ = inkjet(*arguments, "--robust", risk, "--json", f"{risk}.json")
        assert status == 0
        assert "over 3 heads that the recordings leave possible" in out
        robust[risk] = json.loads((tmp_path / f"{risk}.json").read_text())
    plain = json.loads((tmp_path / "plain.json").read_text())
    ensemble = ensemble_of(json.loads(uncertain_file.read_text()))
    of_plain = ensemble.costs(plain["waveform"])
    for risk, found in robust.items():
        told = found["robust"]
        assert told["risk"] == risk
        costs = ensemble.costs(found["waveform"])[:, 0]
        assert told["worst"] == pytest.approx(costs.max())
        assert told["cost_of_fit"] == pytest.approx(costs[1])
        assert found["cost"] == pytest.approx(told[risk])
        assert found["cost"] < ensemble.risk(of_plain, risk)[0] - 0.1


def test_an_interrupted_robust_search_goes_on_with_the_same_heads(tmp_path, uncertain_file):
    problem = Problem("custom", HEAD, ensemble=ensemble_of(json.loads(uncertain_file.read_text())), risk="cvar")
    plan = Optimisation(problem, "cma-es", 200, 3)
    whole = plan.carry_out()
    record = tmp_path / "record.npz"
    write_record(record, plan, replace(whole, points=whole.points[:90], costs=whole.costs[:90]))
    again, recorded = read_record(record)
    assert (again.carry_out(recorded).costs == whole.costs).all()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--robust", "mean"], "--robust needs the --printhead"),
        (["--robust", "cvar", "--printhead", "head.json"], "head.json: it does not say which heads"),
        (["--robust", "cvr", "--printhead", "uncertain.json"], "Did you mean 'cvar'?"),
    ],
)
def test_robustness_that_cannot_be_had_is_one_sentence(inkjet, head_file, uncertain_file, arguments, said):
    status, out, err = inkjet("optimize", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err
