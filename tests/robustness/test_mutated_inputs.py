"""The fuzzer: damaged inputs are used or refused in plain words, and what it counts as a failure is one."""

import subprocess
import sys

import numpy as np
import pytest

from inkjet_env.experiments.robustness import mutated_inputs
from inkjet_env.experiments.robustness.damage import damage_numbers
from inkjet_env.experiments.robustness.mutated_inputs import (
    KINDS,
    Kind,
    is_plain,
    outcome_of,
    small_campaign,
    write_scope_files,
)
from inkjet_env.recordings import read_campaign


@pytest.mark.parametrize(("kind", "count"), [("campaign", 120), ("drive", 60), ("printhead", 25), ("record", 40)])
def test_damaged_inputs_are_used_or_refused(kind, count):
    outcomes = [outcome_of(kind, seed) for seed in range(count)]
    assert not [outcome.told for outcome in outcomes if outcome.kind == "failed"]
    assert any(outcome.kind == "refused" for outcome in outcomes)


@pytest.mark.parametrize(("kind", "seed"), [("record", 111), ("results", 91), ("results", 114)])
def test_what_once_failed_is_refused(kind, seed):
    """An archive's own bytes in a message, a pipe in place of a file, a sentence of the interpreter's."""
    outcome = outcome_of(kind, seed)
    assert outcome.kind == "refused", outcome.told


def test_the_command_works_with_several_processes():
    command = [sys.executable, "-m", "inkjet_env.experiments.robustness.mutated_inputs", "drive"]
    done = subprocess.run([*command, "--count", "4", "--workers", "2"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "failed" not in done.stdout


@pytest.mark.parametrize("kind", KINDS)
def test_an_undamaged_input_is_used(kind, monkeypatch):
    for name in ("damage", "damage_numbers"):
        monkeypatch.setattr(mutated_inputs, name, lambda *_: None)
    outcome = outcome_of(kind, 0)
    assert outcome.kind == "used", outcome.told


def test_damaged_samples_can_still_be_read(tmp_path):
    rng = np.random.default_rng(0)
    original = small_campaign(rng)
    different = 0
    for seed in range(20):
        folder = tmp_path / str(seed)
        folder.mkdir()
        write_scope_files(folder, original, rng)
        damage_numbers(folder, rng)
        read = read_campaign(folder, channel="self_sensing")
        different += any(
            np.ptp(a.sensor - b.sensor) > 1e-6 or np.ptp(a.drive_V - b.drive_V) > 1e-6
            for a, b in zip(read.recordings, original.recordings, strict=True)
        )
    assert different > 15


def raising(error):
    def use(_):
        raise error

    return use


def leaving(folder):
    (folder / "input" / "x.csv.1.unfinished").touch()


def warning(_):
    np.log(np.zeros(1))


def hanging(_):
    while True:
        pass


@pytest.mark.parametrize(
    ("use", "told"),
    [
        (raising(KeyError("x")), "KeyError"),
        (raising(ValueError("'utf-8' codec can't decode byte 0xff in position 3.")), "not plain"),
        (raising(ValueError("x.csv: holds no numbers.\nTry again.")), "not plain"),
        (leaving, "was left behind"),
        (warning, "RuntimeWarning"),
        (hanging, "took more than"),
    ],
)
def test_what_is_handled_wrongly_is_a_failure(monkeypatch, use, told):
    monkeypatch.setitem(KINDS, "campaign", Kind(KINDS["campaign"].make, use, 0.5))
    outcome = outcome_of("campaign", 1)
    assert outcome.kind == "failed"
    assert told in outcome.told


def test_words_in_quotes_are_the_users():
    assert is_plain("r.csv, row 3: time must be a number; got 'codec'. Use a point.")
    assert not is_plain("r.csv, row 3: the codec failed.")
