"""Compiled kernels of the hysteresis stage, over signals at nodes."""

from __future__ import annotations

from inkjet_env.printhead.kernel_cache import kernel_jit

_jit = kernel_jit(__file__, fastmath={"reassoc"})


@_jit
def widened_plays(drive_V, widening, thresholds_V, weights, laps, states_V, output_V):
    """Weighted plays whose thresholds vary with time, from the demagnetised state.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
    widening : ndarray, shape (n - 1,)
        Factor on all thresholds from a node to the next; 1 before the first.
    thresholds_V, weights : ndarray, shape (k,)
    laps : int
        The last one stays.
    states_V : ndarray, shape (k,)
        Scratch.
    output_V : ndarray, shape (n,)
        Filled. At a node where the widening jumps, the mean of what is before and after.
    """
    states_V[:] = 0.0
    factor = 1.0
    before = _played(drive_V[0], factor, thresholds_V, weights, states_V)
    for _ in range(laps):
        for i in range(widening.shape[0]):
            after = before
            if widening[i] != factor:
                factor = widening[i]
                after = _played(drive_V[i], factor, thresholds_V, weights, states_V)
            output_V[i] = 0.5 * (before + after)
            before = after
            if drive_V[i + 1] != drive_V[i]:
                before = _played(drive_V[i + 1], factor, thresholds_V, weights, states_V)
        output_V[widening.shape[0]] = before


@_jit
def _played(u, factor, thresholds_V, weights, states_V):
    total = 0.0
    for k in range(thresholds_V.shape[0]):
        r = factor * thresholds_V[k]
        w = max(u - r, min(u + r, states_V[k]))
        states_V[k] = w
        total += weights[k] * w
    return total


@_jit
def leaning_plays(drive_V, lean, thresholds_V, weights, laps, states_V, output_V):
    """Weighted plays between a steeper rising branch and a flatter falling one, from the demagnetised state.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
    lean : float
        The rising branch follows ``(1 + lean) u``, the falling one ``(1 - lean) u``; ``u`` where they have crossed.
    thresholds_V, weights : ndarray, shape (k,)
    laps : int
        The last one stays.
    states_V : ndarray, shape (k,)
        Scratch.
    output_V : ndarray, shape (n,)
        Filled.
    """
    states_V[:] = 0.0
    for _ in range(laps):
        for i in range(drive_V.shape[0]):
            u, apart = drive_V[i], lean * drive_V[i]
            total = 0.0
            for k in range(thresholds_V.shape[0]):
                half = max(thresholds_V[k] - apart, 0.0)
                w = max(u - half, min(u + half, states_V[k]))
                states_V[k] = w
                total += weights[k] * w
            output_V[i] = total
