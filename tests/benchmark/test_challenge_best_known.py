import json

import pytest

from inkjet_env.experiments.benchmark.regret import best_known_cost, scale_V
from inkjet_env.experiments.benchmark.studies import challenge_best_known


def test_a_record_that_is_too_high_is_beaten(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(challenge_best_known, "BUDGET", 4000)
    monkeypatch.setattr(challenge_best_known, "best_known_cost", lambda name: best_known_cost(name) + 1.0)
    kept = tmp_path / "tried.json"
    assert (
        challenge_best_known.main(["--problem", "nominal", "--minutes", "0.01", "--workers", "1", "--json", str(kept)])
        == 1
    )
    assert "nominal has a lower cost by lbfgsb-multistart" in capsys.readouterr().out
    tried = json.loads(kept.read_text())["attempts"]
    assert [one["method"] for one in tried] == list(challenge_best_known.METHODS)
    assert max(one["gain"] for one in tried) > challenge_best_known.ALLOWED


def test_the_record_stands_and_every_method_says_what_it_spent(capsys):
    found = challenge_best_known.attempts(["reading-50mV"], 0.1, 1)
    assert [one.method for one in found] == list(challenge_best_known.METHODS)
    assert all(one.evaluations >= challenge_best_known.BUDGET for one in found)
    assert all(-0.2 < one.gain <= challenge_best_known.ALLOWED for one in found)
    assert max(one.gain for one in found) > -1e-3  # they search what is told without errors


def test_a_gain_is_not_hidden_by_what_a_drop_earns():
    """A wanted drop of 6 V earns 300 V whoever fires it; a gain of 0.1 V counts as on any other problem."""
    known_V = best_known_cost("drop-6V")
    assert challenge_best_known.Attempt("drop-6V", "any", known_V - 0.1, 1).gain == pytest.approx(
        0.1 / scale_V("drop-6V")
    )
    known_V = best_known_cost("durations-10us")
    assert challenge_best_known.Attempt("durations-10us", "any", known_V - 0.1, 1).gain == pytest.approx(
        0.1 / abs(known_V)
    )


def test_heads_without_gradients_meet_another_method(monkeypatch):
    for name, value in {"BUDGET": 300, "ENDS": 1, "ROUNDS": 1}.items():
        monkeypatch.setattr(challenge_best_known, name, value)
    one = challenge_best_known.attempt("augmented-echo", "lbfgsb-multistart", 0.0)
    assert one.method == challenge_best_known.WITHOUT_GRADIENT
    assert one.evaluations == challenge_best_known.BUDGET


def test_no_time_at_all_is_refused(capsys):
    with pytest.raises(SystemExit):
        challenge_best_known.main(["--minutes", "0"])
    assert "--minutes must be above 0" in capsys.readouterr().err
