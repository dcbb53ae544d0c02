"""The remainder beside a hypothesis: fitted to what it leaves in the fitted recordings, kept where it predicts others.

Gauss–Newton steps in the weights of Eq. (12) of `inkjet_env.plant.remainder` and in the base parameters: near a set of
weights the signal is linear in them, with the sensitivities of the head with its effects, by finite differences.
Features are added in the order of orthogonal matching pursuit. The fewest with which left-out conditions are predicted
nearly best are used, with a ridge penalty. Whether a channel keeps its remainder is decided by full simulations of
held-out recordings alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification.noise import NoiseModel
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, finer
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection.feature_pursuit import FeaturePursuit
from inkjet_env.mismatch.selection.hypotheses import Hypothesis
from inkjet_env.mismatch.settings import RemainderSettings
from inkjet_env.plant import Excitation, Plant
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.plant.head_motion import HeadMotion
from inkjet_env.plant.remainder import ChannelRemainder, RefittedBase, Remainder, Term
from inkjet_env.plant.remainder_features import feature, push_names, shown_names
from inkjet_env.typing import Real

DIFFERENCE = 1e-4
"""Finite-difference step of a push, as a share of the largest hysteretic drive."""
SINGULAR = 1e-6
"""Share of a feature that base parameters cannot represent, below which it is left to them."""


@dataclass(frozen=True, eq=False)
class FittedRemainder:
    """A remainder that predicts held-out recordings.

    Attributes
    ----------
    remainder : Remainder
        The model, of those channels in which it predicts.
    gain, gain_error : float
        Gain in log-likelihood of the held-out recordings, and its standard error.
    share : float
        Share of the held-out sum of squared residuals of these channels that it removes, in units of the noise.
    modelled : dict of str to ndarray
        Signal of every recording with the remainder, in the channel's unit, shape (n,).
    carrier : tuple of str
        Ids of the effects of the head that carries it; empty: the base model.
    """

    remainder: Remainder
    gain: float
    gain_error: float
    share: float
    modelled: dict[str, Real]
    carrier: tuple[str, ...]


def fit_remainder(hypothesis: Hypothesis) -> FittedRemainder | None:
    """Fit a remainder to what a hypothesis leaves; None if no channel's held-out recordings are predicted better."""
    joint = _with_plain_noise(hypothesis)
    found = {}
    for channel in sorted({o.channel for o in joint.seen if not o.still} - {"drive_monitor"}):
        if any(o.channel == channel and o.fitted < o.excitation.samples for o in joint.observed):
            try:
                own = _channel_remainder(joint, hypothesis.fit, channel)
            except NUMERICAL:
                continue
            if own is not None and not own.is_zero:
                found[channel] = own
    if not found:
        return None
    try:
        return _accepted(joint, hypothesis.fit, Remainder(found))
    except NUMERICAL:
        return None


def best_beside(hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, FittedRemainder | None]:
    """The hypothesis that predicts held-out recordings best, with a remainder beside it where that helps; and both.

    A minor effect may imitate part of what a remainder predicts better. The first hypothesis stays unless another one
    predicts clearly better.
    """
    found: list[tuple[float, Hypothesis, FittedRemainder | None]] = []
    for h in hypotheses:
        remainder = fit_remainder(h)
        modelled = h.joint.modelled(h.fit) if remainder is None else remainder.modelled
        found.append((_heldout_power(h, modelled), h, remainder))
    least_fall = hypotheses[0].joint.settings.remainder.least_fall
    best = min(found, key=lambda one: one[0])
    chosen = best if best[0] < (1 - least_fall) ** 2 * found[0][0] else found[0]
    return chosen[1], chosen[2]


def _heldout_power(h: Hypothesis, modelled: Mapping[str, Real]) -> float:
    """Sum of squares of what is left of held-out recordings, each in units of its noise."""
    parts = [
        (o.measured - modelled[o.name])[o.fitted :] / h.joint.noise.rms(o)
        for o in h.joint.observed
        if o.channel != "drive_monitor"
    ]
    left = np.concatenate(parts)
    return float(left @ left)


