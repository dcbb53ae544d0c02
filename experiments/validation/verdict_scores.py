"""Scores of verdicts against the hidden truth: right or wrong, confusion matrix, F1, proportions with intervals."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

OUTCOMES = ("none", "set", "wrong set", "unknown", "several", "refused")
"""Columns of a confusion matrix besides the effects: a "set" contains the truth; "several" means two or more named."""


@dataclass(frozen=True)
class VerdictRecord:
    """The verdict on a campaign, and the effects hidden in it.

    Attributes
    ----------
    truth : frozenset of str
        Ids of the hidden effects.
    verdict : {"none", "named", "set", "unknown", "refused"}
        Verdict of the diagnosis; "refused" means that the campaign could not be diagnosed.
    found : frozenset of str
        Ids of the named effects.
    candidates : tuple of frozenset of str
        Groups of indistinguishable effects, each including the effect of ``found`` that represents it.
    """

    truth: frozenset[str]
    verdict: str
    found: frozenset[str]
    candidates: tuple[frozenset[str], ...] = ()

    @functools.cached_property
    def allowed(self) -> frozenset[str]:
        """The named effects, each replaced by the hidden one if its group contains that."""
        names = self.found
        for group in self.candidates:
            if names & group and self.truth & group:
                names = (names - group) | (self.truth & group)
        return names

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
        """Its column in a confusion matrix of single effects."""
        if self.verdict == "set":
            return "set" if self.judged == "in the set" else "wrong set"
        if self.verdict == "named":
            return min(self.found) if len(self.found) == 1 else "several"
        return self.verdict


def confusion(records: Iterable[VerdictRecord], effects: Sequence[str]) -> dict[str, dict[str, int]]:
    """Counts by hidden effect and by verdict, for campaigns with at most one hidden effect."""
    columns = (*effects, *OUTCOMES)
    table = {row: dict.fromkeys(columns, 0) for row in ("nothing", *effects)}
    for one in records:
        if len(one.truth) <= 1:
            table[min(one.truth, default="nothing")][one.column] += 1
    return table


def f1(records: Iterable[VerdictRecord]) -> float:
    """Harmonic mean of precision and recall of effect names, pooled over campaigns; unknown and none name no effect."""
    hits = named = hidden = 0
    for one in records:
        said = one.allowed if one.verdict in ("named", "set") else frozenset()
        hits += len(said & one.truth)
        named += len(said)
        hidden += len(one.truth)
    return 2 * hits / (named + hidden) if named + hidden else float("nan")


def share(hits: int, of: int, confidence: float = 0.9) -> tuple[float, float, float]:
    """A proportion with its Wilson interval; NaN with the interval 0 to 1 if there is nothing to count."""
    from scipy.stats import binomtest

    if of == 0:
        return float("nan"), 0.0, 1.0
    ends = binomtest(hits, of).proportion_ci(confidence, method="wilson")
    return hits / of, float(ends.low), float(ends.high)
