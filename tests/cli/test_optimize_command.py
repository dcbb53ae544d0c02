"""``inkjet optimize``: what it writes, refuses and keeps when it is stopped."""

import json
import shlex
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from inkjet_env.cli.exit_status import INTERRUPTED
from inkjet_env.printhead import DriverLimits
from inkjet_env.recordings.drive import read_drive

COMMAND = [sys.executable, "-m", "inkjet_env.experiments.cli"]


def test_optimize_writes_a_waveform_for_a_generator_and_the_promised_json(inkjet, tmp_path):
    status, _out, _ = inkjet(
        *("optimize", "--optimizer", "pso", "--particles", "20", "--generations", "10", "--seed", "3"),
        *("--out", "w.csv", "--json", "o.json", "--plot", "w.svg", "--sample-rate", "1e8"),
    )
    assert status == 0
    found = json.loads((tmp_path / "o.json").read_text())
    assert found["format"] == "optimum/1"
    assert (found["evaluations"], found["seed"], len(found["waveform"])) == (200, 3, 7)
    assert found["history"][-1] == [200, found["cost"]]
    assert [h[1] for h in found["history"]] == sorted((h[1] for h in found["history"]), reverse=True)
    time_s, drive_V = np.loadtxt(tmp_path / "w.csv", delimiter=",", skiprows=1).T
    assert drive_V[0] == drive_V[-1] == 0.0
    np.testing.assert_allclose(np.diff(time_s), 1e-8, rtol=1e-6)
    assert sum(found["waveform"][2:]) <= time_s[-1] <= sum(found["waveform"][2:]) + 1e-8
    again = json.loads(inkjet("simulate", "--waveform", *found["waveform"], "--json", "-")[1])
    assert again["cost"] == pytest.approx(found["cost"], abs=1e-7)
    sampled = json.loads(inkjet("simulate", "--drive", "w.csv", "--json", "-")[1])
    assert sampled["peaks_V"][0] == pytest.approx(again["peaks_V"][0], rel=0.02)


