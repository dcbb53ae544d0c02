"""Output-error fit of every recording at once: separable least squares on free-run simulation.

Given the resonator ``(a0, a1)`` and the gains of the channels relative to the first, the model is linear in the
coefficients of the branch law, the offsets and the free initial states. So Gauss–Newton steps run in ``ln a0``,
``ln a1`` and the gain ratios, with everything linear solved for at each of them (Golub and Pereyra's variable
projection in Ruhe and Wedin's form). Each recording is reduced to a small triangle first; what is left costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification.basis import DriveBasis
from inkjet_env.identification.constrained import least_squares_above_zero
from inkjet_env.identification.measurements import Measurement
from inkjet_env.identification.noise import NoiseModel

Real = NDArray[np.float64]

MOST_STEPS = 60
CONVERGED = 1e-4
"""A step that promises to lower χ² by less is the last."""
SMOOTHED_LINES = 9
"""Of a residual's periodogram, to make it a spectrum."""
LARGEST_STEP = 0.5
"""Of the logarithms of a0 and a1."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """One drive, its repeats' mean, and how to weigh it."""

    measurement: Measurement
    basis: DriveBasis
    noise: NoiseModel
    loudness: float = 1.0
    """How many times its noise the channel's residual is: it is weighed by that."""

    @property
    def samples(self) -> int:
        """Samples that enter the fit, repeats counted."""
        return (self.measurement.fitted - self.noise.lost) * len(self.measurement.signals)

    def whitened(self, columns: Real) -> Real:
        """The fitted rows, whitened, and weighed as so many repeats."""
        weight = math.sqrt(len(self.measurement.signals)) / self.loudness
        return self.noise.whitened(columns[: self.measurement.fitted]) * weight


@dataclass(frozen=True, eq=False)
class Model:
    """What the fit determines.

    Attributes
    ----------
    a0, a1 : float
    weights : ndarray, shape (d,)
        Coefficients of the branch law, lowest power (1) first, times the gain of the first channel.
    ratios : dict of str to float
        Gain of each channel over that of the first.
    offsets : dict of str to float
    """

    a0: float
    a1: float
    weights: Real
    ratios: Mapping[str, float]
    offsets: Mapping[str, float]

    def predicted(self, measurement: Measurement, basis: DriveBasis, noise: NoiseModel | None = None) -> Real:
        """Free-run signal at every sample, shape (n,).

        A free initial state is estimated from the recording itself, whitened by ``noise`` where given.
        """
        psi = basis.response(measurement.channel, self.a0, self.a1)
        signal = self.ratios[measurement.channel] * (psi @ self.weights) + self.offsets[measurement.channel]
        if has_free_state(measurement):
            states = basis.free_states(self.a0, self.a1)
            seen = measurement.fitted or measurement.drive_V.size  # what is held out of a recording tells nothing
            pair = np.column_stack([states, measurement.mean - signal])[:seen]
            pair = pair if noise is None else noise.whitened(pair)
            signal = signal + states @ np.linalg.lstsq(pair[:, :2], pair[:, 2], rcond=None)[0]
        return signal


@dataclass(frozen=True, eq=False)
class Solution:
    """A model at the minimum of χ², and what its parameters' covariance follows from.

    Attributes
    ----------
    model : Model
    chi_square : float
        Of the whitened residuals of the repeats' means, so without what differs between repeats.
    factor : ndarray, shape (p, q)
        The covariance is ``factor @ factor.T``: of the weights, ``ln a0``, ``ln a1`` (where a fast channel is there),
        ratios, offsets, in this order. Neighbouring powers all but cancel; of the product little would be left.
    names : tuple of str
        Of the parameters: ``w1, w2 …``, ``ln a0``, ``ln a1``, ``ratio <channel>``, ``offset <channel>``.
    rms : dict of str to float
        Root mean square of the whitened residual of each channel: 1 is the noise.
    converged : bool
    held : int
        How many constraints are active.
    """

    model: Model
    chi_square: float
    factor: Real
    names: tuple[str, ...]
    rms: Mapping[str, float]
    converged: bool
    held: int

    @property
    def covariance(self) -> Real:
        """Of all parameters, shape (p, p)."""
        return self.factor @ self.factor.T

    def error_of(self, gradient: Real) -> float:
        """Standard error of a function of the parameters with this gradient, shape (p,)."""
        return float(np.linalg.norm(gradient @ self.factor))


