"""Learning over heads: what it saves, and that a study keeps what was learnt and tested."""

import json
import math

import numpy as np
import pytest

from inkjet_env.experiments.learning import amortised, learners, repeated_training
from inkjet_env.experiments.learning.amortised import TuningResult, break_even
from inkjet_env.experiments.learning.learners import by_gradient
from inkjet_env.experiments.learning.repeated_training import KeptFileError, each


def a_test(name, medians, trained=0):
    """Eleven heads that all have the same curve, one training."""
    curves_V = np.tile(np.asarray(medians, float), (1, 11, 1))
    return TuningResult(name, np.full((1, 11), math.nan), curves_V, np.array([float(trained)]))


def test_break_even_is_training_over_what_a_head_saves():
    scratch = a_test("cma-es", np.linspace(10, 0, 2000))
    policy = a_test("policy", np.full(2000, 5.0), trained=95_000)
    at_5 = int(np.argmax(scratch.curves_V[0, 0] <= 5.0)) + 1
    assert break_even(policy, [scratch], 50) == pytest.approx(95_000 / (at_5 - 50))


def test_learning_is_held_against_whoever_is_there_first_even_if_others_end_lower():
    soon, late = a_test("soon", np.r_[np.full(199, 9.0), np.full(1801, 4.0)]), a_test("late", np.linspace(10, 0, 2000))
    policy = a_test("policy", np.full(2000, 5.0), trained=95_000)
    assert break_even(policy, [late, soon], 50) == pytest.approx(95_000 / (200 - 50))
    by_name = {row["name"]: row for row in amortised.summary_rows([late, soon, policy], np.random.default_rng(0))}
    assert by_name["policy"]["against"] == "soon"


def test_what_scratch_reaches_sooner_never_pays():
    scratch, policy = a_test("cma-es", np.zeros(2000)), a_test("policy", np.ones(2000), trained=1)
    assert break_even(policy, [scratch], 50) == math.inf


def test_what_scratch_never_reaches_pays_from_so_many_heads_at_the_most():
    scratch, policy = a_test("cma-es", np.ones(2000)), a_test("policy", np.zeros(2000), trained=95_000)
    assert break_even(policy, [scratch], 50) == 0
    row = amortised.summary_rows([scratch, policy], np.random.default_rng(0))[1]
    assert row["at_most_heads"] == pytest.approx(95_000 / (2001 - 50))
    assert amortised.heads_from(row["break_even_heads"], row["at_most_heads"]) == "≤ 49 (≤ 49 … ≤ 49)"


def test_a_resample_of_trainings_is_charged_for_those_that_it_holds():
    scratch = a_test("cma-es", np.linspace(10, 0, 2000))
    curves_V = np.full((2, 11, 2000), 5.0)
    policy = TuningResult("policy", curves_V[..., 0], curves_V, np.array([1000.0, 3000.0]))
    first, both = (break_even(policy, [scratch], 50, np.array(some)) for some in ([0, 0], [0, 1]))
    assert both == pytest.approx(2 * first)


def test_break_even_has_an_interval_over_trainings_and_heads():
    rng = np.random.default_rng(0)
    falls = np.linspace(10, 0, 2000) + rng.normal(0, 1, (1, 40, 1))
    scratch = TuningResult("cma-es", np.full((1, 40), math.nan), falls, np.zeros(1))

    def row(trainings_V):
        """Of a policy that leaves as many volts as its training says, on every head."""
        left_V = np.tile(np.asarray(trainings_V)[:, None, None], (1, 40, 2000))
        policy = TuningResult("policy", left_V[..., 0], left_V, np.full(5, 95_000.0))
        by_name = {one["name"]: one for one in amortised.summary_rows([scratch, policy], np.random.default_rng(1))}
        assert "break_even_heads" not in by_name["cma-es"]
        even = by_name["policy"]["break_even_heads"]
        assert even["value"] == pytest.approx(break_even(policy, [scratch], 50))
        assert even["low"] < even["value"] < even["high"]
        return by_name["policy"]

    alike, apart = row([5.0] * 5), row([3.0, 4.0, 5.0, 6.0, 7.0])
    assert alike["0"]["low"] == alike["0"]["high"] == 5.0
    assert (apart["0"]["low"], apart["0"]["high"], apart["0"]["each"]) == (3.0, 7.0, [3.0, 4.0, 5.0, 6.0, 7.0])
    widths = [one["break_even_heads"]["high"] - one["break_even_heads"]["low"] for one in (alike, apart)]
    assert widths[1] > 2 * widths[0]


@pytest.fixture
def small(monkeypatch):
    """A study of one learner and one optimiser, of few descents and resamples."""
    monkeypatch.setattr(amortised, "BUDGETS", (5, 20))
    monkeypatch.setattr(amortised, "LEARNERS", {"gradient": by_gradient})
    monkeypatch.setattr(amortised, "SCRATCH", ("random",))
    monkeypatch.setattr(learners, "STARTS_FOR_ONE", 3)
    for module in (amortised, repeated_training):
        monkeypatch.setattr(module, "RESAMPLES", 100)


