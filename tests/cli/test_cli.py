import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from inkjet_env.cli.simulate import _drawn_samples
from inkjet_env.experiments.benchmark.ranking_tables import print_ranking
from inkjet_env.optimizers import registry
from inkjet_env.printhead import Printhead, Waveform, respond_sampled

OPTIMUM = ["100", "-100", "1e-6", "10.481e-6", "13.769e-6", "9.613e-6", "20e-6"]
COMMAND = [sys.executable, "-m", "inkjet_env.experiments.cli"]


def a_drive(path, rows=("0,0", "1e-6,100", "2e-6,-50", "4e-6,0"), header="time_s,drive_V"):
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_simulate_prints_and_writes_peaks_and_cost(inkjet, tmp_path):
    status, out, _ = inkjet("simulate", "--waveform", *OPTIMUM, "--json", "s.json", "--plot", "s.png")
    assert status == 0
    assert "effective" in out
    assert "cost -22.83" in out
    found = json.loads((tmp_path / "s.json").read_text())
    assert list(found)[:5] == ["format", "peaks_V", "peak_times_s", "effective_peak", "cost"]
    assert found["settling_s"] == pytest.approx(52.13e-6, abs=1e-8)
    assert found["highest_drop_frequency_Hz"] == pytest.approx(1 / 54.863e-6, rel=1e-4)  # the waveform is longer
    assert "27.4 % of the effective peak; below 5 % after 52.13 µs, so drops can follow at up to 18.23 kHz." in out
    assert "32 later peaks, the largest" in out
    assert found["format"] == "simulation/1"
    assert found["effective_peak"] == 1
    assert found["cost"] == pytest.approx(-22.830, abs=1e-3)
    np.testing.assert_allclose(found["peaks_V"][:4], [6.19, -6.94, 0.65, -0.52], atol=0.01)
    assert found["peak_times_s"] == sorted(found["peak_times_s"])
    assert (tmp_path / "s.png").read_bytes().startswith(b"\x89PNG")


def test_json_on_standard_output_is_nothing_but_json(inkjet):
    status, out, _ = inkjet("simulate", "--waveform", *OPTIMUM, "--json", "-", "--effective", "20")
    assert status == 0
    assert json.loads(out)["effective_peak"] is None


def test_cost_and_window_options_change_the_cost_as_they_should(inkjet):
    def cost(*options):
        return json.loads(inkjet("simulate", "--waveform", *OPTIMUM, "--json", "-", *options)[1])

    usual, first = cost(), cost("--effective", "first", "--cost-a", "-10", "--cost-b", "1")
    magnitudes = np.abs(usual["peaks_V"])
    assert first["cost"] == pytest.approx(-10 * magnitudes[0] + magnitudes[1:].sum())
    short = cost("--window", "30e-6")
    assert max(short["peak_times_s"]) <= 30e-6 < max(usual["peak_times_s"])
    assert cost("--window", "inf")["cost"] == pytest.approx(usual["cost"], abs=1e-2)


def test_drops_that_follow_start_in_the_ringing_of_those_before(inkjet):
    head, waveform = Printhead.published(), Waveform.from_array([float(v) for v in OPTIMUM])
    found = json.loads(inkjet("simulate", "--waveform", *OPTIMUM, "--json", "-", "--drop-frequency", "15e3")[1])
    np.testing.assert_allclose(found["peaks_V"], head.respond(waveform, period_s=1 / 15e3).peaks_V, rtol=1e-12)
    status, _, err = inkjet("simulate", "--waveform", *OPTIMUM, "--drop-frequency", "25e3")
    assert (status, "the waveform takes 54.86 µs. Give at most 1.823e+04 Hz." in err) == (2, True)
    assert inkjet("simulate", "--waveform", *OPTIMUM, "--drop-frequency", "-1")[0] == 2


def test_a_search_at_a_drop_frequency_for_a_wanted_height_costs_what_the_same_simulation_does(inkjet):
    wanted = ("--drop-frequency", "20e3", "--target-height", "4", "--cost-a", "-50", "--json", "-")
    status, out, err = inkjet("optimize", "--budget", "400", "--out", "w.csv", *wanted)
    assert (status, "at most 10 µs, so that every waveform fits into 50 µs." in err) == (0, True)
    found = json.loads(out)
    again = json.loads(inkjet("simulate", "--waveform", *map(repr, found["waveform"]), *wanted)[1])
    assert again["cost"] == pytest.approx(found["cost"], abs=1e-9)
    assert again["settling_s"] == found["settling_s"] > 0
    assert found["cost"] > -200  # four volts count, and no more


