"""Play operators: a drive in, their weighted sum out.

Source: M. Brokate, J. Sprekels, Hysteresis and Phase Transitions (Springer 1996), chapter 2: a play of threshold r
follows ``w = max(u − r, min(u + r, w))``; the Prandtl–Ishlinskii operator is a superposition of plays.
"""

import numpy as np
from numba import njit


@njit(cache=True, fastmath=True)
def _lap(drive, threshold, weight, state, out, record):
    last = np.inf
    y = 0.0
    for k in range(drive.size):
        u = drive[k]
        if u != last:
            y = 0.0
            for i in range(threshold.size):
                p = max(u - threshold[i], min(u + threshold[i], state[i]))
                state[i] = p
                y += weight[i] * p
            last = u
        if record:
            out[k] = y


def play_sum_V(drive_V: np.ndarray, threshold_V: np.ndarray, weight: np.ndarray, periodic: bool) -> np.ndarray:
    """Weighted sum of play operators.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        In volts, monotone between its points; for a periodic drive the last point is the first one again.
    threshold_V, weight : ndarray, shape (r,)
    periodic : bool
        True: the drive had been repeating (one lap settles plays). False: virgin, all plays at 0 V.

    Returns
    -------
    ndarray, shape (n,)
    """
    # A play whose threshold exceeds the whole drive never leaves 0 V.
    moved = threshold_V < np.max(np.abs(drive_V), initial=0.0)
    threshold, weight = np.ascontiguousarray(threshold_V[moved]), np.ascontiguousarray(weight[moved])
    drive = np.ascontiguousarray(drive_V, dtype=float)
    state, out = np.zeros(threshold.size), np.empty(drive.size)
    if periodic:
        _lap(drive, threshold, weight, state, out, False)
    _lap(drive, threshold, weight, state, out, True)
    return out


@njit(cache=True)
def _branch(u, up, lowest, width, weights, moments, u_turn, y_turn, turns):
    """Sum of plays at `u`, and how many turning points are left; the first of them stands for the virgin state."""
    # A loop that closes is forgotten, and the branch before it goes on (Madelung's rules).
    while turns > 2 and (u >= u_turn[turns - 2] if up else u <= u_turn[turns - 2]):
        turns -= 2
    if turns == 2 and abs(u) >= abs(u_turn[1]):
        turns = 1
    # The virgin curve is Σ w max(|u| − r, 0); every later branch is that curve, twice as large.
    way, scale = u - u_turn[turns - 1], 1.0 if turns == 1 else 2.0
    reach = abs(way) / scale
    moved = min(max(int(np.ceil((reach - lowest) / width)), 0), weights.size - 1)
    rise = scale * (weights[moved] * reach - moments[moved])
    return y_turn[turns - 1] + (rise if way > 0.0 else -rise), turns


@njit(cache=True)
def _smooth_laps(drive, lowest, width, weights, moments, laps, out):
    n = drive.size
    u_turn, y_turn = np.zeros(2 * n * laps + 2), np.zeros(2 * n * laps + 2)
    last, y, up, turns = 0.0, 0.0, drive[0] > 0.0, 1
    for _ in range(laps):
        for k in range(n):
            # Where the drive turns: a parabola's vertex, and when, in points. It comes before or after the point.
            before = drive[k] - drive[k - 1] if k > 0 else 0.0
            after = drive[k + 1] - drive[k] if k + 1 < n else 0.0
            turning = (before > 0.0 > after) or (before < 0.0 < after)
            late = 0.5 * (before + after) / (before - after) if turning else 0.0
            vertex = drive[k] + 0.25 * (before + after) * late
            for part in range(2):
                u = vertex if (part == 0) == (late < 0.0) else drive[k]
                if u != last:
                    if (u > last) != up:
                        up = not up
                        if turns > 1 or last != 0.0:
                            u_turn[turns], y_turn[turns] = last, y
                            turns += 1
                    y, turns = _branch(u, up, lowest, width, weights, moments, u_turn, y_turn, turns)
                    last = u
                if (part == 0) != (late < 0.0):
                    out[k] = y


def smooth_play_sum_V(drive_V: np.ndarray, threshold_V: np.ndarray, weight: np.ndarray, periodic: bool) -> np.ndarray:
    """`play_sum_V` of a drive that is smooth through its points and turns between them, thresholds equally far apart.

    It remembers turning points in place of plays, which takes a few operations a point.

    Source: M. Brokate, J. Sprekels (see above), chapter 2: Madelung's rules and the branches of Prandtl and Ishlinskii.
    """
    weights, moments = (np.concatenate(([0.0], np.cumsum(row))) for row in (weight, weight * threshold_V))
    width = (threshold_V[-1] - threshold_V[0]) / (threshold_V.size - 1)
    drive, out = np.ascontiguousarray(drive_V, dtype=float), np.empty(drive_V.size)
    _smooth_laps(drive, threshold_V[0], width, weights, moments, 2 if periodic else 1, out)
    return out


