"""Linear elements: the resonator by Runge–Kutta as one matrix; filters exact for lines between points."""

from collections.abc import Sequence

import numpy as np
from numba import njit
from scipy.signal import cont2discrete, lfilter

from experiments.concealed_rig.grid import Grid


@njit(cache=True)
def _recursion(h, a, b0, b1, b2, x0, v0, x, v):
    for c in range(h.shape[0]):
        s, w = x0[c], v0[c]
        for k in range(x.shape[1]):
            x[c, k], v[c, k] = s, w
            if k + 1 < x.shape[1]:
                f0, f1, f2 = h[c, 2 * k], h[c, 2 * k + 1], h[c, 2 * k + 2]
                s, w = (
                    a[0, 0] * s + a[0, 1] * w + b0[0] * f0 + b1[0] * f1 + b2[0] * f2,
                    a[1, 0] * s + a[1, 1] * w + b0[1] * f0 + b1[1] * f1 + b2[1] * f2,
                )


def linear_motion(
    angular_rad_per_s: float, damping_ratio: float, forcing_V: np.ndarray, grid: Grid
) -> tuple[np.ndarray, np.ndarray]:
    """Deflection and speed (over ω₀) of the linear resonator: classical Runge–Kutta, its step written out as a matrix.

    With s' = A s + h(t)e₂ one step is s + (k1 + 2k2 + 2k3 + k4)/6, linear in s and in h at the beginning, middle
    and end. The periodic state is (I − Pᴺ)⁻¹ times where rest ends after one period.

    Parameters
    ----------
    angular_rad_per_s, damping_ratio : float
    forcing_V : ndarray, shape (c, 2·steps + 1) or (2·steps + 1,)
    grid : Grid

    Returns
    -------
    tuple of ndarray, shape (c, steps + 1) or (steps + 1,)
    """
    h = np.ascontiguousarray(np.atleast_2d(forcing_V), dtype=float)
    t = grid.step_s * angular_rad_per_s
    a = np.array([[0.0, 1.0], [-1.0, -2 * damping_ratio]]) * t
    e, one = np.array([0.0, t]), np.eye(2)
    step = one + a @ (one + a @ (one / 2 + a @ (one / 6 + a / 24)))
    b0 = (one / 6 + a @ (one / 6 + a @ (one / 12 + a / 24))) @ e
    b1 = (2 * one / 3 + a @ (one / 3 + a / 12)) @ e
    b2 = e / 6
    rest = np.zeros(h.shape[0])
    x, v = np.empty((h.shape[0], grid.steps + 1)), np.empty((h.shape[0], grid.steps + 1))
    _recursion(h, step, b0, b1, b2, rest, rest, x, v)
    if grid.periodic:
        start = np.linalg.solve(one - np.linalg.matrix_power(step, grid.steps), np.stack((x[:, -1], v[:, -1])))
        _recursion(h, step, b0, b1, b2, np.ascontiguousarray(start[0]), np.ascontiguousarray(start[1]), x, v)
    return (x, v) if np.ndim(forcing_V) == 2 else (x[0], v[0])


def filtered(
    numerator: Sequence[float], denominator: Sequence[float], signal: np.ndarray, interval_s: float, periodic: bool
) -> np.ndarray:
    """A transfer function on a signal that is linear between its points (first-order hold, exact).

    Parameters
    ----------
    numerator, denominator : sequence of float
        Powers of s, highest first.
    signal : ndarray, shape (n,)
        Periodic: its last point is the first one again; twenty laps settle the filter at most.
    interval_s : float
    periodic : bool
        False: at rest before the first point.
    """
    # The time in units of the interval: coefficients stay near one.
    scale = interval_s ** np.arange(20)
    num = np.array(numerator) * scale[: len(numerator)][::-1] ** -1
    den = np.array(denominator) * scale[: len(denominator)][::-1] ** -1
    b, a, _ = cont2discrete((num, den), 1.0, method="foh")
    b = np.atleast_1d(b.squeeze())
    signal = signal + 1e-100  # a filter at rest must not fade into numbers that are too small to be fast
    if not periodic:
        return lfilter(b, a, signal)
    lap = signal[:-1]
    slowest = np.max(np.abs(np.roots(a)), initial=1e-9)
    laps = min(20, 1 + int(np.ceil(np.log(1e-10) / (np.log(min(slowest, 1 - 1e-12)) * lap.size))))
    out = lfilter(b, a, np.tile(lap, laps + 1))[-lap.size :]
    return np.append(out, out[0])


@njit(cache=True)
def _relaxation(u, decay, x0, out):
    n = out.shape[0]
    gain = np.empty(n)
    for j in range(n):
        # Exact for a line between points: (1 − d)/(−ln d) is the weight of the old end.
        gain[j] = (1.0 - decay[j]) / -np.log(decay[j])
    x = x0.copy()
    for k in range(u.size):
        for j in range(n):
            if k > 0:
                x[j] = decay[j] * x[j] + (gain[j] - decay[j]) * u[k - 1] + (1.0 - gain[j]) * u[k]
            out[j, k] = x[j]


def relaxations(signal: np.ndarray, times_s: np.ndarray, interval_s: float, periodic: bool) -> np.ndarray:
    """First-order elements τx' = u − x, exact for lines between points, from rest or in the steady period.

    Parameters
    ----------
    signal : ndarray, shape (n,)
    times_s : ndarray, shape (c,)
    interval_s : float
    periodic : bool

    Returns
    -------
    ndarray, shape (c, n)
    """
    u = np.ascontiguousarray(signal, dtype=float)
    decay = np.exp(-np.minimum(interval_s / np.asarray(times_s, dtype=float), 600.0))
    out = np.empty((decay.size, u.size))
    start = np.zeros(decay.size)
    _relaxation(u, decay, start, out)
    if periodic:
        over_lap = -np.expm1(-(u.size - 1) * interval_s / np.asarray(times_s, dtype=float))
        _relaxation(u, decay, out[:, -1] / over_lap, out)
    return out
