"""Learning over heads: what it saves, and that a study keeps its policies."""

import json
import math

import numpy as np
import pytest

from experiments import amortised
from experiments.amortised import TuningResult, break_even
from experiments.learners import by_imitation


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


def test_break_even_has_an_interval_over_heads():
    rng = np.random.default_rng(0)
    falls = np.linspace(10, 0, 2000)[None, :] + rng.normal(0, 1, (40, 1))
    scratch = TuningResult("cma-es", np.full(40, math.nan), falls, 0)
    policy = TuningResult("policy", np.full(40, 5.0), np.full((40, 2000), 5.0), 95_000)
    by_name = {row["name"]: row for row in amortised.told([scratch, policy], rng)}
    even = by_name["policy"]["break_even_heads"]
    assert even["low"] < even["value"] < even["high"]
    assert even["value"] == pytest.approx(break_even(policy, scratch, 50))
    assert "break_even_heads" not in by_name["cma-es"]


def test_a_study_keeps_its_policies_and_tells_the_same_again(tmp_path, monkeypatch):
    monkeypatch.setattr(amortised, "BUDGETS", (5, 20))
    monkeypatch.setattr(amortised, "LEARNERS", {"imitation": by_imitation})
    monkeypatch.setattr(amortised, "SCRATCH", ("random",))
    # a head takes about 1,000 evaluations to label, how many exactly is up to rounding: 3,000 are two heads or more
    first = amortised.study(tmp_path, evaluations=3000, heads=3, labelling=3, seed=0)
    assert {file.name for file in tmp_path.iterdir()} == {"imitation.npz", "amortised.json"}
    monkeypatch.setattr(amortised, "LEARNERS", {"imitation": lambda *_: pytest.fail("trained again")})
    assert amortised.study(tmp_path, 3000, 3, 3, 0) == first == json.loads((tmp_path / "amortised.json").read_text())
    by_name = {row["name"]: row for row in first["rows"]}
    assert sum(name.startswith("table of ") for name in by_name) >= 2
    assert by_name["table of 1 head"]["trained"] > 0
    assert "0" not in by_name["random"]
    assert by_name["imitation"]["5"]["value"] <= by_name["imitation"]["0"]["value"]
    assert min(row["20"]["low"] for row in first["rows"]) >= 0
    amortised.print_study(first)


def test_a_policy_of_other_settings_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(amortised, "BUDGETS", (5,))
    monkeypatch.setattr(amortised, "LEARNERS", {"imitation": by_imitation})
    monkeypatch.setattr(amortised, "SCRATCH", ("random",))
    amortised.study(tmp_path, evaluations=300, heads=2, labelling=1, seed=0)
    with pytest.raises(SystemExit) as ended:
        amortised.main(["--folder", str(tmp_path), "--evaluations", "400", "--heads", "2", "--labelling", "1"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert "imitation.npz was trained as {'evaluations': 300, 'seed': 0}, not as {'evaluations': 400" in said
