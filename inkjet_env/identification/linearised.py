"""Recordings as linear equations: their columns about a model, and the triangles to which they are reduced.

Given the resonator ``(a0, a1)`` and the gains of the channels relative to the first, the model is linear in the
coefficients of the branch law, the offsets and the free initial states.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification.constrained import least_squares_above_zero
from inkjet_env.identification.model import Fitted, Model, channels_of, has_free_state
from inkjet_env.typing import Real


def triangle(columns: Real) -> Real:
    """Upper triangle with the same normal equations as ``columns`` (n, k), and so the same least-squares solution."""
    return np.linalg.qr(columns).R


class Linearised:
    """A set of recordings, each reduced to a small triangle, linear in everything about a model."""

    def __init__(
        self,
        fitted: Sequence[Fitted],
        constraints: Real | None,
        passed: Callable[[float], None] = lambda _: None,
    ) -> None:
        self.fitted = tuple(fitted)
        samples = [f.measurement.fitted for f in self.fitted]
        self.shares = [n / max(sum(samples), 1) for n in samples]
        self.passed = passed
        self.channels = channels_of(fitted)
        self.degree = fitted[0].basis.degree
        self.moving = any(f.measurement.fast for f in fitted)
        self.constraints = constraints
        self.still_blocks: dict[int, Real] = {}

    def blocks(self, model: Model, slopes: bool = True) -> list[Real]:
        """One triangle per drive: columns of the weights, of ``ln a0`` and ``ln a1``, of the offset, and the signal."""
        found = []
        for i, f in enumerate(self.fitted):
            found.append(self._block(i, f, model, slopes))
            self.passed(self.shares[i])
        return found

    def _block(self, index: int, f: Fitted, model: Model, slopes: bool) -> Real:
        if f.measurement.fast:
            return triangle(self.columns(f, model, slopes))
        if index not in self.still_blocks:
            self.still_blocks[index] = triangle(self.columns(f, model, slopes))
        return self.still_blocks[index]

    def columns(self, f: Fitted, model: Model, slopes: bool) -> Real:
        """Columns that `blocks` reduces, whitened, at every fitted sample, shape (n, degree + 4)."""
        channel, degree = f.measurement.channel, self.degree
        psi = f.measurement.response(f.basis, model.a0, model.a1)
        n = f.measurement.fitted
        columns = np.zeros((n, degree + 4))
        columns[:, :degree] = psi[:n]
        columns[:, -2] = 1.0
        columns[:, -1] = f.measurement.mean[:n]
        ratio = model.ratios[channel]
        states = _states(f, model.a0, model.a1) if has_free_state(f.measurement) else None
        if f.measurement.fast and slopes:
            amplitude: NDArray[np.floating] = np.zeros(2)
            if states is not None:
                residuals = columns[:, -1] - ratio * (columns[:, :degree] @ model.weights) - model.offsets[channel]
                amplitude = np.linalg.lstsq(f.whitened(states), f.whitened(residuals[:, None])[:, 0], rcond=None)[0]
            for place, h, (up, down) in _neighbours(model):
                difference = f.basis.response(channel, *up)[:n] - f.basis.response(channel, *down)[:n]
                columns[:, degree + place] = ratio / (2 * h) * (difference @ model.weights)
                if states is not None:
                    turned = _states(f, *up) - _states(f, *down)
                    columns[:, degree + place] += turned @ amplitude / (2 * h)
        whitened = f.whitened(columns)
        if states is not None:
            q = np.linalg.qr(f.whitened(states))[0]
            whitened = whitened - q @ (q.T @ whitened)
        return whitened

    def stacked(self, blocks: Sequence[Real], model: Model, nonlinear: bool) -> tuple[Real, Real]:
        """All drives stacked: the columns of weights, [ln a0, ln a1, ratios,] offsets; and the signal."""
        stacked = np.vstack(
            [self.spread(f, block, model, nonlinear) for f, block in zip(self.fitted, blocks, strict=True)]
        )
        return stacked[:, :-1], stacked[:, -1]

    def spread(self, f: Fitted, block: Real, model: Model, nonlinear: bool = True) -> Real:
        """Columns of one drive at their places among all parameters, and the signal."""
        d, channel = self.degree, f.measurement.channel
        psi, nothing = block[:, :d], np.zeros((len(block), 1))
        parts = [model.ratios[channel] * psi]
        if nonlinear:
            if self.moving:
                parts.append(block[:, d : d + 2])
            answer = (psi @ model.weights)[:, None]
            parts.extend(answer if channel == other else nothing for other in self.channels[1:])
        parts.extend(block[:, d + 2 : d + 3] if channel == each else nothing for each in self.channels)
        parts.append(block[:, d + 3 :])
        return np.hstack(parts)

    def solve(self, matrix: Real, target: Real) -> tuple[Real, Real]:
        """Least-squares solution, subject to the constraints if there are any, and which of them are active."""
        scale = np.linalg.norm(matrix, axis=0)
        scale[scale == 0] = 1.0
        solution = np.linalg.lstsq(matrix / scale, target, rcond=1e-13)[0] / scale
        if self.constraints is None:
            return solution, np.zeros(0, dtype=bool)
        sign = math.copysign(1.0, solution[: self.degree].sum())
        rows = np.zeros((len(self.constraints), matrix.shape[1]))
        rows[:, : self.degree] = sign * self.constraints
        return least_squares_above_zero(matrix, target, rows)

    def residuals(self, blocks: Sequence[Real], model: Model) -> Real:
        """Whitened residuals of a model, all drives stacked."""
        matrix, target = self.stacked(blocks, model, nonlinear=False)
        return np.asarray(target - matrix @ self.linear_part(model))

    def linear_part(self, model: Model) -> Real:
        """Weights and offsets, in the order of the linear columns."""
        return np.concatenate([model.weights, [model.offsets[channel] for channel in self.channels]])


def linearised_blocks(
    fitted: Sequence[Fitted], model: Model, passed: Callable[[float], None] = lambda _: None
) -> list[Real]:
    """One block per drive: columns of the weights, of everything else linearised about the model, and the signal.

    Parameters
    ----------
    fitted : sequence of Fitted
        Recordings with bases of one degree, which may be above the model's.
    model : Model
        Model about which the signal is linearised.
    passed : callable, optional
        Told the share of a pass over the recordings that is finished, after each.
    """
    weights = np.zeros(fitted[0].basis.degree)
    weights[: model.weights.size] = model.weights
    problem, model = Linearised(fitted, None, passed), replace(model, weights=weights)
    return [problem.spread(f, b, model) for f, b in zip(fitted, problem.blocks(model), strict=True)]


def _states(f: Fitted, a0: float, a1: float) -> Real:
    """Free ringing from an unknown initial state at the fitted samples, shape (n, 2)."""
    return f.basis.free_states(a0, a1)[: f.measurement.fitted]


def _neighbours(model: Model) -> list[tuple[int, float, tuple[tuple[float, float], tuple[float, float]]]]:
    """Points of the central differences: index of the column, half step of the logarithm, the two resonators."""
    damping_ratio = model.a1 / (2 * math.sqrt(model.a0))
    of_a0 = 1e-4 * damping_ratio
    of_a1 = 1e-4 * min(1.0, 1.0 - damping_ratio)
    up0, down0 = model.a0 * math.exp(of_a0), model.a0 * math.exp(-of_a0)
    up1, down1 = model.a1 * math.exp(of_a1), model.a1 * math.exp(-of_a1)
    return [
        (0, of_a0, ((up0, model.a1), (down0, model.a1))),
        (1, of_a1, ((model.a0, up1), (model.a0, down1))),
    ]
