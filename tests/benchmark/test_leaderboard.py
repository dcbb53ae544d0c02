"""The leaderboard: places as the standings have them, and where every optimiser comes from."""

import json
from pathlib import Path

import pytest

from inkjet_env.experiments.publish import leaderboard

DOCS = Path(__file__).parents[2] / "docs"
FOREIGN = "their_lab.search:Halving"


def standings(*ranks, critical_difference=1.0):
    rows = [{"optimizer": name, "rank": rank} for name, rank in ranks]
    return {"rows": rows, "critical_difference": critical_difference}


@pytest.fixture
def ranking():
    """The ranking of two benches: one of this package, one of somebody else who also ran cma-es."""
    mine = {"name": "mine", "optimizers": ["pso", "cma-es"], "versions": {"inkjet-env": "0.1.0", "cma": "4.5.0"},
            "code": "a" * 64, "plugins": {}}  # fmt: skip
    plugins = {f"optimizer {FOREIGN}": {"place": FOREIGN, "package": "their-lab 1.0", "code": "b" * 64}}
    theirs = {"name": "theirs", "optimizers": [FOREIGN, "cma-es"], "versions": {"cma": "4.4.0"}, "code": "c" * 64,
              "plugins": plugins}  # fmt: skip
    return {
        "format": "ranking/1",
        "settings": {"budget": 200, "repeats": 3, "seed": 4, "sources": [mine, theirs]},
        "problems": [{"name": "nominal"}, {"name": "stiff-head"}],
        "entrants": [{"name": "cma-es", "settings": "population 22"}],
        "standings": {
            "50": standings(("pso", 1.5), (FOREIGN, 2.0), ("cma-es", 2.6)),
            "200": standings((FOREIGN, 1.0), ("cma-es", 2.0), ("cma-es@theirs", 2.1), ("pso", 4.0)),
        },
    }


def test_places_are_those_of_the_standings_and_ties_are_marked(ranking):
    header, rows = leaderboard.board(ranking)
    assert header == ("optimiser", "after 200", "after 50")
    assert rows == [
        (FOREIGN, "1 (1.0*)", "2 (2.0*)"),
        ("cma-es", "2 (2.0*)", "3 (2.6)"),
        ("cma-es@theirs", "3 (2.1)", "–"),
        ("pso", "4 (4.0)", "1 (1.5*)"),
    ]


def test_every_optimiser_is_told_with_its_package_and_the_bench_of_its_runs(ranking):
    assert leaderboard.origins(ranking) == [
        ("cma-es", "cma 4.5.0", "population 22", "mine", "`aaaaaaaaaaaa`"),
        ("cma-es@theirs", "cma 4.4.0", "population 22", "theirs", "`cccccccccccc`"),
        ("pso", "inkjet-env 0.1.0", "–", "mine", "`aaaaaaaaaaaa`"),
        (FOREIGN, "their-lab 1.0", "–", "theirs", "`bbbbbbbbbbbb`"),
    ]


def test_the_page_in_docs_says_what_the_ranking_says():
    lines = (DOCS / "results" / "leaderboard.md").read_text(encoding="utf-8").splitlines()
    for heading, text in leaderboard.sections(DOCS / "comparison"):
        missing = [line for line in text.splitlines() if line not in lines]
        assert not missing, f"docs/results/leaderboard.md, {heading}: print its tables anew"


def test_a_folder_without_a_ranking_is_refused(tmp_path, capsys, ranking):
    with pytest.raises(SystemExit):
        leaderboard.main([str(tmp_path)])
    assert f"{tmp_path} holds no ranking.json." in capsys.readouterr().err
    (tmp_path / "ranking.json").write_text(json.dumps(ranking))
    leaderboard.main([str(tmp_path)])
    assert "nominal, stiff-head; 3 runs of each, seed 4." in capsys.readouterr().out
