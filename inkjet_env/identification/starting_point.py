"""Start of the resonator's fit: a rational fit of the spectra, and a coarse search in case it fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification.model import Fitted, has_free_state
from inkjet_env.identification.work_done import PASSES
from inkjet_env.typing import Real

Complex = NDArray[np.complexfloating[Any, Any]]

ITERATIONS = 12
"""Number of iterations of the rational fit."""
MOST_LINES = 2000
"""Largest number of spectral lines per recording in the rational fit."""
HIGHEST_SHARE = 0.35
"""Highest frequency of the rational fit, as a share of the sampling rate; above it, the signal between samples matters
too much."""
GRID_FREQUENCIES = 40
"""Number of frequencies in the coarse search."""
GRID_DAMPING_RATIOS = (0.01, 0.05, 0.25)
"""Damping ratios in the coarse search."""
GRID_SAMPLES = 12_000
"""Largest number of samples on which candidates are compared."""


def resonator_candidates(fast: Sequence[Fitted], weights: Real | None) -> list[tuple[float, float]]:
    """Pairs ``(a0, a1)`` to start from, the frequency-domain ones first; see `best_start`."""
    if weights is None:  # then the drive stands for the hysteretic drive
        weights = np.eye(fast[0].basis.degree)[0]
    exact = [f for f in fast if f.measurement.initial_state == "periodic"]
    found = []
    for chosen in ([f for f in exact if _broad(f)], exact, fast):
        pair = rational_fit(chosen, weights) if chosen else None
        if pair is not None:
            found.append(pair)
    return found + _grid(fast)


def _broad(f: Fitted) -> bool:
    """Whether the spectrum of a drive has many lines of similar strength, like that of a multisine."""
    lines = np.abs(np.fft.rfft(f.measurement.drive_V))[1:] ** 2
    return bool(lines.sum() ** 2 > 8 * (lines**2).sum())


def rational_fit(fitted: Sequence[Fitted], weights: Real) -> tuple[float, float] | None:
    """``(a0, a1)`` of the rational function through the spectra, or None if it is not a damped oscillation.

    Sanathanan and Koerner's iteration: ``D(s) Y = N(s) V + t0 + t1 s`` is linear in all unknowns, and the equation is
    weighted by ``1/|D|`` of the previous iteration. ``t0 + t1 s`` is the transient of a record that does not repeat;
    steady-state records have none.
    """
    rows = []
    for f in fitted:
        n = f.measurement.fitted
        v = (f.basis.hysteretic_V() @ weights)[:n]
        y = f.measurement.mean[:n]
        frequency = np.fft.rfftfreq(n, f.measurement.step_s)
        V, Y = np.fft.rfft(v) / n, np.fft.rfft(y) / n
        keep = np.flatnonzero((frequency > 0) & (frequency < HIGHEST_SHARE / f.measurement.step_s))
        if f.measurement.initial_state == "periodic":
            keep = keep[np.abs(V[keep]) > 1e-3 * np.abs(V[keep]).max(initial=0.0)]
        keep = keep[np.argsort(-np.abs(V[keep]))[:MOST_LINES]]
        weight = math.sqrt(len(f.measurement.signals) * n) / f.noise.rms
        rows.append((f, 2j * np.pi * frequency[keep], V[keep], Y[keep], weight))
    if sum(s.size for _, s, *_ in rows) < 8:
        return None
    scale = math.exp(float(np.mean(np.concatenate([np.log(np.abs(s)) for _, s, *_ in rows]))))
    channels = sorted({f.measurement.channel for f in fitted})
    a1, a0 = 0.5, 1.0  # in units of `scale` and its square
    denominator_known = False
    for _ in range(ITERATIONS):
        parts, targets = [], []
        for i, (f, s, V, Y, weight) in enumerate(rows):
            p = s / scale
            inverse = weight / np.abs(p * p + a1 * p + a0) if denominator_known else weight / (1 + np.abs(p * p))
            columns: list[Complex] = [p * Y, Y]
            for channel in channels:
                mine = channel == f.measurement.channel
                columns.append(-(p * V if channel == "self_sensing" else V) * mine)
            for j, other in enumerate(rows):
                if other[0].measurement.initial_state != "periodic":
                    columns.extend([-(j == i) * np.ones_like(p), -(j == i) * p])
            matrix = np.column_stack(columns) * inverse[:, None]
            target = -p * p * Y * inverse
            parts.append(np.vstack([matrix.real, matrix.imag]))
            targets.append(np.concatenate([target.real, target.imag]))
        matrix = np.vstack(parts)
        size = np.linalg.norm(matrix, axis=0)
        if not np.isfinite(size).all():
            return None
        size[size == 0] = 1.0
        solution = np.linalg.lstsq(matrix / size, np.concatenate(targets), rcond=1e-12)[0] / size
        a1, a0 = float(solution[0]), float(solution[1])
        denominator_known = True
        if not (a0 > 0 and math.isfinite(a0) and math.isfinite(a1)):
            return None
        a1 = min(max(abs(a1), 1e-4 * math.sqrt(a0)), 1.9 * math.sqrt(a0))
    return a0 * scale**2, a1 * scale


def _grid(fast: Sequence[Fitted]) -> list[tuple[float, float]]:
    longest = max(f.measurement.fitted * f.measurement.step_s for f in fast)
    shortest = min(f.measurement.step_s for f in fast)
    return [
        ((2 * math.pi * f0) ** 2, 2 * zeta * 2 * math.pi * f0)
        for f0 in np.geomspace(2 / longest, 0.45 / shortest, GRID_FREQUENCIES)
        for zeta in GRID_DAMPING_RATIOS
    ]


def best_start(
    fast: Sequence[Fitted], weights: Real | None, passed: Callable[[float], None] = lambda _: None
) -> tuple[float, float]:
    """The candidate ``(a0, a1)`` with the smallest χ² on a part of the recordings.

    Parameters
    ----------
    fast : sequence of Fitted
        Self-sensing and displacement recordings.
    weights : ndarray, shape (d,), or None
        Coefficients of the branch law up to a factor, or None if it is unknown: each candidate is then judged with the
        law that suits it best, so that losses in the ceramic are not mistaken for damping.
    passed : callable, optional
        Told the share of all candidates that has been judged, after each.

    Returns
    -------
    tuple of float
        ``a0`` in 1/s² and ``a1`` in 1/s.
    """
    part: list[Fitted] = []
    budget = GRID_SAMPLES
    for f in sorted(fast, key=lambda f: -float(np.std(f.measurement.mean) / f.noise.rms)):
        if not part or f.measurement.fitted <= budget:
            part.append(f)
            budget -= f.measurement.fitted
    candidates = resonator_candidates(fast, weights)

    def judged(pair: tuple[float, float]) -> float:
        found = _misfit(part, weights, *pair)
        passed(PASSES / len(candidates))
        return found

    return min(candidates, key=judged)


def _misfit(part: Sequence[Fitted], weights: Real | None, a0: float, a1: float) -> float:
    """χ² with the best offset and gain, or branch law, for each channel."""
    total = 0.0
    for channel in sorted({f.measurement.channel for f in part}):
        rows = []
        for f in part:
            if f.measurement.channel != channel:
                continue
            n = f.measurement.fitted
            psi = f.basis.response(channel, a0, a1)[:n]
            if weights is not None:
                psi = (psi @ weights)[:, None]
            block = f.whitened(np.column_stack([psi, np.ones(n), f.measurement.mean[:n]]))
            if has_free_state(f.measurement):
                q = np.linalg.qr(f.whitened(f.basis.free_states(a0, a1)[:n]))[0]
                block = block - q @ (q.T @ block)
            rows.append(block)
        stacked = np.vstack(rows)
        size = np.linalg.norm(stacked[:, :-1], axis=0)
        size[size == 0] = 1.0
        solution = np.linalg.lstsq(stacked[:, :-1] / size, stacked[:, -1], rcond=1e-12)[0] / size
        total += float(np.sum((stacked[:, -1] - stacked[:, :-1] @ solution) ** 2))
    return total