def test_a_wanted_height_of_a_problem_survives_another_weight(inkjet):
    _, out, _ = inkjet("optimize", "--problem", "drop-4V", "--cost-a", "-51", "--budget", "200", "--json", "-")
    assert json.loads(out)["cost"] >= -204


def test_a_sampled_drive_gives_the_response_of_the_same_waveform(inkjet, tmp_path):
    drive = a_drive(tmp_path / "d.csv", [f"{t!r},{u!r}" for t, u in knots()])
    status, _, _ = inkjet("simulate", "--drive", drive, "--out", "r.csv", "--json", "r.json")
    assert status == 0
    assert (tmp_path / "r.csv").read_text().splitlines()[0] == "time_s,drive_V,sensor_V"
    assert np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1).shape == (6, 3)
    whole = json.loads(inkjet("simulate", "--waveform", *OPTIMUM, "--json", "-")[1])
    sampled = json.loads((tmp_path / "r.json").read_text())
    np.testing.assert_allclose(sampled["peaks_V"], whole["peaks_V"], atol=1e-9)
    assert sampled["cost"] == pytest.approx(whole["cost"], abs=1e-9)
    assert sampled["settling_s"] == pytest.approx(whole["settling_s"], abs=0.2e-6)


def test_a_drive_file_at_a_drop_frequency_gives_the_response_of_the_same_waveform(inkjet, tmp_path):
    drive = a_drive(tmp_path / "d.csv", [f"{t!r},{u!r}" for t, u in knots()])
    command = ("--drop-frequency", "15e3", "--json", "-")
    whole = json.loads(inkjet("simulate", "--waveform", *OPTIMUM, *command)[1])
    sampled = json.loads(inkjet("simulate", "--drive", drive, *command)[1])
    np.testing.assert_allclose(sampled["peaks_V"], whole["peaks_V"], atol=1e-9)
    assert sampled["cost"] == pytest.approx(whole["cost"], abs=1e-9)
    assert sampled["settling_s"] == pytest.approx(whole["settling_s"], abs=0.2e-6)  # of a single drop
    status, _, err = inkjet("simulate", "--drive", drive, "--drop-frequency", "25e3")
    assert status == 2
    assert "25000 Hz leaves 40 µs a drop; d.csv takes 54.86 µs. Give at most 1.823e+04 Hz." in err.replace(
        str(tmp_path) + "/", ""
    )


@pytest.mark.parametrize("period_s", [math.inf, 1 / 15e3])
def test_the_picture_of_a_file_of_corners_passes_through_every_peak(period_s):
    head, (time_s, drive_V) = Printhead.published(), np.array(list(knots())).T
    fine = _drawn_samples(time_s, drive_V, head.frequency_Hz, 350e-6, period_s)
    drawn = respond_sampled(head, *fine, window_s=350e-6, period_s=period_s)
    corners = respond_sampled(head, time_s, drive_V, window_s=350e-6, period_s=period_s)
    np.testing.assert_allclose(drawn.peaks_V, corners.peaks_V, atol=1e-9)
    inside = drawn.peak_times_s < drawn.time_s[-1]
    assert inside.all() or math.isfinite(period_s)
    line_V = np.interp(drawn.peak_times_s, drawn.time_s, drawn.sensor_V)
    assert np.abs(line_V - drawn.peaks_V)[inside].max() < 0.01 * np.abs(drawn.peaks_V).max()
    assert _drawn_samples(*fine, head.frequency_Hz, 350e-6, 1 / 15e3) is None  # these are enough


