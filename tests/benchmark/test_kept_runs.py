"""The runs that docs/comparison/runs keeps belong to the comparison that docs/comparison/ranking.json tells of."""

import json
import tarfile
from pathlib import Path

import pytest
from scipy.stats import trim_mean

from inkjet_env.experiments.benchmark import run_files
from inkjet_env.experiments.benchmark.run_files import RunKey, label_of, read_run

DOCS = Path(__file__).parents[2] / "docs" / "comparison"
RANKING = json.loads((DOCS / "ranking.json").read_text(encoding="utf-8"))
ARCHIVES = sorted((DOCS / "runs").glob("*.tar.xz"))


def unpack(archive, folder):
    """Its files, and only they: Python 3.11.3 and before cannot be told to refuse links and devices."""
    (folder / "runs").mkdir()
    (folder / "timings").mkdir()
    with tarfile.open(archive) as kept:
        for member in kept:
            if member.isfile():
                (folder / member.name).write_bytes(kept.extractfile(member).read())


@pytest.mark.parametrize("archive", ARCHIVES, ids=lambda path: path.name.removesuffix(".tar.xz"))
def test_an_archive_is_one_optimiser_whole_and_of_the_same_comparison(archive, tmp_path, monkeypatch):
    """Every run is read; of the first repeat on each problem the costs are computed anew, of the others believed."""
    checked = run_files._what_is_wrong
    monkeypatch.setattr(run_files, "_what_is_wrong", lambda run, seed: "" if run.key.repeat else checked(run, seed))
    unpack(archive, tmp_path)
    settings = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    ranked = RANKING["settings"]
    same = ("format", "budget", "repeats", "seed", "problems", "code", "versions")
    assert {name: settings[name] for name in same} == {name: ranked[name] for name in same}

    optimizer = archive.name.removesuffix(".tar.xz")
    keys = [RunKey(optimizer, name, k) for name in ranked["problems"] for k in range(ranked["repeats"])]
    for folder, ending in (("runs", "parquet"), ("timings", "json")):
        assert {path.name for path in (tmp_path / folder).iterdir()} == {f"{key.file_stem}.{ending}" for key in keys}

    reached = min(ranked["budget"], ranked["shorter"].get(optimizer, ranked["budget"]))
    regrets, told_of = [], {one["name"]: one for one in RANKING["problems"]}
    for key in keys:
        run = read_run(tmp_path, key, label_of(key, settings))
        of = told_of[key.problem]  # a scale computed anew may round otherwise on another processor
        regrets.append((float(run.kept_V(reached)) - of["best_V"]) / of["scale_V"])
    (told,) = (row for row in RANKING["standings"][str(reached)]["rows"] if row["optimizer"] == optimizer)
    assert trim_mean(regrets, 0.25) == pytest.approx(told["quality"]["value"], abs=1e-7)