def has_free_state(measurement: Measurement) -> bool:
    """Whether the resonator's initial state is a nuisance of this recording."""
    return measurement.initial_state == "free" and measurement.channel != "strain_gauge"


def triangle(columns: Real) -> Real:
    """The upper triangle with the same normal equations as ``columns`` (n, k): least squares see no difference."""
    return np.linalg.qr(columns).R


def channels_of(fitted: Sequence[Fitted]) -> tuple[str, ...]:
    """Channels in order: the first is the one whose gain the weights carry."""
    order = ("strain_gauge", "self_sensing", "displacement")
    present = {f.measurement.channel for f in fitted}
    return tuple(channel for channel in order if channel in present)


def fit_everything(
    fitted: Sequence[Fitted],
    start: Model,
    constraints: Real | None = None,
    coloured: Collection[str] = (),
) -> Solution:
    """Least squares over all parameters together.

    Parameters
    ----------
    fitted : sequence of Fitted
        Bases of one degree.
    start : Model
        ``a0``, ``a1`` and the ratios are taken from it; the weights where they are needed to begin.
    constraints : ndarray, shape (k, d), optional
        ``constraints @ weights ≥ 0``, or ``≤ 0`` where the first channel's gain is negative.
    coloured : collection of str
        Channels whose whitened residual is not white, so that its spectrum must enter the covariance.
    """
    problem = _Problem(fitted, constraints)
    model = start
    blocks = problem.blocks(model)
    objective, model = problem.best_linear(blocks, model)
    converged = False
    for _ in range(MOST_STEPS):
        blocks = problem.blocks(model)
        step = problem.step(blocks, model)
        if step.promise < CONVERGED:
            converged = True
            break
        fraction = min(1.0, LARGEST_STEP / max(1e-300, float(np.abs(step.logarithms).max(initial=0.0))))
        for _ in range(12):
            trial = problem.moved(model, step, fraction)
            if trial is not None:
                value, trial = problem.best_linear(problem.blocks(trial, slopes=False), trial)
                if value <= objective:
                    break
            fraction /= 2
        else:
            converged = step.promise < 1e3 * CONVERGED  # rounding stands in the way of the last digits
            break
        objective, model = value, trial
    return problem.solution(model, converged, coloured)


def linearised_blocks(fitted: Sequence[Fitted], model: Model) -> list[Real]:
    """One block a drive: columns of the weights, of everything else linearised about the model, and the signal.

    Parameters
    ----------
    fitted : sequence of Fitted
        Bases of a degree that may be above the model's.
    model : Model
    """
    weights = np.zeros(fitted[0].basis.degree)
    weights[: model.weights.size] = model.weights
    problem, model = _Problem(fitted, None), replace(model, weights=weights)
    return [problem.spread(f, b, model) for f, b in zip(fitted, problem.blocks(model), strict=True)]


@dataclass(frozen=True, eq=False)
class _Step:
    logarithms: Real
    ratios: Real
    promise: float


