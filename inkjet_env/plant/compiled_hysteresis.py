"""Compiled kernels of the hysteresis stage, over signals at nodes."""

from __future__ import annotations

import numpy as np

from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__, fastmath={"reassoc"})


@_jit
def rated_plays(
    drive_V, measure, growth, widening_V, relaxation, thresholds_V, weights, warm_up_periods, states_V, output_V
):
    """Weighted plays whose thresholds follow a measure of the rate and which may lag, from the demagnetised state.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Drive at the nodes in volts, linear between them.
    measure : ndarray, shape (n,)
        Measure of the rate at the nodes, dimensionless.
    growth, widening_V : float
        At the measure m, a threshold r becomes ``r (1 + growth m) + widening_V m``, but not below 0.
    relaxation : float
        Time constant, in steps, with which a play approaches its branch; 0: it follows at once.
    thresholds_V, weights : ndarray, shape (k,)
        Thresholds in volts and dimensionless weights of the plays.
    warm_up_periods : int
        Number of passes over the drive, at least 1; the last one is the output.
    states_V : ndarray, shape (k,)
        Scratch for the states of the plays.
    output_V : ndarray, shape (n,)
        Filled with the sum of the plays, in volts.
    """
    states_V[:] = 0.0
    output_V[0] = _played(drive_V[0], growth, widening_V, measure[0], thresholds_V, weights, states_V)
    for _ in range(warm_up_periods):
        for i in range(1, drive_V.shape[0]):
            if relaxation > 0.0:
                output_V[i] = _followed(
                    drive_V[i - 1],
                    drive_V[i],
                    growth,
                    widening_V,
                    measure[i],
                    relaxation,
                    thresholds_V,
                    weights,
                    states_V,
                )
            elif drive_V[i] != drive_V[i - 1] or measure[i] != measure[i - 1]:
                output_V[i] = _played(drive_V[i], growth, widening_V, measure[i], thresholds_V, weights, states_V)
            else:
                output_V[i] = output_V[i - 1]
        if warm_up_periods > 1:
            output_V[0] = output_V[-1]  # a repeated drive ends where it starts


@_jit
def _played(u, growth, widening_V, measure, thresholds_V, weights, states_V):
    total = 0.0
    for k in range(thresholds_V.shape[0]):
        r = max(thresholds_V[k] * (1.0 + growth * measure) + widening_V * measure, 0.0)
        w = max(u - r, min(u + r, states_V[k]))
        states_V[k] = w
        total += weights[k] * w
    return total


@_jit
def _followed(u, later, growth, widening_V, measure, relaxation, thresholds_V, weights, states_V):
    """`_played` a step later for plays that approach their branch with a time constant: exact while it drags them."""
    edge, keep = later - u, np.exp(-1.0 / relaxation)
    total = 0.0
    for k in range(thresholds_V.shape[0]):
        r = max(thresholds_V[k] * (1.0 + growth * measure) + widening_V * measure, 0.0)
        w = states_V[k]
        elapsed, sign = 0.0, 1.0 if u - w > r else -1.0
        for _ in range(2):  # the branch that drags the play first, then the other
            # Distance of the branch ahead of the play, in its own direction, now and at the end of the step.
            ahead, end, slope = sign * (u + edge * elapsed - w) - r, sign * (later - w) - r, sign * edge
            if ahead > 0.0 or end > 0.0:
                kept = keep if elapsed == 0.0 else np.exp((elapsed - 1.0) / relaxation)
                if ahead < 0.0:
                    ahead, kept = 0.0, np.exp(-end / (slope * relaxation))
                # It trails a ramp by the lag, plus a decaying rest of the initial distance.
                behind = slope * relaxation + (ahead - slope * relaxation) * kept
                if behind >= 0.0:
                    w += sign * (end - behind)
                    break
                met = relaxation * np.log1p(-ahead / (slope * relaxation))  # time at which the branch returns to it
                w += sign * (ahead + slope * met)
                elapsed += met
            sign = -sign
        states_V[k] = w
        total += weights[k] * w
    return total


@_jit
def leaning_plays(drive_V, lean, tilt, thresholds_V, weights, warm_up_periods, states_V, output_V):
    """Weighted plays between branches of unequal slopes, from the demagnetised state.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Drive at the nodes, in volts.
    lean : float
        The rising branch of every play follows ``(1 + lean) u``, the falling one ``(1 - lean) u``; dimensionless.
    tilt : float
        The same in proportion to the threshold r, in 1/V: ``(1 ± r tilt) u``.
    thresholds_V, weights : ndarray, shape (k,)
        Thresholds in volts and dimensionless weights of the plays.
    warm_up_periods : int
        Number of passes over the drive, at least 1; the last one is the output.
    states_V : ndarray, shape (k,)
        Scratch for the states of the plays.
    output_V : ndarray, shape (n,)
        Filled with the sum of the plays, in volts; a play whose branches have crossed follows ``u``.
    """
    states_V[:] = 0.0
    for _ in range(warm_up_periods):
        for i in range(drive_V.shape[0]):
            u = drive_V[i]
            apart, less = lean * u, 1.0 - tilt * u
            total = 0.0
            for k in range(thresholds_V.shape[0]):
                half = max(thresholds_V[k] * less - apart, 0.0)
                w = max(u - half, min(u + half, states_V[k]))
                states_V[k] = w
                total += weights[k] * w
            output_V[i] = total


@_jit
def played(signal, threshold, warm_up_periods, output):
    """One play of a signal, from a state of 0, over ``warm_up_periods`` passes; the last one is the output."""
    w = 0.0
    for _ in range(warm_up_periods):
        for i in range(signal.shape[0]):
            w = max(signal[i] - threshold, min(signal[i] + threshold, w))
            output[i] = w


@_jit
def remembered_maximum(signal, keep, warm_up_periods, output):
    """Largest value of a signal so far, at least 0, that fades by ``keep`` from node to node, over several passes."""
    value = 0.0
    for _ in range(warm_up_periods):
        for i in range(signal.shape[0]):
            value = max(signal[i], keep * value)
            output[i] = value


@_jit
def reversed_share(drive, coercive, keep, start, result):
    """Share of reversed domains at the nodes; returns it one step after the last.

    Parameters
    ----------
    drive : ndarray, shape (n,)
        Voltage at the nodes, in volts.
    coercive : float
        Magnitude of the voltage beyond which the share changes, in volts.
    keep : float
        Share of the way to 0 or 1 that is left after a step.
    start : float
        Share at the first node.
    result : ndarray, shape (n,)
        Filled with the share at the nodes.
    """
    share = start
    for i in range(drive.shape[0]):
        result[i] = share
        if drive[i] < -coercive:
            share = 1.0 - keep * (1.0 - share)
        elif drive[i] > coercive:
            share = keep * share
    return share
