"""How probable each explanation of a mismatch is, over heads like those of the proof.

Two questions are answered one after the other. Is what was found right at all? Eq. (3) of
docs/explanation/diagnosis.md, a logistic regression on what tells physics of the catalogue from physics outside it: the
share ``l`` that it leaves unexplained, the same share ``h`` of recordings that no fit has seen, and, since several laws
together may imitate one that the catalogue lacks, whether it takes several laws, how far these explain the same, the
share ``o`` by which what each explains alone exceeds what they explain together, and whether two act in one stage
(random effects, a hum or a drift, have no law and were each tested by recordings of their own: they do not count):

    P(right) = 1 / (1 + exp(-z)),
    z = β₀ + β₁ (lg l + 1.5) + β₂ (lg h + 1.5) + β₃ [h unknown] + β₄ [several] + β₅ o + β₆ [one stage].          (3)

Below 3 %, where even a right law leaves something, ``l`` and ``h`` count as 3 %.

Which effect is it then? Weights of hypotheses, exp(gain / T), with a temperature that grows with the sum of squares
``e`` that the best one leaves beyond noise, because its equations may be wrong by as much, and with its gain ``g``,
because an equation describes a head to about 2 %:

    T = T₀ + α e + κ g.                                                                                          (2)

The coefficients are in ``calibration.json``; `experiments.publish.calibrate_probabilities` fits them to diagnoses of
concealed heads, among them physics outside the catalogue, of other families than those of version 2 of the
proof.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

NONE_OF_THESE, NOTHING = "none of these", "nothing"
"""Labels besides the ids of effects: physics that the catalogue lacks, and no missing physics at all."""
LEAST_LEFT = 10**-1.5
"""Unexplained share, 3 %, below which less is not more probably right: equations are approximate."""


@dataclass(frozen=True)
class Explanation:
    """What tells whether an explanation of a mismatch is right.

    Attributes
    ----------
    left_over, held_out : float
        Shares of the mismatch that it leaves in fitted and in held-out recordings; the latter NaN if it is unknown.
    stages : tuple of str
        Stage of each of its effects that have a law: all but random ones.
    overlap : float
        What its effects explain each alone, in sum, over what they explain together, less 1; 0 of a single effect.
    """

    left_over: float
    held_out: float
    stages: tuple[str, ...]
    overlap: float = 0.0

    @property
    def features(self) -> tuple[float, ...]:
        """Factors of ``β₀ … β₆`` in Eq. (3)."""
        left, unseen = (math.log10(max(x / LEAST_LEFT, 1.0)) for x in (self.left_over, self.held_out))
        unknown = math.isnan(self.held_out)
        several, twice = len(self.stages) > 1, len(set(self.stages)) < len(self.stages)
        overlap = max(self.overlap, 0.0) if several else 0.0
        return 1.0, left, 0.0 if unknown else unseen, float(unknown), float(several), overlap, float(twice)


@dataclass(frozen=True)
class Calibration:
    """Coefficients of Eqs. (3) and (2), and how often a verdict "none" is right.

    Attributes
    ----------
    right : tuple of float
        ``β₀ … β₆`` of Eq. (3).
    nothing_if_found : float
        Share of heads without any mismatch among those in which something was found.
    if_none : tuple of float
        Of the verdicts "none": shares of heads without a mismatch, and of heads with physics outside the catalogue.
    """

    right: tuple[float, ...]
    nothing_if_found: float
    if_none: tuple[float, float]

    def explained(self, explanation: Explanation) -> float:
        """Probability that an explanation is right, Eq. (3)."""
        z = sum(beta * feature for beta, feature in zip(self.right, explanation.features, strict=True))
        return 1 / (1 + math.exp(-z))

    def probabilities(
        self, weights: Mapping[str, float], explanation: Explanation | None, effects: tuple[str, ...]
    ) -> dict[str, float]:
        """Probability that the effect which explains most of the mismatch is each of these; they sum to 1.

        Parameters
        ----------
        weights : dict of str to float
            Relative weights of the explanations that were found, by the id of the effect that explains most, or
            "none of these" if no effect explains anything; empty if nothing was found.
        explanation : Explanation or None
            The best of them; None if nothing was found.
        effects : tuple of str
            Ids that were looked for.
        """
        if explanation is None:
            nothing, other = self.if_none
            each = (1 - nothing - other) / max(len(effects), 1)
            if not effects:
                other = 1 - nothing
            return {NOTHING: nothing, NONE_OF_THESE: other, **dict.fromkeys(effects, each)}
        right = self.explained(explanation) * (1 - self.nothing_if_found)
        found = {name: right * weight / sum(weights.values()) for name, weight in weights.items()}
        found[NONE_OF_THESE] = found.get(NONE_OF_THESE, 0.0) + 1 - self.nothing_if_found - right
        return {**found, NOTHING: self.nothing_if_found}


@lru_cache
def calibration() -> Calibration:
    """The calibration that comes with the package."""
    written = json.loads(files("inkjet_env.mismatch").joinpath("calibration.json").read_text("utf-8"))
    return Calibration(tuple(written["right"]), written["nothing_if_found"], tuple(written["if_none"]))
