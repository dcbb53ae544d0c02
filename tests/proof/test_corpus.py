from collections import Counter

import pytest

from inkjet_env.experiments.proof.corpus import (
    FULL_SIZE,
    IDS,
    PUBLISHED_SEED,
    SLOW,
    STAGES,
    VERSION,
    Draw,
    corpus,
    opaque_name,
)
from inkjet_env.plant import catalogue

OUTSIDE, BASES = ("stop", "agc", "jitter"), ("bouc_wen", "preisach")
NOISES = ("white", "flicker", "bumps")


def test_the_ids_are_those_of_the_catalogue():
    assert {effect.id: effect.stage for effect in catalogue()} == STAGES


def test_the_full_corpus_holds_what_was_promised():
    draws = corpus(1, "full", OUTSIDE, BASES, NOISES)
    kinds = Counter((d.family, d.strength, d.meagre) for d in draws if not d.slow_only)
    assert kinds["null", "none", False] == 192
    for strength, each in (("strong", 5), ("medium", 4), ("faint", 1)):
        assert kinds["effect", strength, False] == each * len(STAGES)
    assert kinds["outside", "strong", False] == kinds["outside", "medium", False] == 30
    assert kinds["pair", "strong", False] == 50
    assert kinds["base", "none", False] == 20
    assert kinds["null", "none", True] == 16
    assert Counter(d.effects for d in draws if d.family == "effect" and d.meagre) == {(name,): 1 for name in STAGES}
    assert Counter(d.family for d in draws if d.slow_only) == {"null": 6, "effect": 3 * len(SLOW)}
    assert {d.effects[0] for d in draws if d.slow_only and d.effects} == set(SLOW)
    assert len(draws) == FULL_SIZE[VERSION]


def test_every_kind_of_noise_is_drawn_as_often_over_the_nulls_and_over_the_rest():
    draws = corpus(1, "full", OUTSIDE, BASES, NOISES)
    for nulls in (True, False):
        counts = Counter(d.noise for d in draws if (d.family == "null") == nulls)
        assert set(counts) == set(NOISES)
        assert max(counts.values()) - min(counts.values()) <= 1


def test_the_ids_of_version_one_keep_their_meaning():
    assert len(IDS[1]) == 20
    assert set(IDS[1]) < set(IDS[2]) == set(STAGES)


def test_a_draw_of_version_one_is_still_read():
    old = {"number": 3, "family": "null", "effects": [], "strength": "none", "meagre": False, "seed": 1192}
    draw = Draw.from_json(old)
    assert (draw.noise, draw.slow_only) == ("", False)


def test_the_quick_corpus_is_sixty_of_every_kind():
    draws = corpus(1, "quick", OUTSIDE, BASES, NOISES)
    assert len(draws) == 60
    assert Counter(d.family for d in draws) == {"null": 13, "effect": 38, "outside": 6, "pair": 2, "base": 1}
    whole = [d for d in draws if d.family == "effect" and not (d.meagre or d.slow_only)]
    assert sorted(d.effects[0] for d in whole) == sorted(STAGES)
    assert Counter(d.strength for d in whole) == {"strong": 22, "medium": 10}


def test_pairs_are_of_different_stages_and_none_is_there_twice():
    pairs = [d.effects for d in corpus(1, "full", OUTSIDE, BASES) if d.family == "pair"]
    assert len(set(pairs)) == 50
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
