"""A user's own effect, in a folder outside this project: diagnosed, written, read, simulated, optimised, evaluated."""

import json
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import inkjet_env
from inkjet_env.plant import Excitation, Plant, registry
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.printhead import Printhead, Waveform
from inkjet_env.recordings import Campaign, Recording, write_campaign
from inkjet_env.rig import default_battery
from tests.cli.command import run

HEAD = Printhead.published()
OWN = "my_effects:QuadraticStiffness"
ASYMMETRY_PER_V = 4e-4
SOURCE = '''
import functools
from dataclasses import replace

import numpy as np

from inkjet_env.plant import Effect, Force, Parameter, compiled_force


class QuadraticStiffness(Effect):
    """A spring that is stiffer when pushed in than when pulled out."""

    id = "quadratic_stiffness"
    stage = "resonator"
    sentence = "The head is stiffer on one side of its rest than on the other."
    parameters = (Parameter("asymmetry_per_V", "1/V", -1.0, 1.0, meaning="relative rise of stiffness a volt"),)
    strengths = ("asymmetry_per_V",)

    def starts(self, printhead, shots):
        return [{"asymmetry_per_V": sign * 1e-4} for sign in (1.0, -1.0)]

    def resonator(self, values, resonance, shot):
        k = values["asymmetry_per_V"]
        if k == 0:
            return resonance
        return replace(resonance, forces=(*resonance.forces, Force(compiled_law(), np.array([k]))))


@functools.cache
def compiled_law():
    return compiled_force(lambda x_V, speed_V, values: values[0] * x_V * x_V)


class NeedsANumber(QuadraticStiffness):
    id = "needs_a_number"

    def __init__(self, number):
        self.number = number


class TakesAnId(QuadraticStiffness):
    id = "creep"


TABLE = {"k": 1}
'''
LINES = ("trapezoid-100V", "bipolar-full", "zero", "trapezoid-minus100V", "trapezoid-60V", "trapezoid-100V", "zero")
SAMPLES = 300
WAVEFORM = (90.0, -70.0, 3e-6, 9e-6, 5e-6, 8e-6, 7e-6)


def recorded(effect):
    """Self-sensed recordings of a head that has the effect, with white noise of 20 mV."""
    plant, rng = Plant(HEAD, effects=((effect, {"asymmetry_per_V": ASYMMETRY_PER_V}),)), np.random.default_rng(3)
    battery = {line.label: line for line in default_battery(HEAD.frequency_Hz) if line.channel == "self_sensing"}
    for order, label in enumerate(LINES, start=1):
        line = battery[label]
        drive_V, time_s = line.drive_V[:SAMPLES], line.step_s * np.arange(SAMPLES)
        excitation = Excitation("self_sensing", line.initial_state, line.step_s, drive_V, order, substeps=8)
        signal = plant.signal(excitation) + 0.02 * rng.standard_normal(SAMPLES)
        yield Recording(
            f"r{order}", time_s, drive_V, signal, "V", "self_sensing", initial_state=line.initial_state, order=order
        )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The user's folder: my_effects.py beside a campaign that was recorded with it."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "my_effects.py").write_text(SOURCE)
    sys.path.insert(0, str(folder))
    try:
        from my_effects import QuadraticStiffness
    finally:
        sys.path.remove(str(folder))
    write_campaign(folder / "campaign", Campaign("lab", tuple(recorded(QuadraticStiffness()))))
    yield folder
    sys.modules.pop("my_effects", None)


@pytest.fixture(autouse=True)
def a_new_process(monkeypatch, folder):
    """As in a new process begun in the user's folder: nothing registered, the folder not searched."""
    monkeypatch.setattr(registry, "_registered", {})
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(folder)


