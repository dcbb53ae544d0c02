"""Steady state of a motion whose forces remember it: found in far fewer periods than the memory takes to settle."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.force import Memory
from inkjet_env.typing import Real

MOST_PERIODS = 150
"""Largest number of simulated periods."""
DEPTH = 8
"""Largest number of preceding steps from which the next one is found."""
SHORTEST_STEP = 1e-3
"""Relative step below which it is no longer halved where the motion grows without bound."""
STEADY_MEMORY = 1e-7
"""Relative distance of a memory from its balance below which it is steady."""


def settle(
    run: Callable[[complex], complex], state: complex, decay: complex, memories: Sequence[Memory], steady: float
) -> complex:
    """Simulate periods until the motion and all memories repeat, and leave the last period as the result.

    A period changes state and memories; each change over the share that decays in a period would lead to the steady
    state if they did not depend on each other. Anderson's acceleration (D. G. Anderson, Journal of the ACM 12, 1965)
    of that iteration finds where they do.

    Parameters
    ----------
    run : function
        Simulates a period from an amplitude in volts, and from the memories as they are; returns the last amplitude.
    state : complex
        Amplitude at the start of the first period, in volts.
    decay : complex
        Share of a change of the amplitude that decays over a period, in linear motion.
    memories : sequence of Memory
        Relaxing memories of the forces, as they are at the start.
    steady : float
        Relative change of the amplitude over a period below which it is steady.

    Returns
    -------
    complex
        Amplitude at the end of the last period, in volts.

    Raises
    ------
    SimulationError
        The motion grows without bound, or no steady state was found.
    """
    points: list[Real] = []
    steps: list[Real] = []
    point = np.concatenate([[state.real, state.imag], *(memory.relaxing for memory in memories)])
    ends = np.cumsum([2, *(memory.relaxing.size for memory in memories)])
    for _ in range(MOST_PERIODS):
        before = np.split(point, ends[:-1])[1:]
        for memory, values in zip(memories, before, strict=True):
            memory.set(values)
        state = complex(point[0], point[1])
        end = run(state)
        if not np.isfinite(end):  # too far in one step
            if not points or np.abs(point - points[-1]).max() <= SHORTEST_STEP * np.abs(point).max():
                raise SimulationError("the motion grows without bound.")
            point = 0.5 * (point + points[-1])
            continue
        change = (end - state) / decay
        moved = [memory.step(values) for memory, values in zip(memories, before, strict=True)]
        sizes = [memory.size for memory in memories]
        if abs(end - state) <= steady * max(abs(state), 1e-12) and all(
            np.abs(step).max() <= STEADY_MEMORY * size for step, size in zip(moved, sizes, strict=True)
        ):
            return end
        scales = np.repeat([max(abs(end), 1e-12), *sizes], [2, *(step.size for step in moved)])
        points = [*points[-DEPTH:], point]
        steps = [*steps[-DEPTH:], np.concatenate([[change.real, change.imag], *moved])]
        point = _accelerated(points, steps, scales)
    raise SimulationError("there is no steady state under the repeated drive.")


def _accelerated(points: Sequence[Real], steps: Sequence[Real], scales: Real) -> Real:
    """Next point, shape (k,): where the step would vanish if it were linear in the point, as far as that is known."""
    following: Real = points[-1] + steps[-1]
    if len(points) == 1:
        return following
    moved, changed = np.diff(points, axis=0), np.diff(steps, axis=0)
    shares = np.linalg.lstsq((changed / scales).T, steps[-1] / scales, rcond=1e-10)[0]
    result: Real = following - shares @ (moved + changed)
    return result
