"""The figures of a verdict: fit before and after, unexplained share, hypotheses, effects with their intervals."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.identification.modelled_recording import ModelledRecording
from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.mismatch.diagnosis import HypothesisScore, NamedEffect
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection.clustered_errors import robust_errors
from inkjet_env.mismatch.selection.discrepancy_regression import DiscrepancyRegression
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis
from inkjet_env.mismatch.selection.rugged_intervals import rugged_reaches
from inkjet_env.mismatch.selection.significance import p_value_bound
from inkjet_env.mismatch.selection.stepwise import Selection, cosine
from inkjet_env.plant import Effect
from inkjet_env.plant.effect import Parameter
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real

NOT_CONVERGED = "The fit did not converge: these values are those at which it stopped, without known intervals."
"""Appended to the sentence of an effect whose fit did not converge."""


def modelled_recordings(
    bare: OutputErrorFit, joint: OutputErrorFit, chosen: Hypothesis, discrepancy: DiscrepancyRegression
) -> tuple[ModelledRecording, ...]:
    """Every recording with the signals of the base model and of the chosen hypothesis.

    Parameters
    ----------
    bare : OutputErrorFit
        Fit whose base model is taken, without random effects.
    joint : OutputErrorFit
        Fit with the random effects that were found.
    chosen : Hypothesis
        The hypothesis of the augmented model.
    discrepancy : DiscrepancyRegression
        Regression of its residuals.

    Returns
    -------
    tuple of ModelledRecording
        Without the voltages measured at the head.
    """
    # Where the noise is not known, it is at most what the regression leaves of the residuals.
    most = math.sqrt(1 - min(max(discrepancy.share, 0.0), 1.0))
    modelled = {"base": bare.modelled(bare.base), "augmented": joint.modelled(chosen.fit)}
    return tuple(
        ModelledRecording(
            o.name,
            o.channel,
            o.unit,
            o.excitation.order,
            o.excitation.step_s,
            o.excitation.drive_V,
            o.told,
            {name: signals[o.name] + (o.told - o.measured) for name, signals in modelled.items()},
            o.fitted,
            joint.noise.rms(o) * (1.0 if joint.noise.known(o) else most),
        )
        for o in joint.observed
        if o.channel != "drive_monitor"
    )


def unexplained_share(base: Hypothesis, chosen: Hypothesis, discrepancy: DiscrepancyRegression) -> float:
    """Share of the base model's mismatch that remains beyond noise; 0 if none remains significantly.

    Parameters
    ----------
    base, chosen : Hypothesis
        Base model without random effects, and the chosen hypothesis.
    discrepancy : DiscrepancyRegression
        Regression of the chosen hypothesis's residuals.
    """
    known, unknown = _beyond_noise(base, chosen), _predicted_beyond(base, chosen, discrepancy)
    residuals, mismatch = known[0] + unknown[0], known[1] + unknown[1]
    share = residuals / max(mismatch, residuals) if residuals > 0 else 0.0
    return max(share, _unevenly(base, chosen)) if chosen.ids else share


def _beyond_noise(base: Hypothesis, chosen: Hypothesis) -> tuple[float, float]:
    """Sums of squares beyond noise, of the residuals and of the mismatch, where the noise is known."""
    joint, settings = base.joint, base.joint.settings.verdict
    known = {o.name for o in joint.seen if joint.noise.known(o)}
    keep = np.concatenate([np.full(o.fitted, o.name in known) for o in joint.seen])
    rows = int(keep.sum())
    if not rows:
        return 0.0, 0.0
    doubt = joint.noise.doubt([o for o in joint.seen if o.name in known])
    residuals = float(np.sum(chosen.residuals[keep] ** 2)) - rows + chosen.columns.shape[1]
    mismatch = float(np.sum(base.residuals[keep] ** 2)) - rows + base.columns.shape[1]
    sure = residuals > settings.excess_standard_deviations * doubt and residuals > settings.least_excess * rows
    return (residuals if sure else 0.0), mismatch


def _unevenly(base: Hypothesis, chosen: Hypothesis) -> float:
    """Share of the mismatch that remains in recordings with significantly larger residuals than most of the same noise.

    The noise level cancels, whose uncertainty may exceed what remains. A voltage measured at the head does not count,
    because its converter's rounding differs with the drive.
    """
    joint, settings = base.joint, base.joint.settings.verdict
    residuals = mismatch = 0.0
    of_the_head = [o for o in joint.seen if joint.noise.known(o) and o.channel != "drive_monitor"]
    for key in sorted({o.noise_key for o in of_the_head}):
        mine = [o for o in of_the_head if o.noise_key == key]
        rows = np.array([o.fitted for o in mine])
        before, after = (
            np.array([float(np.mean(h.fit.residuals[o.name][: o.fitted] ** 2)) for o in mine]) for h in (base, chosen)
        )
        usual = float(np.median(after))
        mismatch += float(np.sum((before - usual) * rows))
        if len(mine) < settings.usual_level_recordings:
            continue
        more = after - usual
        sure = more > settings.excess_standard_deviations * usual * np.sqrt(
            joint.noise.tail(mine[0]) * (2 / rows + np.pi / rows.sum())
        )
        residuals += float(np.sum((more * rows)[sure]))
    return residuals / max(mismatch, residuals) if residuals > 0 else 0.0


def _predicted_beyond(base: Hypothesis, chosen: Hypothesis, discrepancy: DiscrepancyRegression) -> tuple[float, float]:
    """Sums of squares of residuals and mismatch where the noise is not known.

    There the residuals were taken for noise, so only what the discrepancy regression predicts counts.
    """
    gain = error = power = residuals = mismatch = 0.0
    for o in base.joint.observed:
        if base.joint.noise.known(o):
            continue
        seen, unseen = o.rows(held_out=False), o.rows(held_out=True)
        after, added = chosen.fit.residuals[o.name][unseen], discrepancy.modelled[o.name][unseen]
        gain += 0.5 * float(after @ after - (after - added) @ (after - added))
        error += float(added @ added)
        power += float(after @ after)
        residuals += float(np.sum(chosen.fit.residuals[o.name][seen] ** 2))
        mismatch += float(np.sum(base.fit.residuals[o.name][seen] ** 2))
    sure = gain > base.joint.settings.verdict.regression_gain + 2 * math.sqrt(error)
    return (2 * gain / power * residuals if sure else 0.0), mismatch


def compared(selection: Selection) -> tuple[HypothesisScore, ...]:
    """How well each hypothesis explains the recordings, best first; as many as the settings list."""
    rows, listed = [], selection.chosen.joint.settings.verdict.most_listed
    most = max((h.gain for h in selection.compared), default=0.0)
    best = selection.chosen
    start = base_hypothesis(best.joint.root or best.joint)
    for h in selection.compared[:listed]:
        gains, errors = start.predicted.log_likelihood_gain(h.predicted)
        rows.append(
            HypothesisScore(
                h.ids,
                h.gain,
                float(gains.sum()),
                float(np.sqrt(np.sum(errors**2))),
                h.gain / most if most > 0 else 0.0,
                cosine(start, best, h) if best.ids else math.nan,
                " ".join(e.description(v, _signal_unit(h.joint)) for e, v in h.fit.active.pairs),
            )
        )
    return tuple(rows)


def overlap(selection: Selection) -> float:
    """What the chosen effects gain each alone, in sum, over what they gain together, less 1; 0 of a single effect.

    Effects that explain different things overlap little, and may gain less alone. An effect that was not fitted alone
    to its end counts with what it gained by then.
    """
    chosen = selection.chosen
    alone = {h.ids[0]: h.gain for h in selection.compared if len(h.ids) == 1}
    if len(chosen.ids) < 2 or chosen.gain <= 0:
        return 0.0
    return sum(max(alone.get(name, 0.0), 0.0) for name in chosen.ids) / chosen.gain - 1


def closest(base: Hypothesis, selection: Selection) -> tuple[tuple[str, ...], float] | None:
    """Ids of the hypothesis that explains most of the fitted recordings' mismatch, and the share that it explains."""
    best = max(selection.compared, key=lambda h: h.gain, default=None)
    if best is None or best.gain <= 0:
        return None
    known = all(base.joint.noise.known(o) for o in base.joint.seen)
    start = base_hypothesis(best.joint)
    mismatch = 0.5 * start.excess if known else start.fit.nll
    return best.ids, min(best.gain / max(mismatch, best.gain), 1.0)


