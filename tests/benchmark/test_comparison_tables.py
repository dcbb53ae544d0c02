import json
from pathlib import Path

import pytest

from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.entrants import entrant
from inkjet_env.experiments.benchmark.regret import best_known_cost, scale_V
from inkjet_env.experiments.benchmark.report import write_report
from inkjet_env.experiments.benchmark.runner import run_bench
from inkjet_env.experiments.benchmark.settings import BenchSettings
from inkjet_env.experiments.benchmark.studies import challenge_best_known
from inkjet_env.experiments.benchmark.suite import families, problem
from inkjet_env.experiments.bounds import summary
from inkjet_env.experiments.learning import amortised, few_shot
from inkjet_env.experiments.publish import comparison_tables
from inkjet_env.plant.augmented import AugmentedPrinthead

DOCS = Path(__file__).parents[2] / "docs"


def is_augmented(name):
    return isinstance(problem(name).printhead, AugmentedPrinthead)


@pytest.fixture(autouse=True)
def kept_scales(monkeypatch):
    """Scales of heads with effects are those of the record: each takes seconds to compute anew."""
    kept = json.loads((DOCS / "comparison" / "ranking.json").read_text(encoding="utf-8"))["problems"]
    slow = {one["name"]: one["scale_V"] for one in kept if is_augmented(one["name"])}
    monkeypatch.setattr(comparison_tables, "scale_V", lambda name: slow.get(name) or scale_V(name))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("document")
    settings = BenchSettings(("nominal", "reading-50mV"), ("pso", "lbfgsb-multistart", "pso-tuned"), 2, 60)
    outcome = run_bench(settings, folder, workers=1)
    write_report(Comparison(outcome))
    return folder


def cells(text):
    """Rows of every table in a Markdown text."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]


def test_every_table_is_whole_and_its_numbers_are_those_of_the_files(folder, capsys):
    attempts = [
        {"problem": "nominal", "method": "one", "cost_V": -21.5, "known_V": -22.0},
        {"problem": "nominal", "method": "other", "cost_V": -22.0001, "known_V": -22.0},
    ]
    (folder / "beating.json").write_text(json.dumps({"format": challenge_best_known.FORMAT, "attempts": attempts}))
    comparison_tables.main([str(folder)])
    told = capsys.readouterr().out
    assert [line[3:] for line in told.splitlines() if line.startswith("## ")] == [
        "Problems",
        "Jetting figures",
        "Entrants",
        "After 50 evaluations",
        "After 60 evaluations",
    ]
    rows = cells(told)
    nominal, at_press = [row for row in rows if row[0] == "nominal"]
    effective_V, residual_mV, percent, settled_us, fastest_kHz = map(float, at_press[1:])
    assert percent == pytest.approx(residual_mV / effective_V / 10, rel=0.01)
    assert fastest_kHz <= 1e3 / settled_us + 0.1
    assert float(nominal[2]) == pytest.approx(best_known_cost("nominal"), abs=1e-6)
    assert nominal[-2:] == ["+0.5000", "-0.0001"]
    assert next(row for row in rows if row[0] == "reading-50mV")[-2:] == ["–", "–"]
    assert nominal[4] == f"{(known := problem('nominal').best_known).runs_near} of {known.runs}"
    assert {row[0] for row in rows if row[1] == "train"} == {one.name for one in families()["train"]}
    assert any(row[0] == "lbfgsb-multistart (on 1)" for row in rows)
    assert next(row for row in rows if row[0] == "pso-tuned")[2] == f"{entrant('pso-tuned').tuning_evaluations:,}"
    assert all(
        len({line.count("|") for line in block.splitlines()}) == 1 for block in told.split("\n\n") if block[0] == "|"
    )
    ranking = json.loads((folder / "ranking.json").read_text())
    assert all(f"* {text}" in told for text in ranking["standings"]["60"]["sentences"])


def test_studies_stand_in_it_as_they_are_printed(tmp_path, capsys):
    interval = {"value": 1.5, "low": 1.0, "high": 2.0}
    learnt = {"format": amortised.FORMAT, "heads": 3, "trainings": 1}
    learnt["rows"] = [{"name": "cma-es", "trained": 0, "50": interval, "behind": {"50": interval}}]
    tried = {"format": few_shot.FORMAT, "heads": 3, "trainings": 2, "nothing_V": {"as expected": 17.0}}
    tried["rows"] = [
        {
            "name": name,
            "learning": 0,
            "after": {"3": interval, "10": interval | {"value": v, "each": each}},
            "elsewhere": {"noise × 3": {"after": {"3": interval, "10": interval}}},
        }
        for name, v, each in (("b", 2.0, [2.0]), ("a", 1.0, [0.5, 1.5]))
    ]
    (tmp_path / "amortised.json").write_text(json.dumps(learnt))
    (tmp_path / "few_tries.json").write_text(json.dumps(tried))
    proven = {"problem": "nominal", "bound_V": -25.0, "parts": 20, "boxes": 1234567, "hours": 1.25}
    (tmp_path / "bounds.json").write_text(json.dumps({"format": summary.FORMAT, "bounds": [proven]}))
    comparison_tables.main([str(tmp_path)])
    out = capsys.readouterr().out
    rows = cells(out)
    assert ["nominal", "-22.832046", "-25", "2.168", "20", "1,234,567", "1.2"] in rows
    assert ["cma-es", "0", "–", "1.5 (1 … 2)", "–", "–", "", "1.5 (1 … 2)", ""] in rows
    assert [(row[0], row[-2]) for row in rows if len(row) == 6][-2:] == [("a", "0.50 … 1.50"), ("b", "")]
    assert rows[-2:] == [["a", "1.50 (1.00 … 2.00)"], ["b", "1.50 (1.00 … 2.00)"]]
    assert "over heads alone: each method was trained once" in out
    assert "and 2 trainings of each learning method, with an interval over both that is too narrow" in out


def test_the_record_in_docs_says_what_its_files_say():
    lines = (DOCS / "results" / "comparison.md").read_text(encoding="utf-8").splitlines()
    told = dict(comparison_tables.sections(DOCS / "comparison"))
    assert {"Problems", "Entrants", "After 20,000 evaluations", amortised.TITLE, few_shot.TITLE} <= told.keys()
    for heading, text in told.items():
        missing = [line for line in text.splitlines() if line not in lines]
        assert not missing, f"docs/results/comparison.md, {heading}: print its tables anew"


@pytest.mark.parametrize(
    ("content", "said"), [(None, "holds none of"), ('{"format": "other/1"}', "is not a ranking/1")]
)
def test_a_folder_without_or_with_another_thing_is_refused(content, said, tmp_path, capsys):
    if content is not None:
        (tmp_path / "ranking.json").write_text(content)
    with pytest.raises(SystemExit):
        comparison_tables.main([str(tmp_path)])
    assert said in capsys.readouterr().err