@njit(cache=True, fastmath=True)
def _lap_of_many(drive, threshold, weights, state, out, record):
    last = np.inf
    columns = weights.shape[0]
    for k in range(drive.size):
        u = drive[k]
        if u == last:
            if record:
                for j in range(columns):
                    out[j, k] = out[j, k - 1]
            continue
        last = u
        for i in range(threshold.size):
            state[i] = max(u - threshold[i], min(u + threshold[i], state[i]))
        if record:
            for j in range(columns):
                y = 0.0
                for i in range(threshold.size):
                    y += weights[j, i] * state[i]
                out[j, k] = y


def play_sums_V(drive_V: np.ndarray, threshold_V: np.ndarray, weights: np.ndarray, periodic: bool) -> np.ndarray:
    """Several weighted sums of the same plays: `weights` of shape (c, r) give an array of shape (c, n)."""
    moved = threshold_V < np.max(np.abs(drive_V), initial=0.0)
    threshold, weights = np.ascontiguousarray(threshold_V[moved]), np.ascontiguousarray(weights[:, moved])
    drive = np.ascontiguousarray(drive_V, dtype=float)
    state, out = np.zeros(threshold.size), np.empty((weights.shape[0], drive.size))
    if periodic:
        _lap_of_many(drive, threshold, weights, state, out, False)
    _lap_of_many(drive, threshold, weights, state, out, True)
    return out


@njit(cache=True, fastmath=True)
def _changing_lap(drive, rate, threshold, weight, growth, gain, skew, swing, follow, late, state, out, record):
    for k in range(drive.size):
        u = drive[k] - late * (drive[k] - drive[k - 1] if k > 0 else 0.0)
        wider = growth * rate[k]
        lean = 1.0 + skew * u / swing
        y = 0.0
        for i in range(threshold.size):
            r = (threshold[i] + wider) * lean
            p = state[i]
            p += follow * (max(u - r, min(u + r, p)) - p)
            state[i] = p
            y += weight[i] * p
        if record:
            out[k] = y * (1.0 + gain * rate[k])


def following(time_points: float) -> tuple[float, float]:
    """Share f of its way that x' = (u − x)/τ goes in one point, and by how much of a point's change u is to be late.

    x += f(u − late·Δu − x) then lags a ramp by τ exactly: f = 1 − exp(−1/τ), late = 1 + τ − 1/f, τ in points.
    """
    if time_points <= 0:
        return 1.0, 0.0
    follow = -np.expm1(-1 / time_points)
    return float(follow), float(1 + time_points - 1 / follow)


def changing_play_sum_V(
    drive_V: np.ndarray,
    threshold_V: np.ndarray,
    weight: np.ndarray,
    periodic: bool,
    *,
    rate: np.ndarray | None = None,
    threshold_growth_V: float = 0.0,
    weight_growth: float = 0.0,
    skew: float = 0.0,
    skew_swing_V: float = 100.0,
    relaxation_points: float = 0.0,
    laps: int = 3,
) -> np.ndarray:
    """Plays whose thresholds or weights follow the rate, whose envelopes are unequal, or which relax.

    Parameters
    ----------
    drive_V, threshold_V, weight, periodic
        As in `play_sum_V`.
    rate : ndarray, shape (n,), optional
        A measure of the drive's rate (its logarithm, say), one a point.
    threshold_growth_V, weight_growth : float
        Thresholds plus growth·rate, in volts (Al Janaideh, Su, Rakheja: Smart Mater. Struct. 17 (2008) 035026, the
        rate-dependent play); weights times 1 + growth·rate (Ang, Garmon, Khosla, Riviere, IEEE/ASME Trans.
        Mechatronics 12 (2007) 134).
    skew, skew_swing_V : float
        Thresholds times 1 + skew·u/swing: envelopes (1 ∓ r·skew/swing)u ∓ r of unequal slope, a generalised play
        (Al Janaideh, Rakheja, Su: IEEE/ASME Trans. Mechatronics 16 (2011) 734).
    relaxation_points : float
        Time within which a play goes to where it should be, in points; exact for a play that follows a ramp.
    laps : int
        Periods gone through before the recorded one.
    """
    drive = np.ascontiguousarray(drive_V, dtype=float)
    factor = np.zeros(drive.size) if rate is None else np.ascontiguousarray(rate, dtype=float)
    state, out = np.zeros(threshold_V.size), np.empty(drive.size)
    changes = (threshold_growth_V, weight_growth, skew, skew_swing_V, *following(relaxation_points))
    arguments = (drive, factor, threshold_V, weight, *changes, state)
    for _ in range(laps if periodic else 0):
        _changing_lap(*arguments, out, False)
    _changing_lap(*arguments, out, True)
    return out
