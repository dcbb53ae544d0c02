"""What a run depends on, and what of a bench is compared."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.conclusions import ranking_sentences, standings_sentences
from inkjet_env.experiments.benchmark.page import page_data
from inkjet_env.experiments.benchmark.report import write_report
from inkjet_env.experiments.benchmark.run_files import RunKey, label_of
from inkjet_env.experiments.benchmark.runner import perform, perform_some, run_bench
from inkjet_env.experiments.benchmark.settings import LONGEST, BenchOutcome
from inkjet_env.experiments.benchmark.suite import problem
from tests.benchmark.small_bench import small_settings


def test_a_run_depends_on_nothing_but_its_names_budget_and_seed():
    key = RunKey("pso", "nominal", 1)

    def file(settings):
        return perform(key, settings)[1].to_bytes(label_of(key, settings.to_json()))

    alone = file(small_settings())
    assert file(small_settings(optimizers=("random", "pso"), repeats=7)) == alone
    assert file(small_settings(seed=1)) != alone


def test_whatever_of_ours_a_run_uses_is_in_the_code_that_it_is_labelled_with():
    script = """if True:
        import sys
        from pathlib import Path
        from inkjet_env import experiments
        from inkjet_env import optimizers
        from inkjet_env.experiments.benchmark.run_files import RunKey
        from inkjet_env.experiments.benchmark.runner import applies, perform
        from inkjet_env.experiments.benchmark.settings import SOURCES, BenchSettings
        from inkjet_env.experiments.benchmark.suite import families

        for problems in families().values():
            name = problems[0].name
            for optimizer in ("pso-tuned", "lbfgsb-multistart"):
                if applies(optimizer, name):
                    assert perform(RunKey(optimizer, name, 0), BenchSettings((name,), (optimizer,), 1, 60))[1]
        root = Path(experiments.__file__).resolve().parents[1]
        known = {file for pattern in SOURCES for file in root.glob(pattern)}
        files = [Path(module.__file__) for module in sys.modules.values() if getattr(module, "__file__", None)]
        ours = [file for file in files if root in file.parents and ".venv" not in file.parts]
        print(*[str(file.relative_to(root)) for file in ours if file not in known], sep="\\n")
    """
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    around = set(done.stdout.split())
    assert "experiments/benchmark/runner.py" in around
    assert {name for name in around if not name.startswith("experiments/")} == set()
    numbers = {"problem", "suite", "entrants"}
    assert not {f"experiments/benchmark/{name}.py" for name in numbers} & around


def test_an_optimizer_of_shorter_runs_is_compared_as_far_as_they_go(monkeypatch, tmp_path):
    monkeypatch.setitem(LONGEST, "random", 60)
    settings = small_settings()
    keys = [RunKey(optimizer, "nominal", repeat) for optimizer in settings.optimizers for repeat in range(2)]
    outcome = BenchOutcome(settings, tmp_path, [perform(key, settings)[1] for key in keys], {})
    assert [run.budget for run in outcome.results] == [90, 90, 60, 60]
    labels = [label_of(key, settings.to_json())["budget"] for key in keys]
    assert labels == [90, 90, 60, 60]
    compared = Comparison(outcome)
    assert compared.ranking.optimizers == ("pso",)
    assert "not in this ranking: random (60 evaluations)." in " ".join(ranking_sentences(compared))
    for budget, there in ((50, {"pso", "random"}), (90, {"pso"})):
        rows = compared.standings("all", budget).rows
        assert {row.optimizer for row in rows} == there
    drawn = page_data(compared)
    cut = {name: drawn["evaluations"][len(drawn["ecdf"]["all"][name]) - 1] for name in settings.optimizers}
    assert cut["pso"] == 90
    assert 50 <= cut["random"] <= 60
    with pytest.raises(ValueError, match="budget must be at most 60 for random alone; got 90"):
        small_settings(optimizers=("random",))


def test_a_worker_of_other_code_or_packages_does_nothing(monkeypatch):
    monkeypatch.setattr("inkjet_env.experiments.benchmark.runner.perform", lambda *_: pytest.fail("ran"))
    told = small_settings().to_json()
    keys = [RunKey("pso", "nominal", 0)]
    with pytest.raises(ValueError, match="the code differs, here or at a worker"):
        perform_some(keys, small_settings(), "0" * 64, told["versions"], {})
    others = told["versions"] | {"numpy": "1.0"}
    with pytest.raises(ValueError, match=r"packages differ .* numpy is 1\.0 there and .* here\. Install the same"):
        perform_some(keys, small_settings(), told["code"], others, {})
    with pytest.raises(ValueError, match=r"plug-ins differ .* mine is missing here\. Install the same"):
        perform_some(keys, small_settings(), told["code"], told["versions"], {"mine": {"code": "1"}})


def test_what_was_read_is_told_apart_from_what_it_costs(tmp_path):
    outcome = run_bench(small_settings(problems=("reading-200mV",), optimizers=("random",)), tmp_path, workers=1)
    for run in outcome.results:
        told_V, cost_V = (float(of(90)) for of in (run.lowest_told_V, run.kept_V))
        assert told_V == run.told_V.min()
        assert told_V != cost_V == pytest.approx(problem("reading-200mV").evaluate([run.best_point()])[0])
    rows = page_data(Comparison(outcome))["physical"]["reading-200mV"]["90"]
    assert rows[0]["told_V"] in [run.told_V.min() for run in outcome.results]


def test_an_optimiser_that_needs_gradients_is_left_out_where_there_are_none(tmp_path):
    """It ranks last there, and its place in the tables is empty."""
    settings = small_settings(problems=("nominal", "reading-200mV"), optimizers=("lbfgsb-multistart", "random"))
    outcome = run_bench(settings, tmp_path / "r", workers=1)
    assert [key for key in (r.key for r in outcome.results) if key.problem != "nominal"] == [
        RunKey("random", "reading-200mV", repeat) for repeat in range(2)
    ]
    compared = Comparison(outcome)
    assert set(compared.ranking.median_regrets_V) == {
        ("lbfgsb-multistart", "nominal"),
        ("random", "nominal"),
        ("random", "reading-200mV"),
    }
    page, ranking = write_report(compared)
    assert "–" in page.read_text()
    json.dumps(ranking, allow_nan=False)
    told, true = ([getattr(r, part)[-1] for r in outcome.results[-2:]] for part in ("told_V", "costs_V"))
    assert (np.array(told) != true).all()


def test_a_report_of_single_runs_has_no_interval(tmp_path):
    settings = small_settings(problems=("nominal", "stiff-head"), repeats=1)
    keys = [RunKey(optimizer, name, 0) for optimizer in settings.optimizers for name in settings.problems]
    compared = Comparison(BenchOutcome(settings, tmp_path, [perform(key, settings)[1] for key in keys], {}))
    said = " ".join((*ranking_sentences(compared), *standings_sentences(compared, "all", 90)))
    assert re.search(r"Its regret is [0-9.]+ of the problems' scales", said)
    page, ranking = write_report(compared)
    for text in (said, re.sub(r"<script.*?</script>", "", page.read_text(), flags=re.S), json.dumps(ranking)):
        assert not re.search(r"\bnan\b", text, flags=re.I)
