"""Which cases of a corpus a proof holds, if not all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from inkjet_env.experiments.proof.corpus import STAGES, STRENGTHS, Draw
from inkjet_env.naming import check_name

FAMILIES = ("null", "effect", "outside", "base", "pair")
SIZES = ("whole", "meagre", "slow")
"""A whole campaign, eight recordings of one channel, or the strain gauge's alone."""


def size_of(draw: Draw) -> str:
    """Size of a case's campaign, one of `SIZES`."""
    return "meagre" if draw.meagre else "slow" if draw.slow_only else "whole"


def check_only(only: Sequence[str]) -> None:
    """Raise ``ValueError`` unless every name is an effect's id, a strength, a family or a size."""
    for name in only:
        check_name("only", name, (*STRENGTHS, *FAMILIES, *SIZES, *STAGES))


def chosen_cases(draws: Sequence[Draw], only: Sequence[str], first: int = 0) -> list[Draw]:
    """The cases that have one of the names of each kind: effects, strengths, families, sizes.

    Parameters
    ----------
    draws : sequence of Draw
        The corpus.
    only : sequence of str
        Names; of a kind of which none is given, all.
    first : int
        Number of cases of each family, effects, strength and size, the first of the corpus; 0: all.

    Raises
    ------
    ValueError
        No case has them all.
    """
    kinds: tuple[tuple[Sequence[str], Callable[[Draw], Sequence[str]]], ...] = (
        (tuple(STAGES), lambda draw: draw.effects),
        (STRENGTHS, lambda draw: [draw.strength]),
        (FAMILIES, lambda draw: [draw.family]),
        (SIZES, lambda draw: [size_of(draw)]),
    )
    for names, of in kinds:
        if wanted := set(only).intersection(names):
            draws = [draw for draw in draws if wanted.intersection(of(draw))]
    if not draws:
        raise ValueError(
            f"--only {','.join(only)}: no case of this corpus has one name of each kind. Give fewer names."
        )
    return first_of_each_kind(draws, first) if first else list(draws)


def first_of_each_kind(draws: Sequence[Draw], first: int) -> list[Draw]:
    """The first cases of each family, effects, strength and size."""
    seen: Counter[tuple[object, ...]] = Counter()
    chosen = []
    for draw in draws:
        kind = (draw.family, draw.effects, draw.strength, size_of(draw))
        seen[kind] += 1
        if seen[kind] <= first:
            chosen.append(draw)
    return chosen