def _with_plain_noise(hypothesis: Hypothesis) -> OutputErrorFit:
    """The recordings with white noise wherever the noise is unknown.

    There its spectrum is that of the very residuals that the remainder is to predict: whitening would hide them.
    """
    joint = hypothesis.joint
    unknown = {o.noise_key for o in joint.observed if not joint.noise.known(o)}
    if not unknown:
        return joint
    models = dict(joint.noise.models)
    for key in sorted(unknown):
        models[key] = NoiseModel(np.ones(1), models[key].rms, models[key].rms, models[key].source)
    same_key = {o.name for o in joint.observed if o.noise_key in unknown}
    levels = {name: level for name, level in joint.noise.levels.items() if name not in same_key}
    plain = replace(joint.noise, models=models, levels=levels)
    return joint.anew(noise=plain, base=joint.base, around=joint.around)


def _accepted(joint: OutputErrorFit, fit: FitResult, remainder: Remainder) -> FittedRemainder | None:
    """The remainder of those channels whose held-out recordings it predicts better."""
    settings = joint.settings.remainder
    before, after = joint.modelled(fit), joint.modelled(fit, remainder)
    kept, gain, variance, power, modelled = {}, 0.0, 0.0, 0.0, dict(before)
    for channel, own in remainder.channels.items():
        mine = [o for o in joint.observed if o.channel == channel]
        unseen = [o for o in mine if o.rows(held_out=True).start < o.excitation.samples]
        old, new = (_heldout_rms(unseen, signals) for signals in (before, after))
        gains, error, square = _gain(joint, fit, unseen, before, after)
        helped = int(np.count_nonzero(gains > 0))
        worth = new < (1 - settings.least_fall) * old and 2 * helped > gains.size
        if not worth or not gains.sum() > settings.standard_errors * error:
            continue
        kept[channel] = own
        gain, variance, power = gain + float(gains.sum()), variance + error**2, power + square
        modelled |= {o.name: after[o.name] for o in mine}
    if not kept:
        return None
    return FittedRemainder(Remainder(kept), gain, math.sqrt(variance), 2 * gain / power, modelled, fit.ids)


def _gain(
    joint: OutputErrorFit,
    fit: FitResult,
    unseen: Sequence[ObservedRecording],
    before: Mapping[str, Real],
    after: Mapping[str, Real],
) -> tuple[Real, float, float]:
    """Gain in log-likelihood of each held-out condition, the standard error of their sum, sum of squares before."""
    gains: dict[int, float] = {}
    square = power = 0.0
    for o in unseen:
        rows = o.rows(held_out=True)
        was, now = (joint.whitened(o, o.measured - s[o.name], fit.active.pairs)[rows] for s in (before, after))
        gains[o.condition] = gains.get(o.condition, 0.0) + 0.5 * float(was @ was - now @ now)
        square += float(np.sum((was - now) ** 2))
        power += float(was @ was)
    each = np.array([gains[number] for number in sorted(gains)])
    return each, math.sqrt(square), power