def _errors(chosen: Hypothesis) -> Real:
    """Standard errors of the effects' coordinates, shape (k,), base parameters projected out.

    They are `robust_errors`, the classical ones by Eq. (2) of docs/explanation/identification.md with ``S = s² I``,
    widened where residuals exceed the noise.
    """
    q, _ = chosen.joint.basis
    jacobian = chosen.fit.jacobian - q @ (q.T @ chosen.fit.jacobian)
    size = np.linalg.norm(jacobian, axis=0)
    determined = size > 1e-9 * np.maximum(np.linalg.norm(chosen.fit.jacobian, axis=0), 1e-300)
    errors: Real = np.full(size.size, np.inf)
    own, triangle = np.linalg.qr(jacobian[:, determined] / size[determined])
    weights = np.linalg.pinv(triangle, rcond=1e-6)  # the root of 1e-12, for the covariance
    loud = max(1.0, 2 * chosen.fit.nll / max(chosen.residuals.size - chosen.columns.shape[1], 1))  # s² of Eq. (2)
    classical = np.linalg.norm(weights, axis=1) * math.sqrt(loud)  # Eq. (2)
    errors[determined] = (
        robust_errors(classical, weights, own, chosen.predicted, chosen.joint.settings.selection) / size[determined]
    )
    return errors


