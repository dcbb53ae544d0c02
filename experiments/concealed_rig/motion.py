"""Compiled: the equation of motion that `resonator` states, by the classical fourth-order Runge–Kutta method.

What has a memory of turning points (plays on the deflection, Rayleigh's law) is evaluated inside a step from the memory
at its beginning; the memory moves at its end.
"""

import numpy as np
from numba import njit

# The order of resonator.Resonator's scalars.
OMEGA, ZETA, CUBIC, DRAG, RAYLEIGH, ADDED, FRICTION, FRICTION_SPEED, ELECTRO, GAP, GAP_SOFT = range(11)
CAVITATION, CAVITATION_SPEED, MASS, SECOND, SECOND_ZETA = range(11, 16)
MENISCUS, MENISCUS_KIND, MENISCUS_TIME, MENISCUS_ZETA, MENISCUS_V, MENISCUS_DAMPING = range(16, 22)
CUBIC_BOUND, DRAG_POWER, STRIBECK, STRIBECK_SPEED, ENVELOPE, ENVELOPE_LOSS = range(22, 28)
QUADRATIC, INERTANCE, VAN_DER_POL, VAN_DER_POL_V, STOP_AT, STOP, STOP_LOSS = range(28, 35)
AUTO, AUTO_RATIO, AUTO_ZETA = range(35, 38)
STATES = 6  # x, v, x2, v2, q, q'
MOST_TURNS = 256


@njit(cache=True)
def _derivative(s, h, u, p, slip, slip_weight, slip_state, branch, rate, weight, out):
    x, v = s[0], s[1]
    force = h - (1.0 + p[ELECTRO] * u + p[MENISCUS] * s[4] + p[ADDED]) * x
    if p[CUBIC] != 0.0:
        force -= p[CUBIC] * x * x * x / (1.0 + p[CUBIC_BOUND] * x * x)
    damping = 2.0 * p[ZETA] * v
    if p[MENISCUS_DAMPING] != 0.0:
        damping += 2.0 * p[ZETA] * p[MENISCUS_DAMPING] * s[4] * v
    if p[ENVELOPE] != 0.0 or p[ENVELOPE_LOSS] != 0.0:
        size = np.sqrt(x * x + v * v)
        force += p[ENVELOPE] * size * x
        damping += p[ENVELOPE_LOSS] * size * v
    force -= p[QUADRATIC] * x * x
    if p[VAN_DER_POL] != 0.0:
        damping -= 2.0 * p[ZETA] * p[VAN_DER_POL] * (1.0 - (x / p[VAN_DER_POL_V]) ** 2) * v
    if p[STOP] != 0.0 and x > p[STOP_AT]:
        force -= p[STOP] * (x - p[STOP_AT])
        damping += p[STOP_LOSS] * (x - p[STOP_AT]) * v
    if p[CAVITATION] != 0.0 and -v > p[CAVITATION_SPEED]:
        damping += 2.0 * p[ZETA] * p[CAVITATION] * (v + p[CAVITATION_SPEED])
    if p[DRAG] != 0.0:
        if p[DRAG_POWER] == 0.0:
            damping += p[DRAG] * abs(v) * v
        else:
            # of the same force as the square at the speed 1 / DRAG in which powers are measured
            damping += abs(p[DRAG]) ** p[DRAG_POWER] * abs(v) ** p[DRAG_POWER] * v
    if p[FRICTION] != 0.0:
        dry = p[FRICTION] * np.tanh(v / p[FRICTION_SPEED])
        if p[STRIBECK] != 0.0:
            dry *= 1.0 + p[STRIBECK] * np.exp(-((v / p[STRIBECK_SPEED]) ** 2))
        damping += dry
    if p[GAP_SOFT] != 0.0:
        force += p[GAP_SOFT] * max(-p[GAP], min(p[GAP], x))
    if p[RAYLEIGH] != 0.0:
        # branch: turning point, what the law took away there, virgin or not
        span = x - branch[0]
        if branch[2] == 0.0:
            force += p[RAYLEIGH] * x * abs(x)
        else:
            force += branch[1] + 0.5 * p[RAYLEIGH] * span * abs(span)
    for j in range(slip.size):
        force += slip_weight[j] * max(x - slip[j], min(x + slip[j], slip_state[j]))
    for j in range(rate.size):
        z = s[STATES + j]
        damping += weight[j] * z
        out[STATES + j] = v - rate[j] * z
    if p[MASS] != 0.0:
        pull = p[SECOND] * p[SECOND] * (s[2] - x) + 2.0 * p[SECOND_ZETA] * p[SECOND] * (s[3] - v)
        force += p[MASS] * pull
        out[2] = s[3]
        out[3] = -pull
    if p[AUTO] != 0.0:
        # potential: AUTO x² q, so that energy is exchanged and never made
        force -= 2.0 * p[AUTO] * x * s[2]
        out[2] = s[3]
        out[3] = -p[AUTO_RATIO] * (p[AUTO_RATIO] * s[2] + 2.0 * p[AUTO_ZETA] * s[3]) - p[AUTO] * x * x
    if p[MENISCUS_KIND] == 1.0:
        out[4] = (abs(v) / p[MENISCUS_V] - s[4]) / p[MENISCUS_TIME]
    elif p[MENISCUS_KIND] == 2.0:
        w = 1.0 / p[MENISCUS_TIME]
        out[4] = s[5]
        out[5] = w * w * ((v / p[MENISCUS_V]) ** 2 - s[4]) - 2.0 * p[MENISCUS_ZETA] * w * s[5]
    elif p[MENISCUS_KIND] == 3.0:
        out[4] = (max(v, 0.0) / p[MENISCUS_V] - s[4]) / p[MENISCUS_TIME]
    elif p[MENISCUS_KIND] == 4.0:
        out[4] = ((v / p[MENISCUS_V]) ** 2 - s[4]) / p[MENISCUS_TIME]
    out[0] = v
    if p[INERTANCE] == 0.0:
        out[1] = force - damping
    else:
        # kinetic energy (1 + m x) v²/2
        out[1] = (force - damping - 0.5 * p[INERTANCE] * v * v) / (1.0 + p[INERTANCE] * x)


