"""Compiled kernels of the hysteresis stage, over signals at nodes."""

from __future__ import annotations

from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__, fastmath={"reassoc"})


@_jit
def widened_plays(drive_V, widening, thresholds_V, weights, laps, wide_V, plain_V, change_V):
    """What plays of thresholds that vary with time give, less what they give at their own.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
    widening : ndarray, shape (n - 1,)
        Factor on all thresholds from a node to the next.
    thresholds_V, weights : ndarray, shape (k,)
    laps : int
        The last one stays.
    wide_V, plain_V : ndarray, shape (k,)
        States of both kinds of plays, on entry and on return.
    change_V : ndarray, shape (n,)
        Filled. At a node where the widening jumps, the mean of what is before and after.
    """
    nodes = drive_V.shape[0]
    plain = _played(drive_V[0], 1.0, thresholds_V, weights, plain_V)
    wide = _played(drive_V[0], 1.0, thresholds_V, weights, wide_V)
    factor = 1.0
    for _ in range(laps):
        for i in range(nodes - 1):
            after = wide
            if widening[i] != factor:
                factor = widening[i]
                after = _played(drive_V[i], factor, thresholds_V, weights, wide_V)
            change_V[i] = 0.5 * (wide + after) - plain
            plain = _played(drive_V[i + 1], 1.0, thresholds_V, weights, plain_V)
            wide = _played(drive_V[i + 1], factor, thresholds_V, weights, wide_V)
        change_V[nodes - 1] = wide - plain


@_jit
def _played(u, factor, thresholds_V, weights, states_V):
    total = 0.0
    for k in range(thresholds_V.shape[0]):
        r = factor * thresholds_V[k]
        w = max(u - r, min(u + r, states_V[k]))
        states_V[k] = w
        total += weights[k] * w
    return total
