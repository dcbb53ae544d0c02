"""A regression of the residuals: it corrects without explaining, and shows whether anything predictable remains.

Ridge regression of the whitened residuals on what the head does: drive, hysteretic drive, motion, their even and odd
powers, delayed copies, copies passed through the resonator once more, and copies that grow with the order of the
recordings. It is linear in its weights, so that its optimum is always found. It is judged on held-out recordings alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, conditions
from inkjet_env.plant import Resonance
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class DiscrepancyRegression:
    """Result of the regression.

    Attributes
    ----------
    predicted : float
        Gain in log-likelihood of the held-out rows.
    error : float
        Standard error of that gain.
    share : float
        Share of the held-out sum of squares that the regression removes.
    modelled : dict of str to ndarray
        What it adds to each recording, whitened, shape (n,).
    """

    predicted: float
    error: float
    share: float
    modelled: dict[str, Real]


def discrepancy_regression(hypothesis: Hypothesis) -> DiscrepancyRegression:
    """Regress a hypothesis's residuals in the fitted recordings and judge the result on the held-out ones."""
    joint = hypothesis.joint
    scale = max(float(np.abs(o.excitation.drive_V).max()) for o in joint.observed) or 1.0
    speeds = [float(np.abs(_motion(hypothesis, o)).max()) for o in joint.observed if o.excitation.fast]
    size = max(speeds, default=1.0) or 1.0
    columns = {o.name: joint.whitened(o, _features(hypothesis, o, scale, size)) for o in joint.observed}
    seen = np.concatenate([columns[o.name][: o.fitted] for o in joint.seen])
    norms = np.linalg.norm(seen, axis=0)
    norms[norms == 0] = np.inf
    seen = seen / norms
    weights = _ridge(seen, hypothesis.residuals, conditions(joint), joint.settings.selection.ridge_penalties)
    modelled = {name: (table / norms) @ weights for name, table in columns.items()}
    gain = square = power = 0.0
    for o in joint.observed:
        rows = o.rows(held_out=True)
        residuals, added = hypothesis.fit.residuals[o.name][rows], modelled[o.name][rows]
        gain += 0.5 * float(residuals @ residuals - (residuals - added) @ (residuals - added))
        square += float(added @ added)
        power += float(residuals @ residuals)
    return DiscrepancyRegression(gain, float(np.sqrt(square)), 2 * gain / power if power else 0.0, modelled)


def _ridge(columns: Real, target: Real, groups: Sequence[NDArray[np.intp]], penalties: Sequence[float]) -> Real:
    """Weights, shape (k,), with the ridge that predicts left-out conditions best; zero if none predicts anything."""
    folds = [np.concatenate(groups[k::4]) for k in range(min(4, len(groups)))]
    gram, moment = columns.T @ columns, columns.T @ target
    errors = np.zeros(len(penalties))
    for rows in folds:
        out = columns[rows]
        values, vectors = np.linalg.eigh(gram - out.T @ out)
        rotated, image = vectors.T @ (moment - out.T @ target[rows]), out @ vectors
        for k, ridge in enumerate(penalties):
            residuals = target[rows] - image @ (rotated / (np.maximum(values, 0) + ridge))
            errors[k] += float(residuals @ residuals)
    ridge = penalties[int(np.argmin(errors))] if errors.min() < float(target @ target) else np.inf
    if not np.isfinite(ridge):
        return np.zeros(columns.shape[1])
    return np.asarray(np.linalg.solve(gram + ridge * np.eye(len(gram)), moment), dtype=np.float64)


def _motion(hypothesis: Hypothesis, o: ObservedRecording) -> Real:
    """Signal of the channel for a gain of 1, shape (n,), from the head without resonator effects."""
    head, plant = hypothesis.fit.head, hypothesis.fit.head.plant(hypothesis.fit.active.pairs)
    resonance = Resonance(head.printhead.a0, head.printhead.a1, head.printhead.a0)
    return resonance.motion(plant.hysteretic_V(plant.at_ceramic_V(o.excitation), o.excitation), o.excitation)


def _features(hypothesis: Hypothesis, o: ObservedRecording, scale: float, size: float) -> Real:
    """Features, shape (n, k), the same k for every recording.

    ``scale`` and ``size`` are the largest drive in volts and the largest motion of all recordings. Powers are divided
    by them, so that they have the same unit everywhere.
    """
    head, delays = hypothesis.fit.head, hypothesis.joint.settings.selection.delays
    plant, excitation = head.plant(hypothesis.fit.active.pairs), o.excitation
    if o.channel == "drive_monitor":
        return np.zeros((excitation.samples, _count(delays)))
    drive = plant.at_ceramic_V(excitation)
    hysteretic = plant.hysteretic_V(drive, excitation)
    resonance = Resonance(head.printhead.a0, head.printhead.a1, head.printhead.a0)
    gain, place = plant.gain(o.channel), (o.excitation.order - 1) / 30
    v = excitation.sampled(hysteretic)
    u = excitation.drive_V
    slope: Real = np.gradient(u)
    if not excitation.fast:
        shapes = [v, u, slope, v * np.abs(v) / scale, v**2 / scale, v**3 / scale**2, np.abs(u), u**2 / scale]
        slow = [_decayed(slope, k, excitation.periodic) for k in (3, 10, 30, 100, 300)]
        table = np.column_stack([*shapes, *slow, np.full(v.size, place), v * place])
        return np.hstack([table, np.zeros((v.size, _count(delays) - table.shape[1]))])
    y = _motion(hypothesis, o)
    step = 2 * np.pi * head.printhead.frequency_Hz * excitation.step_s
    speed: Real = np.gradient(y) / np.float64(step)
    period = 1 / (head.printhead.frequency_Hz * excitation.step_s)

    def rung(samples: Real) -> Real:
        return resonance.motion(np.ascontiguousarray(excitation.refined(samples)), excitation)

    even_odd = [y**2 / size, y**3 / size**2, y * np.abs(y) / size, y * speed / size, y**2 * speed / size**2,
                speed * np.abs(speed) / size]  # fmt: skip
    pushes: list[Callable[[], Real]] = [
        lambda: u, lambda: np.abs(v), lambda: v**2 / scale, lambda: v**3 / scale**2, lambda: v * np.abs(v) / scale,
        lambda: slope, lambda: np.abs(slope), lambda: slope * np.abs(slope) / scale,
    ]  # fmt: skip
    once_more = [rung(shape * scale / size) for shape in (y, speed, *even_odd)]
    delayed = [_shifted(signal, round(d * period), excitation.periodic) for d in delays for signal in (y, speed)]
    table = np.column_stack(
        [
            gain * np.column_stack([y, speed, *even_odd, *once_more, *(rung(push()) for push in pushes), *delayed]),
            gain * place * np.column_stack([y, speed, *once_more[:2]]),
            gain * place**2 * np.column_stack([y, speed, *once_more[:2]]),
            np.column_stack([u, v, slope, np.abs(slope), np.gradient(slope)]) * gain * size / scale,
        ]
    )
    gauge = np.zeros((v.size, 15))
    return np.hstack([gauge, table])


def _count(delays: Sequence[float]) -> int:
    return 15 + 2 + 6 + 8 + 8 + 2 * len(delays) + 8 + 5


def _decayed(signal: Real, samples: float, periodic: bool) -> Real:
    from inkjet_env.plant.lag import lagged

    return lagged(signal, samples, 1.0, periodic)


def _shifted(signal: Real, samples: int, periodic: bool) -> Real:
    if periodic:
        return np.roll(signal, samples)
    return np.concatenate([np.full(min(samples, signal.size), signal[0]), signal])[: signal.size]
