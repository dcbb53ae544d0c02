"""A diagnosis that was interrupted goes on where it was, to the same end."""

import importlib
import itertools
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import clear_checkpoint, diagnose
from inkjet_env.mismatch.fitting.checkpoint import FitCheckpoint, _of_joint

attribute = importlib.import_module("inkjet_env.mismatch.selection.hypotheses")
DAMAGED = ('{"fit": {"end": 3}}', "", "[", "{}")
LOOKED_FOR = ("cubic_stiffness", "quadratic_damping", "feedthrough", "mains_hum")


class Stopped(Exception):
    """Instead of Ctrl-C."""


@pytest.fixture(scope="module")
def run(recorded, head, effects):
    """A function: the verdict, with finished fits kept in a folder; stopped at a step of that name."""

    def run(keep, stop_at=None, name="cubic_stiffness", free=False):
        steps = []

        def progress(step):
            steps.append(step)
            if stop_at is not None and stop_at in step:
                raise Stopped

        campaign = recorded(name)
        if free:  # ringing from an earlier pulse
            chosen = [replace(r, initial_state="free") if r.name == "r002" else r for r in campaign.recordings]
            campaign = replace(campaign, recordings=tuple(chosen))
        found = diagnose(
            campaign, head, [effects[e] for e in LOOKED_FOR], 0, workers=1, progress=progress, checkpoint=keep
        ).as_json()
        found.pop("seconds", None)
        found.pop("stages", None)
        return found, steps

    return run


@pytest.fixture(scope="module")
def whole(run):
    """The verdict of a diagnosis in one piece."""
    return run(None)[0]


@pytest.fixture(scope="module")
def stopped(run, tmp_path_factory):
    """The fits of a diagnosis that was stopped before it refined them."""
    folder = tmp_path_factory.mktemp("stopped") / "fits"
    with pytest.raises(Stopped):
        run(folder, "refining")
    return folder


@pytest.fixture
def fits(stopped, tmp_path):
    """A copy of them."""
    return shutil.copytree(stopped, tmp_path / "fits")


def timeless(found):
    return json.dumps({key: value for key, value in found.items() if key not in ("seconds", "stages", "timing")})


def test_an_interrupted_diagnosis_ends_as_if_it_had_not_been(run, whole, fits, monkeypatch):
    files = sorted(fits.iterdir())
    assert len(files) >= 4
    assert {file.suffix for file in files} == {".json"}
    again = []
    tried = attribute.tried_from

    def noted(*question, **how):
        again.append(question)
        return tried(*question, **how)

    monkeypatch.setattr(attribute, "tried_from", noted)
    resumed, _ = run(fits)
    assert timeless(resumed) == timeless(whole)
    assert all(len(question) < 5 for question in again)  # none of the first steps was done twice
    assert fits.exists()  # until the result is kept
    clear_checkpoint(fits)
    assert not fits.exists()


def test_free_initial_states_go_on_too(run, tmp_path):
    whole, _ = run(None, free=True)
    with pytest.raises(Stopped):
        run(tmp_path / "fits", "refining", free=True)
    assert timeless(run(tmp_path / "fits", free=True)[0]) == timeless(whole)


def test_other_recordings_find_no_fits_of_these(run, fits):
    whole, _ = run(None, name="feedthrough")
    assert timeless(run(fits, name="feedthrough")[0]) == timeless(whole)


@pytest.mark.parametrize("part", ["models", "levels", "offsets"])
def test_another_noise_has_other_fits(recorded, fitted, part):
    joint = fitted(recorded("feedthrough"))
    o = joint.observed[0]
    other = {
        "models": {key: replace(model, innovation=2 * model.innovation) for key, model in joint.noise.models.items()},
        "levels": {o.name: np.full(o.excitation.samples, 2.0)},
        "offsets": {o.channel: 0.01},
    }
    changed = joint.anew(noise=replace(joint.noise, **{part: other[part]}), base=joint.base)
    assert _of_joint(joint.anew(base=joint.base)) == _of_joint(joint.anew(base=joint.base))
    assert _of_joint(changed) != _of_joint(joint.anew(base=joint.base))


def test_damaged_fits_are_made_anew(run, whole, fits):
    """Each in another way."""
    files = sorted(fits.iterdir())
    assert len(files) >= len(DAMAGED)
    for file, damaged in zip(files, itertools.cycle(DAMAGED), strict=False):
        file.write_text(damaged)
    assert timeless(run(fits)[0]) == timeless(whole)


