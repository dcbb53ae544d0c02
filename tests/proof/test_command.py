import json

import pytest

from inkjet_env.experiments.execution import cluster
from inkjet_env.experiments.proof import protocol
from inkjet_env.experiments.proof.corpus import PUBLISHED_SEED, Draw


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--workers", "0"], "--workers must be at least 1; got 0"),
        (["--reoptimise", "-1"], "--reoptimise must be at least 0; got -1"),
        (["--seed", PUBLISHED_SEED], f"seed {PUBLISHED_SEED} is the published one: give --published instead"),
        (["--seed", "3", "--published"], "--published sets its own seed; leave out --seed"),
        (["--published", "--quick"], "--published needs the full corpus, once per version; leave out --quick"),
        (["--seed", "-3"], "--seed must be at least 0; got -3"),
        (["--scheduler", "tcp://127.0.0.1:9", "--workers", "2"], "--workers sets local processes"),
        (["--report", "page.pdf"], "--report must end in .html; got page.pdf"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_sentence(inkjet, tmp_path, arguments, sentence):
    status, out, err = inkjet("prove", *arguments)
    assert (status, out) == (2, "")
    assert err.startswith(f"inkjet: {sentence}")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_folder_of_something_else_is_refused_before_any_process_is_started(inkjet, tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    monkeypatch.setattr(cluster, "workers_of", None)
    status, _, err = inkjet("prove", "--quick", "--out", "mine")
    assert status == 2
    assert "mine is neither empty nor a proof's results folder" in err


def test_help_has_an_example(inkjet):
    status, out, _ = inkjet("prove", "--help")
    assert status == 0
    assert "inkjet prove --quick --out results/quick-proof" in out


def test_a_head_with_nothing_and_one_with_a_strong_effect_from_end_to_end(inkjet, tmp_path, monkeypatch):
    """The whole chain, nothing of it replaced but the corpus: eight recordings each, to be quick."""
    few = [
        Draw(0, "null", (), "none", True, 1),
        Draw(1, "effect", ("feedthrough",), "strong", True, 1),
    ]
    monkeypatch.setattr(protocol, "corpus", lambda *asked: few)
    status, out, err = inkjet("prove", "--quick", "--workers", "2", "--out", "proof", "--json", "score.json")
    assert status == 0, err
    sealed, asked = err.index("Sealed: SHA-256"), err.index("diagnose blind")
    assert sealed < asked < err.index("Committed: SHA-256") < err.index("Unsealed")
    score = json.loads((tmp_path / "score.json").read_text())
    figures = {figure["name"]: figure for figure in score["figures"]}
    assert figures["meagre campaigns: false alarms"]["hits"] == 0
    assert figures["meagre campaigns: confidently wrong"]["hits"] == 0
    assert figures["refused or failed"]["hits"] == 0
    judged = [json.loads(file.read_text())["judged"] for file in (tmp_path / "proof" / "judged").iterdir()]
    assert max(found["closure"] or 0.0 for found in judged) > 0.9
    assert "blind proof" in (tmp_path / "proof" / "report.html").read_text()
    again, out_again, err = inkjet("prove", "--quick", "--out", "proof")
    assert again == 0, err
    assert out_again == out
