"""Effects beside the named ones that explain little, but beyond doubt: they complete the corrected model."""

from __future__ import annotations

import math
from collections.abc import Sequence

from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, attribute
from inkjet_env.mismatch.selection.score_test import ScoreTest
from inkjet_env.mismatch.selection.stepwise import leftover, supported
from inkjet_env.plant import Effect


def with_minor_effects(
    chosen: Hypothesis, effects: Sequence[Effect], found: ScoreTest, context: FitContext
) -> Hypothesis:
    """The hypothesis with further effects of overwhelming evidence; the same if there are none.

    Each must gain far more than its parameters cost, predict left-out conditions better and held-out recordings too.

    Parameters
    ----------
    chosen : Hypothesis
        The named effects, fitted.
    effects : sequence of Effect
        Effects to choose from, none of them random.
    found : Signatures
        Their signatures, the base parameters projected out.
    context : FitContext
        Processes, random numbers, progress messages and checkpoint.
    """
    joint, settings = chosen.joint.root or chosen.joint, chosen.joint.settings.selection
    for _ in range(settings.most_minor):
        if not leftover(chosen, found, context.rng):
            break
        beside = found.beside(chosen.columns)
        scores = beside.best(chosen.residuals)
        least = max(math.sqrt(2 * settings.minor_gain), settings.further_score * max(scores.values(), default=0.0))
        tried = [e for e in effects if e.id not in chosen.ids and scores.get(e.id, 0.0) >= least]
        better = [
            h
            for h in attribute(joint, chosen, tried, beside, context, settings.alternative_gain)
            if _beyond_doubt(chosen, h)
        ]
        if not better:
            break
        chosen = better[0]
    return chosen


def _beyond_doubt(without: Hypothesis, with_it: Hypothesis) -> bool:
    settings = with_it.joint.settings.selection
    gain, error = held_out_gain(without, with_it)
    return (
        with_it.fit.converged
        and with_it.score - without.score >= settings.minor_gain
        and supported(without, with_it)
        and gain > settings.predicted_standard_errors * error
    )


def held_out_gain(without: Hypothesis, with_it: Hypothesis) -> tuple[float, float]:
    """Gain in log-likelihood of the held-out recordings over another hypothesis of the same noise; its error."""
    gain = square = 0.0
    for o in with_it.joint.observed:
        was, now = (h.fit.residuals[o.name][o.rows(held_out=True)] for h in (without, with_it))
        gain += 0.5 * float(was @ was - now @ now)
        square += float((was - now) @ (was - now))
    return gain, math.sqrt(square)
