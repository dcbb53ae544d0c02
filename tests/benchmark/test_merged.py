"""Benches of several people: ranked together as each by itself, and refused where something was changed."""

import json
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.merged import merged
from inkjet_env.experiments.benchmark.run_files import DamagedResultError, RunKey, RunResult, label_of, write_run
from inkjet_env.experiments.benchmark.runner import run_bench
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.experiments.publish import leaderboard
from tests.benchmark.small_bench import small_settings

FOREIGN = "their_lab.search:Halving"
"""An optimiser that is not installed here."""


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    folder = tmp_path_factory.mktemp("benches") / "mine"
    run_bench(small_settings(problems=("nominal", "reading-50mV"), repeats=3), folder, workers=1)
    return folder


def write_bench(folder, optimizers, problems=("nominal", "reading-50mV"), **changes):
    """Somebody's bench: random points under the names of these optimisers."""
    settings = (
        small_settings(problems=problems, optimizers=("random",)).to_json()
        | {
            "optimizers": list(optimizers),
            "plugins": {f"optimizer {FOREIGN}": {"place": FOREIGN, "package": "their-lab 1.0", "code": "0" * 64}},
            "code": "f" * 64,
        }
        | changes
    )
    (folder / "runs").mkdir(parents=True)
    (folder / "timings").mkdir()
    (folder / "bench.json").write_text(json.dumps(settings))
    for optimizer in optimizers:
        for name in problems:
            for repeat in range(settings["repeats"]):
                key = RunKey(optimizer, name, repeat)
                seed = key.seed(settings["seed"])
                points = np.random.default_rng(seed).uniform(-1, 1, (settings["budget"], 7))
                run = RunResult.of(key, points, problem(name).read(points, seed))
                write_run(folder, run, label_of(key, settings), {"total": 1.0})
    return folder


def test_they_are_ranked_together_by_the_numbers_of_each(mine, tmp_path, inkjet):
    theirs = write_bench(tmp_path / "theirs", (FOREIGN, "random"))
    status, out, _ = inkjet(
        "bench", "--merge", mine, "--merge", theirs, "--results", "both", "--json", "both.json", "--coco", "logs"
    )
    assert status == 0
    assert FOREIGN in out
    told = json.loads((tmp_path / "both.json").read_text())
    names = {one["optimizer"] for one in told["ranking"]}
    assert names == {"pso", "random", FOREIGN, "random@theirs"}
    assert told["settings"]["repeats"] == 2  # of three, since theirs has two
    both, alone = (Comparison(merged(folders, tmp_path / "again")) for folders in ([mine, theirs], [mine]))
    for name in ("nominal", "reading-50mV"):
        np.testing.assert_array_equal(both.regrets_V("pso", name, 90), alone.regrets_V("pso", name, 90)[:2])
    assert [source["name"] for source in told["settings"]["sources"]] == ["mine", "theirs"]
    page = (tmp_path / "both" / "report.html").read_text()
    assert "their-lab 1.0" in page
    of_theirs = next(row for row in leaderboard.origins(told) if row[0] == FOREIGN)
    assert of_theirs == (FOREIGN, "their-lab 1.0", "defaults", "theirs", "`000000000000`")
    assert "f" * 12 in page
    assert sorted(path.name for path in (tmp_path / "logs").iterdir())[-1] == "their_lab.search.Halving"


def test_options_of_runs_are_refused_where_nothing_is_run(mine, inkjet):
    status, _, err = inkjet("bench", "--merge", mine, "--budget", "2000", "--results", "both")
    assert (status, err.count("\n")) == (2, 1)
    assert "--merge runs nothing: what is compared stands in its folders. Leave out --budget." in err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda run: replace(run, costs_V=run.costs_V - 1.0, told_V=run.told_V - 1.0), "costs"),
        (lambda run: replace(run, told_V=run.told_V[::-1]), "the reported costs do not decrease"),
        (lambda run: replace(run, evaluations=run.evaluations + 90), "are not improvements of a run of 90"),
    ],
)
def test_a_run_that_was_changed_is_refused(mine, tmp_path, change, said):
    theirs = write_bench(tmp_path / "theirs", (FOREIGN,))
    settings = json.loads((theirs / "bench.json").read_text())
    key = RunKey(FOREIGN, "nominal", 1)
    seed = key.seed(settings["seed"])
    points = np.random.default_rng(seed).uniform(-1, 1, (settings["budget"], 7))
    run = RunResult.of(key, points, problem("nominal").read(points, seed))
    write_run(theirs, change(run), label_of(key, settings), {})
    with pytest.raises(DamagedResultError, match=said):
        merged([mine, theirs], tmp_path / "both")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"budget": 80}, "runs must be equally long"),
        ({"format": "bench/0"}, "is not of a bench of this version"),
        ({"optimizers": ["../../pso"]}, "is not a name of an optimiser"),
        ({"repeats": "many"}, "is not the results folder of a bench"),
        ({"versions": 3}, "is not the results folder of a bench"),
        ({"plugins": {"optimizer x": "y"}}, "is not the results folder of a bench"),
    ],
)
def test_a_bench_that_does_not_fit_is_refused_in_a_sentence(mine, tmp_path, changes, said):
    theirs = write_bench(tmp_path / "theirs", (FOREIGN,))
    file = theirs / "bench.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    with pytest.raises(ValueError, match=said):
        merged([mine, theirs], tmp_path / "both")


def test_other_problems_missing_runs_and_folders_that_are_taken_are_refused(mine, tmp_path):
    theirs = write_bench(tmp_path / "theirs", (FOREIGN,))
    file = theirs / "bench.json"
    settings = json.loads(file.read_text())
    next((theirs / "runs").glob("nominal*")).unlink()
    with pytest.raises(ValueError, match=r"1 of 2 runs of .* on nominal are missing"):
        merged([mine, theirs], tmp_path / "both")
    settings["problems"]["nominal"]["cost"]["A"] = -6.0
    file.write_text(json.dumps(settings))
    with pytest.raises(ValueError, match="its problem nominal is another one than here"):
        merged([mine, theirs], tmp_path / "both")
    with pytest.raises(ValueError, match="have no problem of the suite in common"):
        merged([mine, write_bench(tmp_path / "stiff", (FOREIGN,), ("stiff-head",))], tmp_path / "both")
    with pytest.raises(ValueError, match="holds a bench of its own"):
        merged([mine, mine], mine)
    settings = json.loads((mine / "bench.json").read_text())
    own = write_bench(tmp_path / "own", (FOREIGN,))
    settings["problems"] = {"antigravity:tall_drop": settings["problems"]["nominal"]}
    (own / "bench.json").write_text(json.dumps(settings))
    with pytest.raises(ValueError, match="have no problem of the suite in common"):
        merged([mine, own], tmp_path / "both")
    assert "antigravity" not in sys.modules  # nothing that a file names is imported
    shutil.copytree(mine, tmp_path / "deep" / "mine")
    shutil.copytree(mine, tmp_path / "other" / "mine")
    with pytest.raises(ValueError, match="two folders are called mine"):
        merged([mine, tmp_path / "deep" / "mine", tmp_path / "other" / "mine"], tmp_path / "both")
