"""Learning over heads: the ledger, the chain rule, and that something is learnt."""

import json
import math

import numpy as np
import pytest

from experiments import amortised
from experiments.amortised import Heads, TuningResult, break_even, drawn
from inkjet_env.printhead import Waveform


def test_heads_side_by_side_cost_what_each_costs_alone():
    heads = Heads(drawn(6, 1))
    points = np.random.default_rng(0).uniform(-1, 1, (6, 7))
    costs, gradients = heads.evaluate_with_gradient(points)
    for k in range(6):
        head = amortised.the_task().head(heads.observations[k])
        waveform = Waveform.from_array(amortised.the_task().bounds.from_unit(points[k]))
        assert costs[k] == pytest.approx(head.respond(waveform).cost(), abs=1e-8)
        alone = heads.one(k).evaluate_with_gradient(points[k : k + 1])
        assert (alone[0][0], *alone[1][0]) == pytest.approx((costs[k], *gradients[k]), abs=1e-9)


def test_heads_to_train_on_and_to_test_on_are_different():
    train, test = drawn(200, amortised.TRAIN_SEED), drawn(100, amortised.TEST_SEED)
    assert len({tuple(row) for row in (*train, *test)}) == 300
    assert (drawn(3, 7) == drawn(5, 7)[:3]).all()


def test_a_policy_that_is_trained_on_gradients_does_better_than_an_untrained_one():
    heads = Heads(drawn(60, amortised.TEST_SEED))
    costs = {}
    for evaluations in (256, 256 * 60):
        policy, spent = amortised.by_gradient(evaluations, seed=1)
        assert spent == evaluations == policy.made["evaluations"]
        costs[evaluations] = heads.evaluate(policy.act(heads.observations)).mean()
    assert costs[256 * 60] < costs[256] - 3


def test_imitation_spends_no_more_than_it_says_and_repeats_what_it_saw():
    policy, spent = amortised.by_imitation(3000, seed=2)
    assert policy.made == {"by": "imitation", "evaluations": spent, "heads": policy.made["heads"], "seed": 2}
    assert 3000 <= spent < 3000 + 8 * 400
    first = drawn(1, amortised.TRAIN_SEED + 200_000)
    point, _, _ = amortised.descended(amortised.OneHead(first), amortised.LABELLING_STARTS, 2)
    assert np.abs(policy.act(first)[0] - point).max() < 0.3


def a_test(name, medians, trained=0):
    """Eleven heads that all have the same curve."""
    return TuningResult(name, np.full(11, math.nan), np.tile(np.asarray(medians, float), (11, 1)), trained)


def test_break_even_is_training_over_what_a_head_saves():
    scratch = a_test("cma-es", np.linspace(10, 0, 2000))
    policy = a_test("policy", np.full(2000, 5.0), trained=95_000)
    at_5 = int(np.argmax(scratch.curves_V[0] <= 5.0)) + 1
    assert break_even(policy, scratch, 50) == pytest.approx(95_000 / (at_5 - 50))


def test_what_scratch_reaches_sooner_never_pays():
    scratch, policy = a_test("cma-es", np.zeros(2000)), a_test("policy", np.ones(2000), trained=1)
    assert break_even(policy, scratch, 50) == math.inf


def test_a_study_keeps_its_policies_and_tells_the_same_again(tmp_path, monkeypatch):
    monkeypatch.setattr(amortised, "BUDGETS", (5, 20))
    monkeypatch.setattr(amortised, "LEARNERS", {"imitation": amortised.by_imitation})
    monkeypatch.setattr(amortised, "SCRATCH", ("random",))
    first = amortised.study(tmp_path, evaluations=1000, heads=3, labelling=3, seed=0)
    assert {file.name for file in tmp_path.iterdir()} == {"imitation.npz", "amortised.json"}
    monkeypatch.setattr(amortised, "LEARNERS", {"imitation": lambda *_: pytest.fail("trained again")})
    assert amortised.study(tmp_path, 1000, 3, 3, 0) == first == json.loads((tmp_path / "amortised.json").read_text())
    by_name = {row["name"]: row for row in first["rows"]}
    assert "0" not in by_name["random"]
    assert by_name["imitation"]["5"]["value"] <= by_name["imitation"]["0"]["value"]
    assert min(row["20"]["low"] for row in first["rows"]) >= 0
    amortised.print_study(first)


def test_a_policy_of_other_settings_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(amortised, "BUDGETS", (5,))
    monkeypatch.setattr(amortised, "LEARNERS", {"imitation": amortised.by_imitation})
    monkeypatch.setattr(amortised, "SCRATCH", ("random",))
    amortised.study(tmp_path, evaluations=300, heads=2, labelling=1, seed=0)
    with pytest.raises(SystemExit) as ended:
        amortised.main(["--folder", str(tmp_path), "--evaluations", "400", "--heads", "2", "--labelling", "1"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert "imitation.npz was trained as {'evaluations': 300, 'seed': 0}, not as {'evaluations': 400" in said
