"""Uncertainty of a fit: its minimum with the factor of the covariance of all parameters.

Equation (2) of docs/explanation/identification.md, with ``J`` the whitened Jacobian and ``S`` the covariance of the
whitened noise:

    Cov(θ) = (JᵀJ)⁻¹ Jᵀ S J (JᵀJ)⁻¹                                                                 (2)
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.identification.linearised import Linearised
from inkjet_env.identification.model import Model
from inkjet_env.typing import Real

SMOOTHED_LINES = 9
"""Number of lines of a residual's periodogram that are averaged for its spectrum."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A model at the minimum of χ², with the factor of its parameters' covariance.

    Attributes
    ----------
    model : Model
        The model at the minimum.
    chi_square : float
        χ² of the whitened residuals of the repeats' means; differences between repeats do not count.
    factor : ndarray, shape (p, q)
        Factor of the covariance ``factor @ factor.T`` of the weights, ``ln a0``, ``ln a1`` (if there is a fast
        channel), ratios and offsets, in this order. The factor is stored because neighbouring powers nearly cancel, and
        the product would lose most of its digits.
    names : tuple of str
        Names of the parameters: ``w1, w2 …``, ``ln a0``, ``ln a1``, ``ratio <channel>``, ``offset <channel>``.
    rms : dict of str to float
        Root mean square of the whitened residual of each channel; 1 is the noise.
    converged : bool
        Whether the last step promised no further decrease of χ².
    held : int
        Number of active constraints.
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
        """Covariance of all parameters, shape (p, p)."""
        return self.factor @ self.factor.T  # Eq. (2)

    def error_of(self, gradient: Real) -> float:
        """Standard error of a function of the parameters with this gradient, shape (p,)."""
        return float(np.linalg.norm(gradient @ self.factor))


def solution_of(problem: Linearised, model: Model, converged: bool, coloured: Collection[str]) -> Solution:
    """The model with the covariance of all its parameters."""
    blocks = problem.blocks(model)
    matrix, target = problem.stacked(blocks, model, nonlinear=True)
    _, active = problem.solve(matrix, target)
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = np.inf  # a parameter without influence on any recording
    allowed = np.eye(matrix.shape[1])
    if problem.constraints is not None and active.any():
        held = np.zeros((int(active.sum()), matrix.shape[1]))
        held[:, : problem.degree] = problem.constraints[active] / scale[: problem.degree]
        _, sizes, right = np.linalg.svd(held)
        rank = int(np.sum(sizes > 1e-10 * sizes[0]))
        allowed = right[rank:].T
    _, sizes, right = np.linalg.svd(matrix / scale @ allowed, full_matrices=False)
    seen = sizes > 1e-13 * sizes[0]
    # Directions in which the whitened signal changes by one standard deviation: there JᵀJ is the unit matrix.
    unit = (allowed @ right[seen].T) / sizes[seen] / scale[:, None]
    sizes, directions = np.linalg.eigh(_score_covariance(problem, model, coloured, unit))
    factor = unit @ (directions * np.sqrt(np.maximum(sizes, 0.0)))  # Eq. (2)
    residual = problem.residuals(blocks, model)
    names = (
        *(f"w{j + 1}" for j in range(problem.degree)),
        *(("ln a0", "ln a1") if problem.moving else ()),
        *(f"ratio {channel}" for channel in problem.channels[1:]),
        *(f"offset {channel}" for channel in problem.channels),
    )
    rms = _whitened_rms(problem, blocks, residual)
    return Solution(model, float(np.sum(residual**2)), factor, names, rms, converged, int(active.sum()))


def _whitened_rms(problem: Linearised, blocks: Sequence[Real], residual: Real) -> dict[str, float]:
    """Root mean square of each channel's part of the whitened residual of all stacked blocks; 1 is the noise."""
    squares: dict[str, float] = dict.fromkeys(problem.channels, 0.0)
    samples = dict.fromkeys(problem.channels, 0)
    parts = np.split(residual, np.cumsum([len(block) for block in blocks])[:-1])
    for f, part in zip(problem.fitted, parts, strict=True):
        squares[f.measurement.channel] += float(np.sum(part**2))
        samples[f.measurement.channel] += f.samples // len(f.measurement.signals)
    return {channel: math.sqrt(squares[channel] / max(samples[channel], 1)) for channel in problem.channels}


def _score_covariance(problem: Linearised, model: Model, coloured: Collection[str], unit: Real) -> Real:
    """``Jᵀ S J`` of the whitened Jacobian J along some directions; S from the noise's colour or a loud residual."""
    total = np.zeros((unit.shape[1], unit.shape[1]))
    for f in problem.fitted:
        columns = problem.columns(f, model, slopes=True)
        slopes = np.fft.fft(problem.spread(f, columns, model, nonlinear=True)[:, :-1] @ unit, axis=0)
        n = len(columns)
        if f.measurement.channel in coloured:
            linear = problem.spread(f, columns, model, nonlinear=False)
            power = _smoothed_power(linear[:, -1] - linear[:, :-1] @ problem.linear_part(model))
        else:
            power = f.noise.levels(n)
        total += ((slopes.conj().T * power) @ slopes).real / n  # Eq. (2), Jᵀ S J
    return total


def _smoothed_power(residual: Real) -> Real:
    """Periodogram of a residual with each line averaged over its neighbours; its mean is the mean square."""
    n = residual.size
    width = min(SMOOTHED_LINES, n)
    power = np.abs(np.fft.fft(residual)) ** 2 / n
    around = power[(np.arange(n)[:, None] + np.arange(width) - width // 2) % n]
    return np.asarray(around.mean(axis=1))
