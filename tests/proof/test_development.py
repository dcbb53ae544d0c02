"""Diagnoses in the open: which cases, of which seeds, and that a written answer is not given again."""

import pytest

from inkjet_env.experiments.concealed_plant import RIG
from inkjet_env.experiments.proof import development
from inkjet_env.experiments.proof.concealment import families
from inkjet_env.experiments.proof.corpus import DEVELOPMENT_SEED, PUBLISHED_SEED, corpus


def test_the_first_of_each_kind_are_as_many_as_asked_for_and_every_kind_is_there():
    draws = corpus(DEVELOPMENT_SEED, "full", *families(RIG))
    kinds = {(d.family, d.effects, d.strength, d.meagre, d.slow_only) for d in draws}
    one, two = (development.first_of_each_kind(draws, first) for first in (1, 2))
    assert len(one) == len(kinds)
    assert {d.number for d in one} < {d.number for d in two}


def test_the_published_seed_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        development.main([str(tmp_path / "answers"), "--seed", str(PUBLISHED_SEED)])
    assert "must stay unseen" in capsys.readouterr().err
    assert not (tmp_path / "answers").exists()


def test_a_case_is_concealed_diagnosed_and_written_once(tmp_path, monkeypatch):
    draws = corpus(DEVELOPMENT_SEED, "full", *families(RIG))
    draw = next(d for d in draws if d.family == "null" and d.meagre)
    case = development.diagnosed(draw, tmp_path)
    assert case["truth"]["effects"] == []
    assert case["answer"]["verdict"]["format"] == "diagnosis/1"
    monkeypatch.setattr(development, "conceal", None)
    assert development.diagnosed(draw, tmp_path) == case
    assert development.read_answers(tmp_path) == [case]