TYPED = """
import numpy as np
from inkjet_env.plant import Effect, Parameter

LATE = {"none", "some"}

def summed(signal, step_s):
    return step_s * np.cumsum(signal - signal.mean())

class Leak(Effect):
    id, stage = "leak", "sensing"
    sentence = "The sensor's integrator leaks into its output."
    equation, source, signature, shown_by = "y = y0 + k int y0 dt", "a test", "a slope", "any pulse"
    parameters = (Parameter("leak_per_s", "1/s", -1e6, 1e6),)
    strengths = ("leak_per_s",)

    def starts(self, printhead, shots):
        return [{"leak_per_s": factor * printhead.frequency_Hz} for factor in (0.05,)]

    def sensing(self, values, signal, drive_V, printhead, shot):
        if shot.channel != "self_sensing" or shot.channel in {"strain_gauge", "displacement"}:
            return signal
        return signal + values["leak_per_s"] * summed(signal, shot.step_s)
"""
"""As typed at a console: of no module that was imported, in no file."""


def typed(old="", new="", module="__main__"):
    """An effect of that code, with some of it changed."""
    assert old in TYPED
    source, names = TYPED.replace(old, new) if old else TYPED, {"__name__": module}
    exec(compile(source, "<stdin>", "exec"), names)
    return names["Leak"]()


def test_a_diagnosis_with_an_effect_typed_at_a_console_goes_on(recorded, head, effects, tmp_path):
    def run(effect, stop_at=None):
        def progress(step):
            if stop_at is not None and stop_at in step:
                raise Stopped

        looked_for = [effects["cubic_stiffness"], effect]
        return diagnose(recorded("cubic_stiffness"), head, looked_for, 0, workers=1, progress=progress,
                        checkpoint=tmp_path / "fits").as_json()  # fmt: skip

    def console():
        return typed(module="console")

    whole = run(console())
    with pytest.raises(Stopped):
        run(console(), "refining")
    begun = {file.name for file in (tmp_path / "fits").iterdir()}
    with pytest.raises(Stopped):
        run(console(), "refining")
    assert {file.name for file in (tmp_path / "fits").iterdir()} == begun  # found, and not made anew
    assert timeless(run(console())) == timeless(whole)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("signal + values", "signal - values"),  # an instruction
        ("0.05", "0.06"),  # a constant of a function inside
        ("signal.mean()", "signal[0]"),  # a function that is used
        ("-1e6, 1e6", "-1e6, 2e6"),  # an attribute
        ('"strain_gauge", "displacement"', '"strain_gauge", "drive_monitor"'),
        ('("leak_per_s",)', '("leak_per_s", "other")'),
        ("strengths =", "plain_leaves = 0.5; strengths ="),
    ],
)
def test_code_that_was_typed_is_told_from_other_code(old, new, tmp_path):
    assert FitCheckpoint(tmp_path, [typed()]).code == FitCheckpoint(tmp_path, [typed()]).code
    assert FitCheckpoint(tmp_path, [typed()]).code != FitCheckpoint(tmp_path, [typed(old, new)]).code


def test_what_an_effect_holds_counts(tmp_path):
    one, other = typed(), typed()
    one.scale, other.scale = np.array([1.0]), np.array([2.0])
    assert FitCheckpoint(tmp_path, [one]).code != FitCheckpoint(tmp_path, [other]).code


def test_typed_code_is_told_alike_in_every_process(tmp_path):
    script = TYPED + (
        "from inkjet_env.mismatch.fitting.checkpoint import FitCheckpoint\n"
        "import sys\nprint(FitCheckpoint(sys.argv[1], [Leak()]).code.hex())\n"
    )
    told = set()
    for seed in ("1", "2"):
        command, environment = [sys.executable, "-", str(tmp_path)], os.environ | {"PYTHONHASHSEED": seed}
        ended = subprocess.run(command, input=script, text=True, capture_output=True, check=True, env=environment)
        told.add(ended.stdout)
    assert len(told) == 1


def test_only_fits_are_cleared_away(tmp_path):
    checkpoint = FitCheckpoint(tmp_path)
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "0.fit.json").write_text("{}")
    checkpoint.clear()
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]