def test_an_optimum_read_back_as_a_drive_costs_the_same(inkjet):
    _, out, _ = inkjet(
        "optimize", "--optimizer", "pso", "--seed", "5", "--out", "w.csv", "--json", "-", "--budget", "400"
    )
    _, again, _ = inkjet("simulate", "--drive", "w.csv", "--json", "-")
    assert json.loads(again)["cost"] == pytest.approx(json.loads(out)["cost"], abs=0.02)  # corners are cut by 10 ns


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("pipe", "must be a writable folder, and pipe a regular file."),
        ("folder", "must be a writable folder, and folder a regular file."),
        ("drive.csv", "--out drive.csv would overwrite an input file."),
        ("link.csv", "--out link.csv would overwrite an input file."),
    ],
)
def test_what_is_no_file_or_is_read_itself_is_not_replaced(inkjet, tmp_path, name, said):
    drive = a_drive(tmp_path / "drive.csv")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link.csv").symlink_to(drive)
    before = drive.read_bytes()
    status, _, err = inkjet("simulate", "--drive", "drive.csv", "--out", name)
    assert status == 2
    assert said in err
    assert drive.read_bytes() == before
    assert (tmp_path / "pipe").is_fifo()


def test_a_link_is_followed_to_its_file(inkjet, tmp_path):
    (tmp_path / "link.json").symlink_to(tmp_path / "target.json")
    (tmp_path / "target.json").write_text("old")
    assert inkjet("simulate", "--waveform", *OPTIMUM, "--json", "link.json")[0] == 0
    assert (tmp_path / "link.json").is_symlink()
    assert "simulation/1" in (tmp_path / "target.json").read_text()


def test_version_is_told(inkjet):
    status, out, _ = inkjet("--version")
    assert (status, out.count(".")) == (0, 2)


def knots():
    durations = [float(v) for v in OPTIMUM[2:]]
    return zip([0.0, *np.cumsum(durations).tolist()], [0.0, 100.0, 100.0, -100.0, -100.0, 0.0], strict=True)


BAD_WAVEFORM = [
    (["--waveform", "1", "2"], "Option '--waveform' requires 7 arguments"),
    (["--waveform", *OPTIMUM[:6], "x"], "Invalid value for '--waveform'"),
    (["--waveform", "-1", *OPTIMUM[1:]], "U1 must be at least 0 V; got -1 V"),
    (["--waveform", "nan", *OPTIMUM[1:]], "U1 must be finite; got nan V"),
    ([], "give --waveform U1 U2 t1 t2 t3 t4 t5 or --drive FILE.csv"),
    (["--waveform", *OPTIMUM, "--drive", "d.csv"], "not both"),
    (["--waveform", *OPTIMUM, "--effective", "larges"], "--effective must be 'largest'.*Did you mean 'largest'"),
    (["--waveform", *OPTIMUM, "--initial-state", "virgin"], "--initial-state must be one of periodic, demagnetised"),
    (["--waveform", *OPTIMUM, "--hysteresis", "fullmemory"], "--hysteresis must be one of.*Did you mean 'full_memory'"),
    (["--waveform", *OPTIMUM, "--window", "0"], "--window must be a time above 0 s"),
    (["--waveform", *OPTIMUM, "--printhead", "none.json"], "none.json: cannot be read"),
    (["--waveform", *OPTIMUM, "--plot", "a.gif"], "must end in .png, .svg or .pdf; got '.gif'"),
    (["--waveform", *OPTIMUM, "--json", "nowhere/a.json"], "nowhere must be a writable folder"),
    (["--waveform", *OPTIMUM, "--out", "/proc/a.csv"], "/proc must be a writable folder"),
    (["--waveform", *OPTIMUM, "--wave"], "No such option: --wave"),
    (["--drive", "none.csv"], "none.csv: must be a file; there is none"),
    (["--waveform", *OPTIMUM, "--window", "350"], "at most 0.01 s, or infinite; got 350.*350 µs is 350e-6"),
    (["--waveform", *OPTIMUM, "--cost-a", "1e308"], "--cost-a must be a number within"),
]