def _heldout_rms(unseen: Sequence[ObservedRecording], signals: dict[str, Real]) -> float:
    parts = [(o.measured - signals[o.name])[o.rows(held_out=True)] for o in unseen]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _channel_remainder(joint: OutputErrorFit, fit: FitResult, channel: str) -> ChannelRemainder | None:
    """The remainder of one channel with its base parameters, by ridge regression of the fitted residuals.

    All channels determine the base parameters, but only this one has features.
    """
    settings, pairs = joint.settings.remainder, fit.active.pairs
    plant, states = fit.head.plant(pairs), fit.end.states
    seen = [o for o in joint.seen if o.channel == channel]
    rows = np.concatenate([np.full(o.fitted, o.channel == channel) for o in joint.seen])
    coarse = finer(seen, min(settings.substeps, max(o.excitation.substeps for o in seen)))
    shots = [replace(o.excitation, start=states.get(o.name, (0.0, 0.0))) for o in coarse]
    runs = [_Run.of(plant, shot) for shot in shots]
    scales_V = _largest([run.motion.largest_V(o.fitted) for run, o in zip(runs, coarse, strict=True)])
    if min(scales_V.values()) <= 0:
        return None
    times = _times(shots, plant.printhead.frequency_Hz, settings)
    names = _Names(push_names(times) if shots[0].fast else [], shown_names(times, shots[0].fast))
    features = [run.features(ChannelRemainder(scales_V, {}, {}, times), names) for run in runs]
    ends = [o.fitted * o.excitation.substeps for o in coarse]
    largest = np.max([np.abs(t[:end]).max(axis=0) for t, end in zip(features, ends, strict=True)], axis=0)
    features = [table / np.where(largest > 0, largest, np.inf) for table in features]
    fixed, r = joint.basis
    still = _residuals(joint, fit, joint.seen, None)
    weights, moved = np.zeros(len(names.all)), np.zeros(fixed.shape[1])
    used, ridge, least, best = None, math.inf, math.inf, None
    for _ in range(settings.rounds):  # Gauss–Newton: pushes may be large enough for the head's response to be nonlinear
        base = _refitted(fit.head, fit.head.moved(np.linalg.lstsq(r, moved, rcond=1e-12)[0]), channel)
        trial = ChannelRemainder(scales_V, *names.terms(weights, largest), times, base=base)
        left = still - fixed @ moved
        left[rows] = _residuals(joint, fit, seen, Remainder({channel: trial}) if weights.any() else None)
        square = float(left @ left)
        if not square < (1 - settings.enough) * least:
            break
        least, best = square, _limited(trial, features, weights, names, settings.slack)
        around = replace(plant.refitted(trial, channel), effects=plant.effects) if weights.any() else plant
        tables = [
            replace(run, plant=around, hysteretic_V=around.hysteretic_V(run.drive_V, run.excitation)).sensitivities(
                table, weights, names, scales_V
            )
            for run, table in zip(runs, features, strict=True)
        ]
        columns = np.zeros((rows.size, weights.size))
        columns[rows] = np.concatenate(
            [joint.whitened(o, t, pairs)[: o.fitted] for o, t in zip(seen, tables, strict=True)]
        )
        norms = np.linalg.norm(columns - fixed @ (fixed.T @ columns), axis=0)
        norms[norms <= SINGULAR * np.linalg.norm(columns, axis=0)] = np.inf  # the base parameters suffice
        columns = columns / norms
        norms[np.isinf(norms)] = 0.0
        target = left + columns @ (weights * norms) + fixed @ moved
        norms[norms == 0] = np.inf
        problem = FeaturePursuit(np.column_stack([fixed, columns]), target, fixed.shape[1], settings)
        if used is None:
            used, ridge = problem.selected(_folds(joint.seen, settings), rows)
        solution = problem.solved(used, ridge)
        moved, weights = solution[: fixed.shape[1]], solution[fixed.shape[1] :] / norms
        if not weights.any():
            break
    return best