def test_same_seed_same_bytes_other_seed_other_bytes(inkjet, tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        inkjet(
            "optimize", "--optimizer", "random", "--budget", 50, "--seed", seed, "--json", name, "--out", f"{name}.csv"
        )
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b != c
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--optimizer", "psoo"], "no optimiser 'psoo'. Did you mean 'pso'?"),
        (["--problem", "nominl"], "Did you mean 'nominal'?"),
        (["--budget", "0"], "--budget must be at least 1; got 0"),
        (["--seed", "-1"], "--seed must be at least 0; got -1"),
        (["--budget", "100", "--generations", "2"], "--generations or --budget, not both"),
        (["--optimizer", "random", "--particles", "3"], "--particles and --generations apply to pso"),
        (["--sample-rate", "1"], "--sample-rate must be 1e7 to 1e11 Hz"),
        (["--resume", "none.npz"], "none.npz: there is no such file"),
        (["--resume", "none.npz", "--seed", "1"], "leave out --seed"),
        (["--resume", "none.npz", "--limits", "bits=3"], "leave out --limits"),
        (["--out", "-"], 'only --json accepts "-"'),
        (["--out", "a.csv", "--json", "a.csv"], "must be different files"),
    ],
)
def test_bad_optimize_is_one_sentence_and_status_2(inkjet, tmp_path, arguments, said):
    status, out, err = inkjet("optimize", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err
    assert list(tmp_path.iterdir()) == []


LIMITS = "lowest_V=-50,highest_V=60,rise_V_per_us=20,fall_V_per_us=15,step_us=0.1,longest_us=40,bits=10"


def test_within_a_drivers_limits_the_best_waveform_is_legal_and_what_that_costs_is_told(inkjet, tmp_path):
    arguments = ["optimize", "--optimizer", "cma-es", "--budget", "600", "--json", "o.json", "--limits", LIMITS]
    status, out, err = inkjet(*arguments, "--out", "w.ini")
    assert status == 0
    assert "warning" not in err
    found = json.loads((tmp_path / "o.json").read_text())
    assert found["limits"]["bits"] == 10
    assert found["cost_without_limits"] < found["cost"] - 1.0
    assert f"they cost {found['cost'] - found['cost_without_limits']:.6f} V" in out
    drive = read_drive(tmp_path / "w.ini")
    assert DriverLimits.from_text(LIMITS).excesses(drive.time_s, drive.drive_V) == []
    assert json.loads(inkjet("simulate", "--drive", "w.ini", "--limits", LIMITS, "--json", "-")[1])["cost"] == (
        pytest.approx(found["cost"], abs=1e-6)
    )


def test_limits_that_leave_no_waveform_are_one_sentence(inkjet):
    status, out, err = inkjet("optimize", "--limits", "longest_us=4")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "the shortest waveform of the search box lasts 5 us" in err


@pytest.mark.parametrize("limits", [[], ["--limits", LIMITS]], ids=["any driver", "a driver with limits"])
def test_an_interrupted_optimisation_keeps_its_best_and_goes_on_exactly(inkjet, tmp_path, monkeypatch, limits):
    arguments = ["optimize", "--optimizer", "cma-es", "--budget", "300", "--seed", "5", *limits]
    files = ["--sample-rate", "2.5e7", "--plot"]
    assert inkjet(*arguments, *files, "whole.png", "--out", "whole.csv", "--json", "whole.json")[0] == 0

    from inkjet_env.experiments.benchmark.problem import Problem

    evaluate, batches = Problem.evaluate, []

    def interrupted(self, points):
        batches.append(len(points))
        if len(batches) == 9:
            raise KeyboardInterrupt
        return evaluate(self, points)

    monkeypatch.setattr(Problem, "evaluate", interrupted)
    status, _out, err = inkjet(*arguments, *files, "my part.png", "--out", "my part.csv", "--json", "my part.json")
    assert status == INTERRUPTED
    assert "the best so far is kept" in err
    part = json.loads((tmp_path / "my part.json").read_text())
    assert 0 < part["evaluations"] == sum(batches[:-1]) < 300
    assert part["complete"] is False
    assert (tmp_path / "my part.csv").exists()

    batches.extend([0] * 9)  # no more interruptions
    (tmp_path / "my part.png").unlink()
    command, *told = shlex.split(err.partition("To resume: ")[2])
    assert command == "inkjet"
    assert inkjet(*told)[0] == 0
    for ending in ("json", "csv", "png"):
        assert (tmp_path / f"my part.{ending}").read_bytes() == (tmp_path / f"whole.{ending}").read_bytes()


def test_a_damaged_record_is_named(inkjet, tmp_path):
    (tmp_path / "part.csv.evaluations.npz").write_bytes(b"PK\x03\x04 not an archive")
    status, _, err = inkjet("optimize", "--resume", "part.csv.evaluations.npz")
    assert status == 2
    assert "part.csv.evaluations.npz: is not a complete record of an optimisation" in err


def _heed_signals():
    """A shell's background job ignores SIGINT, and one that outlives its terminal SIGHUP."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@pytest.mark.parametrize("signals", [["SIGINT"], ["SIGHUP"], ["SIGINT", "SIGINT"], ["SIGTERM", "SIGINT"]])
def test_whatever_interrupts_a_running_process_its_best_is_written(tmp_path, signals):
    arguments = ["optimize", "--optimizer", "cma-es", "--budget", "1000000", "--out", "w.csv"]
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_heed_signals,
    )
    assert any("cma-es" in line for line in process.stderr)  # it may have compiled the simulator first
    time.sleep(0.3)
    for name in signals:
        process.send_signal(getattr(signal, name))
        time.sleep(0.02)
    _out, err = process.communicate(timeout=30)
    assert process.returncode == INTERRUPTED, err
    assert "the best so far is kept" in err
    assert "Traceback" not in err
    assert {f.name for f in tmp_path.iterdir()} == {"w.csv", "w.csv.evaluations.npz"}
