"""A proof of some of a corpus's cases."""

import pytest

from inkjet_env.experiments.proof.chosen_cases import chosen_cases, size_of
from inkjet_env.experiments.proof.corpus import corpus
from inkjet_env.experiments.proof.sealing import Settings

DRAWS = corpus(1, "full", ("stranger",), ("bouc_wen",))


def test_all_of_a_kind_of_name_that_is_not_given():
    assert chosen_cases(DRAWS, ()) == DRAWS
    strong = chosen_cases(DRAWS, ("strong", "effect", "whole", "creep", "feedthrough"))
    assert {draw.effects for draw in strong} == {("creep",), ("feedthrough",)}
    assert {(draw.family, draw.strength, size_of(draw)) for draw in strong} == {("effect", "strong", "whole")}
    assert len(strong) == 10
    assert {draw.family for draw in chosen_cases(DRAWS, ("slow",))} == {"null", "effect"}


def test_the_first_of_each_kind():
    few = chosen_cases(DRAWS, ("creep", "effect"), first=2)
    kinds = [(draw.strength, size_of(draw)) for draw in few]
    assert max(map(kinds.count, kinds)) == 2
    assert [draw.number for draw in few] == sorted(draw.number for draw in few)


def test_an_unknown_name_is_told_and_what_is_chosen_is_written_down():
    with pytest.raises(ValueError, match="only must be one of strong, medium"):
        Settings(1, "full", only=("heavy",))
    assert "only" not in Settings(1, "full").to_json()  # so that earlier proofs stay what they are
    assert Settings(1, "full", only=("creep", "base"), first=2).to_json()["only"] == ["base", "creep"]


def test_names_that_no_case_has_together_are_refused():
    with pytest.raises(ValueError, match="no case of this corpus has one name of each kind"):
        chosen_cases(DRAWS, ("creep", "null"))