def _largest(found: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {name: max(one[name] for one in found) for name in found[0]}


def _refitted(before: Head, after: Head, channel: str) -> RefittedBase:
    head = after.printhead
    change = after.offsets.get(channel, 0.0) - before.offsets.get(channel, 0.0)
    gain = after.gains.get(channel, head.b1)
    return RefittedBase(head.a0, head.a1, head.b1, tuple(head.coefficients), gain, change)


def _limited(
    own: ChannelRemainder, features: Sequence[Real], weights: Real, names: _Names, slack: float
) -> ChannelRemainder:
    """A remainder whose two sums may exceed their largest magnitudes in these recordings by a little only."""
    count = len(names.pushed)
    push_V = max(float(np.abs(table[:, :count] @ weights[:count]).max(initial=0.0)) for table in features)
    shown = max(float(np.abs(table[:, count:] @ weights[count:]).max(initial=0.0)) for table in features)
    return replace(own, most_push_V=slack * push_V, most_shown=slack * shown)


def _residuals(
    joint: OutputErrorFit, fit: FitResult, chosen: Sequence[ObservedRecording], remainder: Remainder | None
) -> Real:
    """Whitened residuals of the fitted rows with a remainder, shape (rows,)."""
    signals, pairs = joint.signals(fit.end, chosen, remainder), fit.active.pairs
    return np.concatenate([joint.whitened(o, o.measured - signals[o.name], pairs)[: o.fitted] for o in chosen])


@dataclass(frozen=True, eq=False)
class _Names:
    """Names of the features that are pushed, and of those that are shown: the order of the weights."""

    pushed: Sequence[str]
    shown: Sequence[str]

    @property
    def all(self) -> list[str]:
        return [*self.pushed, *self.shown]

    def terms(self, weights: Real, largest: Real) -> tuple[dict[str, Term], dict[str, Term]]:
        """Terms that are pushed and shown, of features with these weights, 0 if not used, and largest values."""
        terms = [Term(float(w), float(m)) for w, m in zip(weights, largest, strict=True)]
        push = {name: term for name, term in zip(self.pushed, terms, strict=False) if term.weight}
        shown = {n: t for n, t in zip(self.shown, terms[len(self.pushed) :], strict=True) if t.weight}
        return push, shown


@dataclass(frozen=True, eq=False)
class _Run:
    """A free-run simulation of one recording, and its sensitivities to the weights of a remainder."""

    plant: Plant
    excitation: Excitation
    drive_V: Real
    hysteretic_V: Real
    motion: HeadMotion

    @classmethod
    def of(cls, plant: Plant, excitation: Excitation) -> _Run:
        drive_V = plant.at_ceramic_V(excitation)
        hysteretic_V = plant.hysteretic_V(drive_V, excitation)
        return cls(plant, excitation, drive_V, hysteretic_V, plant.head_motion(drive_V, hysteretic_V, excitation))

    def _signal(self, hysteretic_V: Real) -> Real:
        return self.plant.shown(self.plant.motion_under(hysteretic_V, self.excitation), self.drive_V, self.excitation)

    def features(self, empty: ChannelRemainder, names: _Names) -> Real:
        """All features at the nodes, shape (nodes, k)."""
        scaled = self.motion.scaled(empty.scales_V)
        return np.column_stack([feature(name, scaled, empty.times) for name in names.all])

    def sensitivities(self, features: Real, weights: Real, names: _Names, scales_V: Mapping[str, float]) -> Real:
        """Derivative of the signal with respect to each weight, shape (n, k), at these weights, shape (k,)."""
        count, size = len(names.pushed), DIFFERENCE * scales_V["hysteretic"]
        columns = np.empty((self.excitation.samples, features.shape[1]))
        columns[:, count:] = self.excitation.sampled(features[:, count:])
        if count:
            around_V = self.hysteretic_V + features[:, :count] @ weights[:count]
            here = self._signal(around_V)
            for k in range(count):
                columns[:, k] = (self._signal(around_V + size * features[:, k]) - here) / size
        return columns


def _times(
    shots: Sequence[Excitation], frequency_Hz: float, settings: RemainderSettings
) -> dict[str, tuple[float, ...]]:
    """Delays, time constants and thresholds of the copies.

    Where a period has few samples, what the drive does between them matters, and copies come earlier too.
    """
    step_s = min(shot.step_s for shot in shots)
    longest_s = max(shot.step_s * shot.samples for shot in shots)
    period_s = 1 / frequency_Hz if shots[0].fast else 0.0
    coarse = shots[0].fast and period_s < settings.coarse_samples * step_s
    tap_s = step_s if coarse or not shots[0].fast else step_s * round(period_s / settings.coarse_samples / step_s)
    taps = (-3, -2, -1, 1, 2, 3) if coarse else (1, 2, 3)
    around = (-1, 1) if coarse else ()
    return {
        "drive_delays_s": tuple(k * tap_s for k in taps),
        "motion_delays_s": (*(k * step_s for k in around), *(d * period_s for d in settings.delays if period_s)),
        "lags_s": tuple(float(t) for t in np.geomspace(3 * step_s, max(longest_s / 3, 6 * step_s), settings.lags)),
        "plays": settings.plays,
    }


def _folds(seen: Sequence[ObservedRecording], settings: RemainderSettings) -> list[NDArray[np.intp]]:
    """Rows that are left out together: whole conditions, or stretches of time if there are few conditions."""
    numbers = np.concatenate([np.full(o.fitted, o.condition) for o in seen])
    each = [np.flatnonzero(numbers == number) for number in np.unique(numbers)]
    if len(each) < settings.fewest_conditions:
        return list(np.array_split(np.arange(numbers.size), settings.blocks))
    return [np.concatenate(each[k :: settings.folds]) for k in range(min(settings.folds, len(each)))]