@pytest.fixture(scope="module")
def augmented(folder):
    """What ``inkjet diagnose --effect`` writes; made once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_registered", {})
        patch.setattr(sys, "path", list(sys.path))
        patch.chdir(folder)
        files = ("--printhead-out", "augmented.json", "--json", "found.json", "--report", "report.html")
        assert run("diagnose", "campaign", "--effect", OWN, *files) == 0
    return folder / "augmented.json"


def found_code(file):
    """The digest of a single file of code."""
    code = sha256(Path(file).read_bytes()).hexdigest()
    return sha256(f"{Path(file).name}\0{code}\0".encode()).hexdigest()


def registered(file):
    """The head of a file whose class is registered now."""
    registry.register(sys.modules["my_effects"].QuadraticStiffness)
    return read_printhead(file)


def test_an_own_effect_is_tried_beside_the_catalogue_and_named(augmented):
    found = json.loads(augmented.with_name("found.json").read_text())
    assert (found["verdict"], [effect["id"] for effect in found["effects"]]) == ("named", ["quadratic_stiffness"])
    assert found["effects"][0]["parameters"]["asymmetry_per_V"]["value"] == pytest.approx(ASYMMETRY_PER_V, rel=0.05)
    assert found["fit"]["closure"] > 0.95
    assert {"cubic_stiffness", "quadratic_stiffness"} <= {a["ids"][0] for a in found["attributions"]}
    report = augmented.with_name("report.html").read_text()
    assert "The head is stiffer on one side" in report
    source = sys.modules["my_effects"].__file__
    own = {"place": OWN, "package": "none"}
    assert found["plugins"] == {"effect quadratic_stiffness": own | {"code": found_code(source)}}
    assert found_code(source)[:12] in report
    assert "Sets it apart: ." not in report  # nothing is said of what the class does not declare


def test_the_file_names_its_class_and_is_read_where_that_is_registered(augmented):
    (entry,) = json.loads(augmented.read_text())["effects"]
    assert (entry["id"], entry["class"]) == ("quadratic_stiffness", OWN)
    with pytest.raises(ValueError, match=f"augmented.json: effect 'quadratic_stiffness' is of the class {OWN}"):
        read_printhead(augmented)
    ((effect, values),) = registered(augmented).effects
    assert (effect.id, values) == (
        "quadratic_stiffness",
        {"asymmetry_per_V": entry["parameters"]["asymmetry_per_V"]["value"]},
    )


def test_simulate_shows_it(augmented, tmp_path):
    out = tmp_path / "simulation.json"
    given = ("--waveform", *WAVEFORM, "--printhead", augmented, "--effect", OWN, "--json", out)
    assert run("simulate", *given) == 0
    assert json.loads(out.read_text())["peaks_V"] == registered(augmented).respond(Waveform(*WAVEFORM)).peaks_V.tolist()


def test_the_command_in_a_process_of_its_own_finds_the_current_folder(augmented, folder, tmp_path):
    command = "from inkjet_env.experiments.cli import main; main()"
    given = [*map(str, WAVEFORM), "--printhead", "augmented.json", "--effect", OWN, "--json", str(tmp_path / "s.json")]
    # -P: as with the installed command, the current folder is not searched to begin with
    ran = subprocess.run(
        [sys.executable, "-P", "-c", command, "simulate", "--waveform", *given],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    shown = json.loads((tmp_path / "s.json").read_text())["peaks_V"]
    assert shown == pytest.approx(registered(augmented).respond(Waveform(*WAVEFORM)).peaks_V, rel=1e-9)


def test_optimize_finds_a_waveform_for_it_and_goes_on_from_a_record(augmented, tmp_path, capsys):
    from inkjet_env.experiments.benchmark.problem import Problem
    from inkjet_env.experiments.benchmark.single_run import Optimisation, write_record

    found, out = tmp_path / "optimum.json", tmp_path / "optimum.csv"
    small = ("--particles", 4, "--generations", 2, "--window", 2e-4)
    assert run("optimize", *small, "--printhead", augmented, "--effect", OWN, "--json", found, "--out", out) == 0
    optimum, head = json.loads(found.read_text()), registered(augmented)
    assert optimum["cost"] == head.costs([optimum["waveform"]], window_s=2e-4)[0]

    plan = Optimisation(Problem("custom", head), "random", 6, 3, {})
    whole = plan.carry_out()
    write_record(tmp_path / "record.npz", plan, whole)
    registry._registered.clear()
    resumed = ("optimize", "--resume", tmp_path / "record.npz", "--json", found, "--out", out)
    assert run(*resumed) == 2
    assert f"record.npz: effect 'quadratic_stiffness' is of the class {OWN}" in capsys.readouterr().err
    assert run(*resumed, "--effect", OWN) == 0
    assert json.loads(found.read_text())["cost"] == whole.best_cost


def test_an_interrupted_run_tells_the_effect_in_the_command_that_goes_on(augmented, tmp_path, capsys, monkeypatch):
    from inkjet_env.plant.augmented import AugmentedPrinthead

    costs, calls = AugmentedPrinthead.costs, []

    def interrupted(self, *given, **options):
        calls.append(1)
        if len(calls) > 1:
            raise KeyboardInterrupt
        return costs(self, *given, **options)

    monkeypatch.setattr(AugmentedPrinthead, "costs", interrupted)
    given = ("--particles", 4, "--generations", 3, "--printhead", augmented, "--effect", OWN)
    assert run("optimize", *given, "--out", tmp_path / "o.csv") == 130
    assert capsys.readouterr().err.strip().splitlines()[-1].endswith(f"--effect {OWN}")


def test_evaluate_takes_it_along(augmented, tmp_path):
    out = tmp_path / "evaluation.json"
    assert run("evaluate", "campaign", "--printhead", augmented, "--effect", OWN, "--json", out) == 0
    HEAD.to_json(tmp_path / "base.json")
    base = tmp_path / "base-evaluation.json"
    assert run("evaluate", "campaign", "--printhead", tmp_path / "base.json", "--json", base) == 0
    assert json.loads(out.read_text())["rms"] < 0.2 * json.loads(base.read_text())["rms"]


def test_the_environment_takes_its_file(augmented):
    head = registered(augmented)
    env = gymnasium.make(f"{inkjet_env.__name__}/BipolarWaveform-v0", printhead=augmented)
    env.reset(seed=1)
    _, reward, terminated, _, info = env.step(env.action_space.sample())
    assert terminated
    assert reward == pytest.approx(-head.costs([info["waveform"]])[0], rel=1e-12)


@pytest.mark.parametrize("command", ["simulate", "optimize", "evaluate"])
def test_without_the_option_a_command_refuses_the_file_in_one_sentence(augmented, command, capsys):
    given = {"simulate": ("--waveform", *WAVEFORM), "optimize": (), "evaluate": ("campaign",)}[command]
    assert run(command, *given, "--printhead", augmented) == 2
    told = capsys.readouterr().err.strip().splitlines()[-1]  # before it, perhaps, that the simulator is compiled
    assert told.startswith("inkjet: ")
    assert f"augmented.json: effect 'quadratic_stiffness' is of the class {OWN}, which is not registered here" in told
    assert f'on the command line "--effect {OWN}"' in told


@pytest.mark.parametrize(
    ("named", "message"),
    [
        (
            "my_effects",
            "no installed package offers an effect of this name. Offered: none. For a class in a file, give",
        ),
        (":QuadraticStiffness", "must have the form module:Class, such as my_lab:Annealing"),
        ("creep", "it is in the catalogue, whose effects are always looked for"),
        ("my_effects.py:QuadraticStiffness", "there is no module my_effects.py in"),
        ("nowhere:Own", "there is no module nowhere in"),
        ("nowhere.at.all:Own", "there is no module nowhere.at.all in"),
        ("my_effects:QuadraticStifness", "Did you mean 'QuadraticStiffness'?"),
        ("my_effects:TABLE", "must be a subclass of inkjet_env.plant.Effect; got {'k': 1}"),
        ("my_effects:Effect", "must be a subclass of inkjet_env.plant.Effect"),
        ("my_effects:NeedsANumber", "cannot be made without arguments: TypeError: "),
        ("my_effects:TakesAnId", "my_effects:TakesAnId has the id 'creep' of an effect in the catalogue"),
        ("broken:Own", "the module broken cannot be imported: ZeroDivisionError: division by zero ("),
        ("unclosed:Own", "the module unclosed cannot be imported: SyntaxError: "),
        ("needy:Own", "the module needy cannot be imported: ModuleNotFoundError: No module named 'not_installed' ("),
        ("leaving:Own", "the module leaving cannot be imported: SystemExit: 3 ("),
        ("json:Own", "json/__init__.py; it defines dump"),
    ],
)
def test_an_effect_that_cannot_be_had_is_refused_in_one_sentence(tmp_path, monkeypatch, capsys, named, message):
    for name, text in {
        "my_effects": SOURCE,
        "broken": "\nk = 1 / 0\n",
        "unclosed": "def own(:\n",
        "needy": "import not_installed\n",
        "leaving": "raise SystemExit(3)\n",
    }.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_effects", raising=False)  # as in a new process
    assert run("simulate", "--waveform", *WAVEFORM, "--effect", named) == 2
    (told,) = capsys.readouterr().err.strip().splitlines()
    assert told.startswith(f"inkjet: --effect {named}: ")
    assert message in told


def test_a_message_of_a_module_names_file_and_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "late.py").write_text("import math\n\nk = math.sqrt(-1)\n")
    monkeypatch.chdir(tmp_path)
    assert run("evaluate", "campaign", "--effect", "late:Own") == 2
    assert f"ValueError: math domain error ({tmp_path / 'late.py'}, line 3)" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["simulate", "optimize", "evaluate", "diagnose"])
def test_help_has_an_example_of_an_own_effect(command, capsys):
    assert run(command, "--help") == 0
    assert f"--effect {OWN}" in " ".join(capsys.readouterr().out.split())


def test_the_signal_of_the_own_effect_differs_from_the_base_models(augmented):
    head = registered(augmented)
    base = head.printhead.respond(Waveform(*WAVEFORM))
    assert np.abs(head.respond(Waveform(*WAVEFORM)).peaks_V[:5] - base.peaks_V[:5]).max() > 0.05