@pytest.mark.parametrize(("arguments", "said"), BAD_WAVEFORM)
def test_bad_input_is_one_sentence_and_status_2(inkjet, tmp_path, arguments, said):
    status, out, err = inkjet("simulate", *arguments)
    assert (status, out) == (2, "")
    assert err.startswith("inkjet: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []
    import re

    assert re.search(said, err)


@pytest.mark.parametrize(
    ("header", "rows", "said"),
    [
        ("time,one,other", ("0,0,0", "1,1,0"), "the column of the drive is unknown; it could be: one, other"),
        (
            "time_s,drive_V",
            ("0,0", "1e-6,0", "1e-6,40"),
            "row 4: .*got 1e-06 s twice. For a vertical edge, put the second row",
        ),
        ("time_s,drive_V", ("0,0", "1e-6,4e4"), "the drive goes to 40000 V. Check the unit"),
        ("time_s,drive_V", ("0,0", "1e-6,abc"), "row 3: drive_V must be a number; got 'abc'"),
        ("time_s,drive_V", ("0,0", "1e-6,nan"), "row 3: drive_V must be finite; got 'nan'"),
        ("time_s,drive_V", ("0,0", "1e-6"), "row 3: must have 2 columns"),
        ("time_s,drive_V", ("0,0", "2e-6,1", "1e-6,0"), "row 4: time must increase.*Sort the rows"),
        ("time_s,drive_V", ("0,0",), "must have at least 2 samples; got 1"),
    ],
)
def test_a_damaged_drive_is_told_by_file_and_row(inkjet, tmp_path, header, rows, said):
    drive = a_drive(tmp_path / "drive.csv", rows, header)
    status, _, err = inkjet("simulate", "--drive", drive, "--out", "r.csv")
    assert status == 2
    import re

    assert re.search(f"drive.csv[,:].*{said}", err)
    assert not (tmp_path / "r.csv").exists()


def test_a_binary_drive_is_refused(inkjet, tmp_path):
    (tmp_path / "d.csv").write_bytes(bytes(range(256)))
    assert "is binary, not text" in inkjet("simulate", "--drive", "d.csv")[2]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--optimizers", "pso,cmaes"], "no optimiser 'cmaes'. Did you mean 'cma-es'?"),
        (["--problems", ""], "problems must name at least one"),
        (["--problems", "nominal,nominal"], "problems must not contain duplicates"),
        (["--repeats", "0"], "repeats must be at least 1; got 0"),
        (["--workers", "0"], "--workers must be at least 1"),
        (["--budget", "many"], "Invalid value for '--budget'"),
    ],
)
def test_bad_bench_is_one_sentence_and_status_2(inkjet, tmp_path, arguments, said):
    status, out, err = inkjet("bench", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_a_bench_of_optimisers_that_are_not_installed_says_which_package_is_missing(inkjet, monkeypatch):
    monkeypatch.setitem(sys.modules, "inkjet_env.optimizers.sb3_one_step", None)
    monkeypatch.delitem(sys.modules, "inkjet_env.optimizers.sb3_one_step")
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)  # importing it raises ModuleNotFoundError
    registry._fault.cache_clear()
    status, _, err = inkjet("bench", "--problems", "nominal", "--optimizers", "sb3-ppo", "--repeats", 1)
    registry._fault.cache_clear()
    assert status == 2
    reason = "sb3-ppo needs stable_baselines3, which is not installed: pip install 'inkjet-env[rl]'."
    assert err.splitlines()[-1].endswith(f"could be run, so there is nothing to compare. sb3-ppo: {reason}")


def test_bench_prints_ranking_sentences_and_report(inkjet, tmp_path):
    status, out, _ = inkjet(
        *("bench", "--problems", "nominal", "--optimizers", "pso,random", "--repeats", 2, "--budget", 80),
        *("--workers", 1, "--results", "r", "--json", "r.json"),
    )
    assert status == 0
    assert "mean rank" in out
    assert "has the best mean rank" in out
    assert "r/report.html" in out
    assert json.loads((tmp_path / "r.json").read_text()) == json.loads((tmp_path / "r" / "ranking.json").read_text())


def test_a_ranking_over_many_problems_fits_a_terminal(capsys):
    published = Path(__file__).parents[2] / "docs" / "comparison" / "ranking.json"
    ranking = json.loads(published.read_text(encoding="utf-8"))
    print_ranking(ranking)
    out = capsys.readouterr().out
    table = out[: out.index("Regret in the problems' scales")]
    assert "lbfgsb-multistart (on 21)" in table
    assert max(map(len, table.splitlines())) <= 80
    assert "…" not in table
    for row in ranking["standings"][str(ranking["settings"]["budget"])]["rows"]:
        assert f"{row['rank']:.2f}" in table


def test_help_imports_nothing_that_costs():
    code = (
        "import sys, inkjet_env.experiments.cli, inkjet_env.cli.app\n"
        "try: inkjet_env.cli.app.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print([m for m in ('numba', 'scipy', 'torch', 'nevergrad', 'matplotlib', 'pandas') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