class _Problem:
    """The linear algebra of one set of recordings."""

    def __init__(self, fitted: Sequence[Fitted], constraints: Real | None) -> None:
        self.fitted = tuple(fitted)
        self.channels = channels_of(fitted)
        self.degree = fitted[0].basis.degree
        self.moving = any(channel != "strain_gauge" for channel in self.channels)
        self.constraints = constraints
        self.still_blocks: dict[int, Real] = {}

    def blocks(self, model: Model, slopes: bool = True) -> list[Real]:
        """One triangle a drive: columns of the weights, of ``ln a0`` and ``ln a1``, of the offset; and the signal."""
        return [self._block(i, f, model, slopes) for i, f in enumerate(self.fitted)]

    def _block(self, index: int, f: Fitted, model: Model, slopes: bool) -> Real:
        if f.measurement.channel != "strain_gauge":
            return triangle(self._columns(f, model, slopes))
        if index not in self.still_blocks:
            self.still_blocks[index] = triangle(self._columns(f, model, slopes))
        return self.still_blocks[index]

    def _columns(self, f: Fitted, model: Model, slopes: bool) -> Real:
        """The columns that `blocks` reduces, whitened, at every fitted sample."""
        channel, degree = f.measurement.channel, self.degree
        psi = f.basis.response(channel, model.a0, model.a1)
        n = f.measurement.fitted
        columns = np.zeros((n, degree + 4))
        columns[:, :degree] = psi[:n]
        columns[:, -2] = 1.0
        columns[:, -1] = f.measurement.mean[:n]
        ratio = model.ratios[channel]
        free = has_free_state(f.measurement)
        states = self._states(f, model.a0, model.a1) if free else None
        if channel != "strain_gauge" and slopes:
            amplitude: NDArray[np.floating] = np.zeros(2)
            if states is not None:
                left = columns[:, -1] - ratio * (columns[:, :degree] @ model.weights) - model.offsets[channel]
                amplitude = np.linalg.lstsq(f.whitened(states), f.whitened(left[:, None])[:, 0], rcond=None)[0]
            for place, h, (up, down) in _neighbours(model):
                difference = f.basis.response(channel, *up)[:n] - f.basis.response(channel, *down)[:n]
                columns[:, degree + place] = ratio / (2 * h) * (difference @ model.weights)
                if states is not None:
                    turned = self._states(f, *up) - self._states(f, *down)
                    columns[:, degree + place] += turned @ amplitude / (2 * h)
        whitened = f.whitened(columns)
        if states is not None:
            q = np.linalg.qr(f.whitened(states))[0]
            whitened = whitened - q @ (q.T @ whitened)
        return whitened

    @staticmethod
    def _states(f: Fitted, a0: float, a1: float) -> Real:
        return f.basis.free_states(a0, a1)[: f.measurement.fitted]

    def _stacked(self, blocks: Sequence[Real], model: Model, nonlinear: bool) -> tuple[Real, Real]:
        """All drives below each other: columns weights, [ln a0, ln a1, ratios,] offsets; and the signal."""
        stacked = np.vstack(
            [self.spread(f, block, model, nonlinear) for f, block in zip(self.fitted, blocks, strict=True)]
        )
        return stacked[:, :-1], stacked[:, -1]

    def spread(self, f: Fitted, block: Real, model: Model, nonlinear: bool = True) -> Real:
        """One drive's columns in the places they have among all parameters, and the signal."""
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

    def _solve(self, matrix: Real, target: Real) -> tuple[Real, Real]:
        """Least squares, under the constraints where there are any; and which of them are active."""
        scale = np.linalg.norm(matrix, axis=0)
        scale[scale == 0] = 1.0
        solution = np.linalg.lstsq(matrix / scale, target, rcond=1e-13)[0] / scale
        if self.constraints is None:
            return solution, np.zeros(0, dtype=bool)
        sign = math.copysign(1.0, solution[: self.degree].sum())
        rows = np.zeros((len(self.constraints), matrix.shape[1]))
        rows[:, : self.degree] = sign * self.constraints
        return least_squares_above_zero(matrix, target, rows)

    def best_linear(self, blocks: Sequence[Real], model: Model) -> tuple[float, Model]:
        """χ² at the best weights and offsets, and the model with them."""
        matrix, target = self._stacked(blocks, model, nonlinear=False)
        solution, _ = self._solve(matrix, target)
        offsets = dict(zip(self.channels, solution[self.degree :].tolist(), strict=True))
        objective = float(np.sum((target - matrix @ solution) ** 2))
        return objective, replace(model, weights=solution[: self.degree], offsets=offsets)

    def step(self, blocks: Sequence[Real], model: Model) -> _Step:
        """The Gauss–Newton step, and by how much it promises to lower χ²."""
        matrix, target = self._stacked(blocks, model, nonlinear=True)
        solution, _ = self._solve(matrix, target)
        linear, target_linear = self._stacked(blocks, model, nonlinear=False)
        now = np.sum((target_linear - linear @ self._linear_part(model)) ** 2)
        promise = float(now - np.sum((target - matrix @ solution) ** 2))
        d, moving = self.degree, 2 * self.moving
        return _Step(
            solution[d : d + moving],
            solution[d + moving : d + moving + len(self.channels) - 1],
            promise,
        )

    def _linear_part(self, model: Model) -> Real:
        return np.concatenate([model.weights, [model.offsets[channel] for channel in self.channels]])

    def moved(self, model: Model, step: _Step, fraction: float) -> Model | None:
        """The model a fraction of a step on; None where that is no damped oscillation."""
        a0, a1 = model.a0, model.a1
        if self.moving:
            a0, a1 = (np.array([a0, a1]) * np.exp(fraction * step.logarithms)).tolist()
            if not 2e-6 * math.sqrt(a0) <= a1 < 1.999 * math.sqrt(a0):
                return None
        ratios = {
            channel: model.ratios[channel] + (fraction * float(step.ratios[i - 1]) if i else 0.0)
            for i, channel in enumerate(self.channels)
        }
        return replace(model, a0=a0, a1=a1, ratios=ratios)

    def solution(self, model: Model, converged: bool, coloured: Collection[str]) -> Solution:
        """The model with the covariance of all its parameters."""
        blocks = self.blocks(model)
        matrix, target = self._stacked(blocks, model, nonlinear=True)
        _, active = self._solve(matrix, target)
        scale = np.linalg.norm(matrix, axis=0)
        scale[scale == 0] = np.inf  # a parameter that nothing shows
        allowed = np.eye(matrix.shape[1])
        if self.constraints is not None and active.any():
            held = np.zeros((int(active.sum()), matrix.shape[1]))
            held[:, : self.degree] = self.constraints[active] / scale[: self.degree]
            _, sizes, right = np.linalg.svd(held)
            rank = int(np.sum(sizes > 1e-10 * sizes[0]))
            allowed = right[rank:].T
        _, sizes, right = np.linalg.svd(matrix / scale @ allowed, full_matrices=False)
        seen = sizes > 1e-13 * sizes[0]
        # Directions in which the whitened signal changes by one noise: there J'J is the unit matrix.
        unit = (allowed @ right[seen].T) / sizes[seen] / scale[:, None]
        sizes, directions = np.linalg.eigh(self._score_covariance(model, coloured, unit))
        factor = unit @ (directions * np.sqrt(np.maximum(sizes, 0.0)))
        linear, target = self._stacked(blocks, model, nonlinear=False)
        residual = target - linear @ self._linear_part(model)
        rms, at = {}, 0
        squares: dict[str, float] = dict.fromkeys(self.channels, 0.0)
        for f, block in zip(self.fitted, blocks, strict=True):
            squares[f.measurement.channel] += float(np.sum(residual[at : at + len(block)] ** 2))
            at += len(block)
        for channel in self.channels:
            rows = sum(f.samples // len(f.measurement.signals) for f in self.fitted if f.measurement.channel == channel)
            rms[channel] = math.sqrt(squares[channel] / max(rows, 1))
        names = (
            *(f"w{j + 1}" for j in range(self.degree)),
            *(("ln a0", "ln a1") if self.moving else ()),
            *(f"ratio {channel}" for channel in self.channels[1:]),
            *(f"offset {channel}" for channel in self.channels),
        )
        return Solution(model, float(np.sum(residual**2)), factor, names, rms, converged, int(active.sum()))

    def _score_covariance(self, model: Model, coloured: Collection[str], unit: Real) -> Real:
        """``Jᵀ Σ J`` of the whitened slopes J along some directions, Σ from the noise's colour or a loud residual."""
        total = np.zeros((unit.shape[1], unit.shape[1]))
        for f in self.fitted:
            columns = self._columns(f, model, slopes=True)
            slopes = np.fft.fft(self.spread(f, columns, model, nonlinear=True)[:, :-1] @ unit, axis=0)
            n = len(columns)
            if f.measurement.channel in coloured:
                linear = self.spread(f, columns, model, nonlinear=False)
                power = _smoothed_power(linear[:, -1] - linear[:, :-1] @ self._linear_part(model))
            else:
                power = f.noise.levels(n)
            total += ((slopes.conj().T * power) @ slopes).real / n
        return total


def _smoothed_power(residual: Real) -> Real:
    """Periodogram of a residual, each line averaged with its neighbours; its mean is the mean square."""
    n = residual.size
    width = min(SMOOTHED_LINES, n)
    power = np.abs(np.fft.fft(residual)) ** 2 / n
    around = power[(np.arange(n)[:, None] + np.arange(width) - width // 2) % n]
    return np.asarray(around.mean(axis=1))


def _neighbours(model: Model) -> list[tuple[int, float, tuple[tuple[float, float], tuple[float, float]]]]:
    """Where to differentiate: place of the column, half step of the logarithm, the two resonators."""
    damping_ratio = model.a1 / (2 * math.sqrt(model.a0))
    of_a0 = 1e-4 * damping_ratio
    of_a1 = 1e-4 * min(1.0, 1.0 - damping_ratio)
    up0, down0 = model.a0 * math.exp(of_a0), model.a0 * math.exp(-of_a0)
    up1, down1 = model.a1 * math.exp(of_a1), model.a1 * math.exp(-of_a1)
    return [
        (0, of_a0, ((up0, model.a1), (down0, model.a1))),
        (1, of_a1, ((model.a0, up1), (model.a0, down1))),
    ]