def test_a_study_keeps_its_policies_and_tells_the_same_again(small, tmp_path, monkeypatch):
    settings = {"evaluations": 600, "heads": 3, "labelling": 3, "seed": 0, "trainings": 2}
    first = amortised.study(tmp_path, **settings)
    tested = {f"{name}-{k}-tested.npz" for name in ("gradient", "table-of-one-head") for k in (1, 2)}
    files = {file.name for file in tmp_path.iterdir()}
    assert files > tested | {"gradient-1.npz", "gradient-2.npz", "random-1-tested.npz", "amortised.json"}
    monkeypatch.setitem(amortised.LEARNERS, "gradient", lambda *_: pytest.fail("trained again"))
    monkeypatch.setattr(amortised, "tuned_costs_V", lambda *_: pytest.fail("tested again"))
    assert amortised.study(tmp_path, **settings) == first == json.loads((tmp_path / "amortised.json").read_text())
    by_name = {row["name"]: row for row in first["rows"]}
    assert {"table of one head", "table for 60", "table for 600"} < by_name.keys()
    assert by_name["table of one head"]["trained"] > 0
    assert "0" not in by_name["random"]
    assert not by_name["table of one head"]["behind"]
    behind = by_name["random"]["behind"]["20"]
    difference = by_name["random"]["20"]["value"] - by_name["table of one head"]["20"]["value"]
    assert behind["value"] == pytest.approx(difference)
    assert behind["low"] <= behind["value"] <= behind["high"]
    assert by_name["gradient"]["5"]["value"] <= by_name["gradient"]["0"]["value"]
    assert len(set(by_name["gradient"]["0"]["each"])) == 2
    assert min(row["20"]["low"] for row in first["rows"]) >= 0
    ((header, rows),) = amortised.result_tables(first)
    assert {len(row) for row in rows} == {len(header)}
    legend = amortised.legend(first)
    assert "and 2 trainings of each learning method, with an interval over both that is too narrow" in legend


def test_a_policy_is_tested_on_other_heads_without_being_trained_again(small, tmp_path, monkeypatch):
    amortised.tested(tmp_path, "gradient", 1, 300, seed=0, heads=2)
    (tmp_path / "gradient-1-tested.npz").unlink()
    monkeypatch.setitem(amortised.LEARNERS, "gradient", lambda *_: pytest.fail("trained again"))
    assert amortised.tested(tmp_path, "gradient", 1, 300, seed=0, heads=3)["after_V"].shape == (3, 20)


def test_regret_is_against_the_best_known_where_nobody_reaches_it(small, tmp_path):
    content = amortised.study(tmp_path, evaluations=300, heads=3, labelling=10, seed=0)
    best_V = np.load(tmp_path / "best-known.npz")["best_V"]
    reached_V = np.min([np.load(file)["after_V"].min(axis=1) for file in tmp_path.glob("*-tested.npz")], axis=0)
    assert (reached_V > best_V + 0.01).any()
    after_V = np.load(tmp_path / "random-1-tested.npz")["after_V"][:, -1]
    random = next(row for row in content["rows"] if row["name"] == "random")
    assert random["20"]["value"] == pytest.approx(np.median(after_V - np.minimum(best_V, reached_V)))


def test_what_was_made_with_other_settings_is_refused(small, tmp_path, capsys):
    arguments = ["--folder", str(tmp_path), "--labelling", "1", "--trainings", "1", "--workers", "1"]
    amortised.main([*arguments, "--evaluations", "300", "--heads", "2"])
    for other, said in (
        (["--evaluations", "400", "--heads", "2"], "evaluations is 300 there and 400 here"),
        (["--evaluations", "300", "--heads", "3"], "heads is 2 there and 3 here"),
        (["--evaluations", "300", "--heads", "2", "--labelling", "2"], "labelling is 1 there and 2 here"),
    ):
        with pytest.raises(SystemExit) as ended:
            amortised.main([*arguments, *other])
        assert ended.value.code == 2
        assert f".npz was made with other settings or code: {said}" in capsys.readouterr().err


def test_a_study_on_two_processes_is_that_on_one(tmp_path):
    """Whole, and with the learners as they are: what a process of another name is given must reach it."""
    arguments = {"evaluations": 600, "seed": 3, "heads": 1}
    ways = ("gradient", "lbfgsb-multistart")
    found = []
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        folder.mkdir()
        jobs = {way: (folder, way, 1, *arguments.values()) for way in ways}
        found.append(each("study", amortised.tested, jobs, workers))
    for way in ways:
        assert found[0][way].keys() == found[1][way].keys()
        for name, values in found[0][way].items():
            np.testing.assert_array_equal(values, found[1][way][name])
    (tmp_path / "2" / "gradient-1-tested.npz").write_bytes(b"nothing of the kind")
    with pytest.raises(KeptFileError, match=r"gradient-1-tested\.npz: is damaged"):
        each("study", amortised.tested, jobs, 2)