@njit(cache=True)
def _turned(x_old, x_new, v_old, v_new, r, turn, taken, count, branch):
    """Move the memory of Rayleigh's law over one step; the number of turning points."""
    if v_old * v_new < 0.0 and (count > 0 or x_old != 0.0):
        at = max(x_old, x_new) if v_old > 0.0 else min(x_old, x_new)
        if count == 0:
            if (at > 0.0) == (v_old > 0.0):
                turn[0], taken[0], count = at, r * at * abs(at), 1
        elif count < MOST_TURNS:
            span = at - turn[count - 1]
            taken[count] = taken[count - 1] + 0.5 * r * span * abs(span)
            turn[count] = at
            count += 1
    up = v_new > 0.0
    while count > 1 and ((up and x_new > turn[count - 2]) or (not up and x_new < turn[count - 2])):
        count -= 2
    if count == 1 and abs(x_new) > abs(turn[0]) and (x_new > 0.0) != (turn[0] > 0.0):
        count = 0
    if count == 0:
        branch[2] = 0.0
    else:
        branch[0], branch[1], branch[2] = turn[count - 1], taken[count - 1], 1.0
    return count


@njit(cache=True)
def integrate(h, u, step, p, slip, slip_weight, rate, weight, laps, tolerance, x, v):
    """Fill x and v at the steps, shape (steps + 1,); return 0 done, 1 diverged, 2 not settled."""
    n = STATES + rate.size
    s, at = np.zeros(n), np.zeros(n)
    k1, k2, k3, k4 = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    slip_state = np.zeros(slip.size)
    turn, taken, branch = np.zeros(MOST_TURNS + 1), np.zeros(MOST_TURNS + 1), np.zeros(3)
    turns = 0
    steps = x.size - 1
    for lap in range(laps):
        difference = 0.0
        largest = 0.0
        slow = s[4]
        for k in range(steps + 1):
            difference = max(difference, abs(s[1] - v[k]) if lap > 0 else np.inf)
            largest = max(largest, abs(s[1]))
            x[k], v[k] = s[0], s[1]
            if k == steps:
                break
            h0, h1, h2 = h[2 * k], h[2 * k + 1], h[2 * k + 2]
            u0, u1, u2 = u[2 * k], u[2 * k + 1], u[2 * k + 2]
            _derivative(s, h0, u0, p, slip, slip_weight, slip_state, branch, rate, weight, k1)
            for i in range(n):
                at[i] = s[i] + 0.5 * step * k1[i]
            _derivative(at, h1, u1, p, slip, slip_weight, slip_state, branch, rate, weight, k2)
            for i in range(n):
                at[i] = s[i] + 0.5 * step * k2[i]
            _derivative(at, h1, u1, p, slip, slip_weight, slip_state, branch, rate, weight, k3)
            for i in range(n):
                at[i] = s[i] + step * k3[i]
            _derivative(at, h2, u2, p, slip, slip_weight, slip_state, branch, rate, weight, k4)
            x_old, v_old = s[0], s[1]
            for i in range(n):
                s[i] += step / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
            for j in range(slip.size):
                slip_state[j] = max(s[0] - slip[j], min(s[0] + slip[j], slip_state[j]))
            if p[RAYLEIGH] != 0.0:
                turns = _turned(x_old, s[0], v_old, s[1], p[RAYLEIGH], turn, taken, turns, branch)
        if not np.isfinite(s[0]) or abs(s[0]) > 1e5:
            return 1
        if laps == 1 or difference <= tolerance * largest:
            return 0
        if lap >= 2 and p[MENISCUS_KIND] != 0.0 and p[MENISCUS_KIND] != 2.0:
            # A slow state settles like exp(−t/T): go to where this lap's change would end.
            left = 1.0 - np.exp(-steps * step / p[MENISCUS_TIME])
            s[4] = slow + (s[4] - slow) / left
    return 2
