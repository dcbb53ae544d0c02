"""How probable each explanation of a mismatch is, over heads like those of the proof.

Two questions are answered one after the other. Is what was found right at all? Eq. (3) of
docs/explanation/diagnosis.md, a logistic regression on the figures that tell physics of the catalogue from physics
outside it, the share ``l`` that it leaves unexplained, the same share ``h`` of recordings that no fit has seen, and
whether it needs more than one effect:

    P(right) = 1 / (1 + exp(−β₀ − β₁ (lg l + 1.5) − β₂ (lg h + 1.5) − β₃ [h unknown] − β₄ [several effects])).   (3)

Below 3 %, where even a right law leaves something, ``l`` and ``h`` count as 3 %.

Which effect is it then? Weights of hypotheses, exp(gain / T), with a temperature that grows with the sum of squares
``e`` that the best one leaves beyond noise, because its equations may be wrong by as much:

    T = T₀ + α e.                                                                                                (2)

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
class Calibration:
    """Coefficients of Eqs. (3) and (2), and how often a verdict "none" is right.

    Attributes
    ----------
    right : tuple of float
        ``β₀ … β₄`` of Eq. (3).
    nothing_if_found : float
        Share of heads without any mismatch among those in which something was found.
    if_none : tuple of float
        Of the verdicts "none": shares of heads without a mismatch, and of heads with physics outside the catalogue.
    """

    right: tuple[float, float, float, float, float]
    nothing_if_found: float
    if_none: tuple[float, float]

    def explained(self, left_over: float, held_out: float, several: bool) -> float:
        """Probability that what was found is right, Eq. (3); the share of held-out recordings may be NaN."""
        b0, b1, b2, b3, b4 = self.right
        z = b0 + b1 * math.log10(max(left_over / LEAST_LEFT, 1.0))
        z += b3 if math.isnan(held_out) else b2 * math.log10(max(held_out / LEAST_LEFT, 1.0))
        z += b4 * several
        return 1 / (1 + math.exp(-z))

    def probabilities(
        self,
        weights: Mapping[str, float],
        left_over: float,
        held_out: float,
        effects: tuple[str, ...],
        several: bool = False,
    ) -> dict[str, float]:
        """Probability that the effect which explains most of the mismatch is each of these; they sum to 1.

        Parameters
        ----------
        weights : dict of str to float
            Relative weights of the explanations that were found, by the id of the effect that explains most; empty if
            nothing was found.
        left_over, held_out : float
            Unexplained shares of the best one, in fitted and in held-out recordings.
        effects : tuple of str
            Ids that were looked for.
        several : bool
            Whether the best one has more than one effect.
        """
        if not weights:
            nothing, other = self.if_none
            each = (1 - nothing - other) / max(len(effects), 1)
            if not effects:
                other = 1 - nothing
            return {NOTHING: nothing, NONE_OF_THESE: other, **dict.fromkeys(effects, each)}
        right = self.explained(left_over, held_out, several) * (1 - self.nothing_if_found)
        found = {name: right * weight / sum(weights.values()) for name, weight in weights.items()}
        return {**found, NONE_OF_THESE: 1 - self.nothing_if_found - right, NOTHING: self.nothing_if_found}


@lru_cache
def calibration() -> Calibration:
    """The calibration that comes with the package."""
    written = json.loads(files("inkjet_env.mismatch").joinpath("calibration.json").read_text("utf-8"))
    return Calibration(tuple(written["right"]), written["nothing_if_found"], tuple(written["if_none"]))
