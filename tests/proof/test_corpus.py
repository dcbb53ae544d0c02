from collections import Counter

import pytest

from inkjet_env.experiments.proof.corpus import PUBLISHED_SEED, STAGES, Draw, corpus, opaque_name
from inkjet_env.plant import catalogue

OUTSIDE, BASES = ("friction", "backlash", "jitter"), ("bouc_wen", "preisach")


def test_the_ids_are_those_of_the_catalogue():
    assert {effect.id: effect.stage for effect in catalogue()} == STAGES


def test_the_full_corpus_holds_what_was_promised():
    draws = corpus(1, "full", OUTSIDE, BASES)
    kinds = Counter((d.family, d.strength, d.meagre) for d in draws)
    assert kinds["null", "none", False] == 300
    assert all(kinds["effect", strength, False] == 200 for strength in ("strong", "medium", "faint"))
    assert kinds["outside", "strong", False] == kinds["outside", "medium", False] == 60
    assert kinds["pair", "strong", False] == 100
    assert kinds["base", "none", False] == 40
    assert sum(d.meagre for d in draws) == 40
    assert Counter(d.effects for d in draws if d.family == "effect" and d.strength == "faint") == {
        (name,): 10 for name in STAGES
    }


def test_the_quick_corpus_is_sixty_of_every_kind():
    draws = corpus(1, "quick", OUTSIDE, BASES)
    assert len(draws) == 60
    assert Counter(d.family for d in draws) == {"null": 16, "effect": 33, "outside": 8, "pair": 2, "base": 1}
    whole = [d for d in draws if d.family == "effect" and not d.meagre]
    assert sorted(d.effects[0] for d in whole) == sorted(STAGES)
    assert Counter(d.strength for d in whole) == {"strong": 14, "medium": 6}


def test_pairs_are_of_different_stages_and_none_is_there_twice():
    pairs = [d.effects for d in corpus(1, "full", OUTSIDE, BASES) if d.family == "pair"]
    assert len(set(pairs)) == 100
    assert all(STAGES[a] != STAGES[b] for a, b in pairs)


def test_a_seed_decides_the_corpus_and_another_seed_another():
    assert corpus(5, "quick", OUTSIDE, BASES) == corpus(5, "quick", OUTSIDE, BASES)
    first, second = (corpus(seed, "quick", OUTSIDE, BASES) for seed in (5, PUBLISHED_SEED))
    assert {d.case_seed(0) for d in first}.isdisjoint(d.case_seed(0) for d in second)


def test_every_attempt_has_a_seed_of_its_own():
    draw = corpus(1, "quick", OUTSIDE, BASES)[0]
    assert len({draw.case_seed(attempt) for attempt in range(20)}) == 20


def test_names_tell_nothing_without_the_salt():
    draws = corpus(1, "full", OUTSIDE, BASES)
    names = [opaque_name("salt", d) for d in draws]
    assert len(set(names)) == len(draws)
    assert names != sorted(names)
    assert set(names).isdisjoint(opaque_name("other salt", d) for d in draws)


def test_a_draw_is_read_as_it_was_written():
    draw = corpus(1, "quick", OUTSIDE, BASES)[40]
    assert Draw.from_json(draw.as_json()) == draw


def test_an_unknown_profile_is_refused():
    with pytest.raises(ValueError, match="profile must be one of full, quick"):
        corpus(1, "medium", OUTSIDE, BASES)
