"""Verdicts held against what was hidden: right or wrong, confusion matrix, F1, shares with their intervals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

OUTCOMES = ("none", "set", "wrong set", "unknown", "several", "refused")
"""Columns of a confusion matrix beside the effects: "set" holds the truth, "several" are two named or more."""


@dataclass(frozen=True)
class VerdictRecord:
    """What a diagnosis said of a campaign, and what was hidden in it.

    Attributes
    ----------
    truth : frozenset of str
        Ids of the hidden effects.
    verdict : {"none", "named", "set", "unknown", "refused"}
        The last: the campaign could not be diagnosed.
    found : frozenset of str
        Ids of the named effects.
    candidates : tuple of frozenset of str
        Groups that were not told apart, each with the effect of ``found`` that stands for it.
    """

    truth: frozenset[str]
    verdict: str
    found: frozenset[str]
    candidates: tuple[frozenset[str], ...] = ()

    @property
    def allowed(self) -> frozenset[str]:
        """The named effects, each exchanged for the hidden one where its group holds that."""
        told = self.found
        for group in self.candidates:
            if told & group and self.truth & group:
                told = (told - group) | (self.truth & group)
        return told

    @property
    def judged(self) -> str:
        """One of: right, in the set, partly, wrong, none, unknown, refused."""
        if self.verdict in ("none", "unknown", "refused"):
            return "right" if self.verdict == "none" and not self.truth else self.verdict
        if self.allowed == self.truth:
            return "right" if self.verdict == "named" else "in the set"
        return "partly" if self.allowed & self.truth else "wrong"

    @property
    def column(self) -> str:
        """Where it stands in a confusion matrix of single effects."""
        if self.verdict == "set":
            return "set" if self.judged == "in the set" else "wrong set"
        if self.verdict == "named":
            return min(self.found) if len(self.found) == 1 else "several"
        return self.verdict


def confusion(told: Iterable[VerdictRecord], effects: Sequence[str]) -> dict[str, dict[str, int]]:
    """Counts by hidden effect and by what was said, for campaigns with nothing or one thing hidden."""
    columns = (*effects, *OUTCOMES)
    table = {row: dict.fromkeys(columns, 0) for row in ("nothing", *effects)}
    for one in told:
        if len(one.truth) <= 1:
            table[min(one.truth, default="nothing")][one.column] += 1
    return table


def f1(told: Iterable[VerdictRecord]) -> float:
    """Harmonic mean of precision and recall of effect names, all campaigns together; unknown and none name nothing."""
    hits = named = hidden = 0
    for one in told:
        said = one.allowed if one.verdict in ("named", "set") else frozenset()
        hits += len(said & one.truth)
        named += len(said)
        hidden += len(one.truth)
    return 2 * hits / (named + hidden) if named + hidden else float("nan")


def share(hits: int, of: int, confidence: float = 0.9) -> tuple[float, float, float]:
    """A share with its Wilson interval; all of 0 to 1 where there is nothing to count."""
    from scipy.stats import binomtest

    if of == 0:
        return float("nan"), 0.0, 1.0
    ends = binomtest(hits, of).proportion_ci(confidence, method="wilson")
    return hits / of, float(ends.low), float(ends.high)