def _beyond(p: Parameter, theta: float, low: float, high: float, at_bound: float) -> float:
    """Infinity on the side where a coordinate is at the end of its range; 0 if it is not, or if that end is natural.

    The natural ends are an effect that is off, 0 and, for a share, 1.
    """
    for bound, other in ((low, high), (high, low)):
        if bound == 0 and p.scale != "log":
            continue
        near = abs(theta - bound) <= at_bound * min(high - low, abs(bound) or math.inf) and low < high
        if near and p.value(bound) not in ((0.0, 1.0) if p.unit == "1" else (0.0,)):
            return math.copysign(math.inf, p.value(bound) - p.value(other))
    return 0.0


def _surely(effect: Effect, values: dict[str, float], estimates: dict[str, Estimate]) -> dict[str, float]:
    """The values, with strengths whose intervals include 0 set to 0; unchanged if that is so for every strength."""
    surely = {name for name, e in estimates.items() if not e.low <= 0 <= e.high}
    vain = set(effect.strengths) - surely
    if vain == set(effect.strengths):
        return values
    return {name: 0.0 if name in vain else value for name, value in values.items()}


def _signal_unit(joint: OutputErrorFit) -> str:
    """Unit of a fast sensor's signal if there is one, else of the first recording's signal."""
    return next((o.unit for o in joint.observed if o.excitation.fast), joint.observed[0].unit)


def named_effects(joint: OutputErrorFit, chosen: Hypothesis, selection: Selection) -> list[NamedEffect]:
    """The chosen effects with intervals and evidence, without the parameters of terms that are off.

    If the fit has not converged, its sensitivities say nothing about how far the values may be off: the intervals are
    infinite then, and the sentence says why. A value at the end of its range is bounded on one side only, which the
    sentence says as well. If the other effects cannot be simulated alone, the gain of an effect is
    that of all of them together.

    Parameters
    ----------
    joint : OutputErrorFit
        Recordings, noise and base model.
    chosen : Hypothesis
        The selected hypothesis.
    selection : Selection
        How it was selected, with the p-values of its effects.
    """
    reaches = rugged_reaches(chosen, QUANTILE_90 * _errors(chosen), QUANTILE_90)
    idle = chosen.fit.idle
    active = chosen.fit.active
    lower, upper = joint.limits(active.effects)
    result = []
    for effect, values in active.pairs:
        rest, mine = active.minus(effect), active.slices[effect.id]
        smaller = base_hypothesis(joint)
        if rest.ids:
            with suppress(*NUMERICAL):
                smaller = Hypothesis(joint.fit(rest, chosen.fit.head), joint)
        estimates, rails = {}, []
        for k, p in enumerate(effect.parameters, start=mine.start):
            if idle[k] and lower[k] < upper[k]:
                continue
            ends = [p.value(float(np.clip(active.theta[k] + s * reaches[k], lower[k], upper[k]))) for s in (-1, 1)]
            if not chosen.fit.converged:
                ends = [-math.inf, math.inf]
            if beyond := _beyond(
                p, active.theta[k], float(lower[k]), float(upper[k]), joint.settings.selection.at_bound
            ):
                ends.append(beyond)
                rails.append(p.name)
            estimates[p.name] = Estimate(values[p.name], min(ends), max(ends))
        gain, free = smaller.fit.nll - chosen.fit.nll, int(np.count_nonzero(~idle[mine]))
        p_value = selection.p_values.get(effect.id, p_value_bound(gain, free, len(selection.compared)))
        unit = _signal_unit(joint)
        sentence = effect.description(_surely(effect, values, estimates), unit)
        if not chosen.fit.converged:
            sentence = f"{sentence} {NOT_CONVERGED}"
        elif rails:
            ends_at = f"{' and '.join(rails)} {'is' if len(rails) == 1 else 'are'} at the end of the range"
            sentence = f"{sentence} {ends_at} that was searched and may lie beyond."
        result.append(NamedEffect(effect, sentence, gain, p_value, estimates, values, unit))
    return result
