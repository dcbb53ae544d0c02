"""Low-pass ``(1 + κ τ s) / (1 + τ s + q τ² s²)`` with one pole (q = κ = 0) or two, for a uniformly sampled signal."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

from inkjet_env.typing import Real

LINEAR = np.array([[1.0, -1.0], [0.0, 1.0]])
"""Polynomials in s, lowest power first, of the line through the samples 0 and 1: one row per sample."""
CUBIC = np.array([[0, -1 / 3, 1 / 2, -1 / 6], [1, -1 / 2, -1, 1 / 2], [0, 1, 1 / 2, -1 / 2], [0, -1 / 6, 0, 1 / 6]])
"""The same for Lagrange's cubics through the samples -1, 0, 1, 2, between the samples 0 and 1."""
ONE_POLE = 1e-9
"""Values of q up to this are taken as 0."""


def time_constant_s(bandwidth_Hz: float, second_order: float) -> float:
    """τ in seconds of a low-pass that passes half the power at ``bandwidth_Hz``, with q ``second_order``."""
    q = second_order
    return math.sqrt(2 / (1 - 2 * q + math.hypot(1 - 2 * q, 2 * q))) / (2 * math.pi * bandwidth_Hz)


def low_passed(
    signal: Real,
    time_constant_s: float,
    second_order: float,
    step_s: float,
    periodic: bool,
    cubic: bool = False,
    lead: float = 0.0,
) -> Real:
    """The signal behind the low-pass, shape (n,).

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Values at equal steps; see ``cubic`` for the signal between them.
    time_constant_s : float
        τ in seconds, at least 0; 0 is no low-pass.
    second_order : float
        q, dimensionless, at least 0.
    step_s : float
        Time between the values, in seconds.
    periodic : bool
        Whether the result is the steady state of the repeated signal, in which the value after the last is the first;
        otherwise the filter starts at rest at the first value.
    cubic : bool
        Whether the signal is smooth and replaced by cubics through four values: for a tone the error is below 0.4 % at
        9 values per period and falls with the fourth power of the step. Otherwise the signal is linear between its
        values, and the result is exact.
    lead : float
        κ, dimensionless; not 0 only with a second order.
    """
    from inkjet_env.plant import compiled

    if time_constant_s <= 0:
        return signal
    if lead and second_order <= ONE_POLE:
        raise ValueError(f"a lead ({lead}) needs a low-pass of second order; second_order is {second_order}")
    z = step_s / time_constant_s
    shapes = CUBIC if cubic else LINEAR
    own, forcing = np.array([[-z]]), np.array([z])  # state y
    if second_order > ONE_POLE:  # states y and τ y'
        own, forcing = np.array([[0.0, z], [-z / second_order, -z / second_order]]), np.array([0.0, z / second_order])
    keep, new = _over_a_step(own, forcing, shapes)
    values = _with_ends(signal, periodic, cubic)
    steps = values.size - len(shapes) + 1
    gained = np.stack([np.convolve(values, weights[::-1], mode="valid") for weights in new], axis=1)
    start = np.zeros(len(keep))
    result = np.empty(steps + 1)
    if periodic:
        compiled.stepped(keep, gained, lead, start, result)  # `start` is then the state at the end
        start = np.linalg.solve(np.eye(len(keep)) - np.linalg.matrix_power(keep, steps), start)
    else:
        start[0] = signal[0]
    compiled.stepped(keep, gained, lead, start, result)
    return result[: signal.size]


def _over_a_step(own: Real, forcing: Real, shapes: Real) -> tuple[Real, Real]:
    """Transition matrix of a step, shape (k, k), and its input weights for each value, shape (k, m).

    Both follow from one matrix exponential, with the forcing's polynomial as a chain of integrators (Van Loan 1978).
    """
    k, m = len(own), len(shapes)
    whole = np.zeros((k + m, k + m))
    whole[:k, :k], whole[:k, k] = own, forcing
    whole[k : k + m - 1, k + 1 :] = np.eye(m - 1)
    passed = expm(whole)
    factorials = np.array([math.factorial(j) for j in range(m)])
    return np.ascontiguousarray(passed[:k, :k]), passed[:k, k:] @ (shapes * factorials).T


def _with_ends(signal: Real, periodic: bool, cubic: bool) -> Real:
    """The signal extended at its ends by the values that the line or cubic of the outermost steps needs."""
    if not cubic:
        return np.append(signal, signal[0]) if periodic else np.ascontiguousarray(signal)
    if periodic:
        return np.concatenate([signal[-1:], signal, signal[:2]])
    before, after = (3 * e[0] - 3 * e[1] + e[2] for e in (signal[:3], signal[:-4:-1]))
    return np.concatenate([[before], signal, [after]])
