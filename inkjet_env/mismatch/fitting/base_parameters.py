"""The base model's parameters: as a vector that a fit moves, scaled by convention, and started from a printhead."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from inkjet_env.identification.convention import conventional_swing
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.plant import Effect, Excitation, Plant, SimulationError, Values
from inkjet_env.plant.stages import law_changes, law_levels
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

LARGEST = 1e13
"""Largest coefficient of a direction in which the law is moved: `SMALL` times it is still a valid coefficient."""
SMALL = 1e-5
"""Relative finite-difference step of a base parameter."""


@dataclass(frozen=True, eq=False)
class Head:
    """The base model's parameters as a vector: coefficients of the law, ln a0, ln a1, gains, offsets.

    Attributes
    ----------
    printhead : Printhead
        Dynamics ``a0``, ``a1``, ``b1`` and the branch law.
    gains, offsets : dict of str to float
        By channel: signal for a `Plant.motion` of 1, and signal at rest, in the channel's unit. The drive monitor has
        both too, because a probe is only as exact as its calibration.
    """

    printhead: Printhead
    gains: Mapping[str, float]
    offsets: Mapping[str, float]

    @property
    def reference(self) -> str:
        """The channel whose gain is held fixed, because law and gains share a scale."""
        return next(c for c in ("strain_gauge", "self_sensing", "displacement") if c in self.gains)

    @property
    def free_gains(self) -> tuple[str, ...]:
        """Channels whose gain is fitted."""
        return tuple(c for c in self.gains if c != self.reference)

    @property
    def degree(self) -> int:
        """Degree of the branch law."""
        return len(self.printhead.coefficients) - 1

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.degree + 2 + len(self.free_gains) + len(self.offsets)

    def moved(self, step: NDArray[np.floating]) -> Head:
        """The head after a step.

        Parameters
        ----------
        step : ndarray, shape (size,)
            Change of the law's coefficients, of ln a0 and ln a1, of the free gains (relative), and of the offsets
            (absolute, in the channel's unit).

        Raises
        ------
        SimulationError
            The step leads to invalid printhead parameters.
        """
        d, free = self.degree, self.free_gains
        rest = step[d + 2 :]
        gains = dict(self.gains)
        for channel, change in zip(free, rest, strict=False):
            gains[channel] *= 1 + float(change)
        offsets = {c: o + float(s) for (c, o), s in zip(self.offsets.items(), rest[len(free) :], strict=True)}
        ascending = self.printhead.branch_law.ascending[1:] + step[:d]
        try:
            printhead = Printhead(
                self.printhead.a0 * math.exp(step[d]),
                self.printhead.a1 * math.exp(step[d + 1]),
                gains.get("self_sensing", self.printhead.b1),
                (*(float(c) for c in ascending[::-1]), 0.0),
                self.printhead.full_scale_V,
            )
        except (ValueError, OverflowError) as error:
            raise SimulationError(str(error)) from error
        return Head(printhead, gains, offsets)

    def plant(self, effects: Sequence[tuple[Effect, Values]] = ()) -> Plant:
        """The plant of this head with these effects switched on."""
        return Plant(self.printhead, self.gains, self.offsets, tuple(effects))

    def sensitivities(self, observed: ObservedRecording, effects: Sequence[tuple[Effect, Values]] = ()) -> Real:
        """Derivatives of a recording's signal with respect to the step of `moved`, these effects on: (n, size)."""
        if effects and observed.channel != "drive_monitor":
            return self._differences(observed, effects)
        excitation, d = observed.excitation, self.degree
        plant = self.plant()
        columns = np.zeros((excitation.samples, self.size))
        columns[:, d + 2 + len(self.free_gains) + list(self.offsets).index(excitation.channel)] = 1.0
        if excitation.channel == "drive_monitor":
            columns[:, d + 2 + self.free_gains.index(excitation.channel)] = (
                plant.gain(excitation.channel) * excitation.drive_V
            )
            return columns
        drive_V = excitation.drive_at_nodes_V
        gain = plant.gain(excitation.channel)
        total = plant.motion(drive_V, excitation)
        for j in range(d):
            columns[:, j] = gain * plant.motion_of_power(j, excitation)
        if excitation.fast:
            for place in (0, 1):
                ends = {sign: self._motion_beside(place, sign * SMALL, excitation) for sign in (1, -1)}
                # Of a resonator about to be overdamped, one neighbour does not ring.
                found = {sign: total if end is None else end for sign, end in ends.items()}
                apart = SMALL * max(sum(end is not None for end in ends.values()), 1)
                columns[:, d + place] = gain / apart * (found[1] - found[-1])
        if excitation.channel in self.free_gains:
            columns[:, d + 2 + self.free_gains.index(excitation.channel)] = gain * total
        return columns

    def _motion_beside(self, place: int, change: float, excitation: Excitation) -> Real | None:
        """Motion of the head with ``ln a0`` (place 0) or ``ln a1`` (1) changed; None if such a head does not ring."""
        step = np.zeros(self.size)
        step[self.degree + place] = change
        try:
            return self.moved(step).plant().motion(excitation.drive_at_nodes_V, excitation)
        except SimulationError:
            return None

    def _differences(self, observed: ObservedRecording, effects: Sequence[tuple[Effect, Values]]) -> Real:
        """`sensitivities` by finite differences of the plant."""
        excitation, channel, d = observed.excitation, observed.channel, self.degree
        largest = max(float(np.abs(observed.measured).max()), 1e-12)
        directions = self._directions(observed)
        plant = self.plant(effects)
        drive_V = plant.at_ceramic_V(excitation)
        levels_V = law_levels(drive_V, self.printhead, excitation)
        changes_V = law_changes(drive_V, self.printhead, excitation, directions)
        hysteretic_V = plant.after_law_V(levels_V, drive_V, excitation)
        motion = plant.motion_under(hysteretic_V, excitation)
        here = plant.shown(motion, drive_V, excitation)
        columns = np.zeros((here.size, self.size))
        steps = dict.fromkeys(range(d), SMALL)
        if excitation.fast:
            steps |= {d: SMALL, d + 1: SMALL}
        if channel in self.free_gains:
            steps[d + 2 + self.free_gains.index(channel)] = SMALL
        offset = d + 2 + len(self.free_gains) + list(self.offsets).index(channel)
        if any(effect.acts_in("sensing") for effect, _ in effects):
            steps[offset] = SMALL * largest
        else:
            columns[:, offset] = 1.0
        for k, size in steps.items():
            step = np.zeros(self.size)
            step[k] = size
            if k < d:
                step[:d] = size * directions[:, k]
            moved = self.moved(step).plant(effects)  # of the stages, only those that the step reaches
            changed_V, changed = hysteretic_V, motion
            if k < d:
                changed_V = moved.after_law_V(levels_V + size * changes_V[:, k], drive_V, excitation)
            elif k < d + 2 and plant.of("hysteresis"):
                changed_V = moved.after_law_V(levels_V, drive_V, excitation)
            if k < d + 2:
                changed = moved.motion_under(changed_V, excitation)
            columns[:, k] = (moved.shown(changed, drive_V, excitation) - here) / size
        columns[:, : self.degree] = np.linalg.solve(directions.T, columns[:, : self.degree].T).T
        return columns

    def _directions(self, observed: ObservedRecording) -> Real:
        """Well-conditioned directions in which to move the law, as coefficients of powers; columns, shape (d, d).

        They are Chebyshev polynomials, less their value at 0 and as large as the law itself, over the part of the law
        that the drive reaches: twice the drive's size from a demagnetised start. Powers are nearly collinear, so a
        step of a fit is a small difference of large multiples of them, and the error of each power's finite difference
        would be many times the step.
        """
        least = (2 ** (2 * self.degree - 1) / LARGEST) ** (1 / self.degree)
        reach = float(np.clip(2 * np.abs(observed.excitation.drive_V).max() / self.printhead.full_scale_V, least, 1.0))
        swing = abs(float(self.printhead.branch_law.Q(reach))) or 1.0
        return swing * _chebyshev(self.degree, reach)


@lru_cache(maxsize=1024)
def _chebyshev(degree: int, reach: float) -> Real:
    """Chebyshev polynomials over 0 … reach less their value at 0, as coefficients of powers; columns, shape (d, d)."""
    table = np.zeros((degree, degree))
    for k in range(degree):
        powers = Chebyshev.basis(k + 1, domain=[0.0, reach]).convert(kind=Polynomial)
        table[: k + 1, k] = powers.coef[1:]
    table.flags.writeable = False
    return table


def in_convention(head: Head) -> Head:
    """The same head with its law's swing set by convention and gains and ``b1`` scaled to match.

    A head whose law has no swing, or so small a one that the scaled head would be invalid, is returned unchanged.
    """
    law, swing = head.printhead, float(head.printhead.branch_law.Q(1.0))
    factor = conventional_swing(law.full_scale_V) / swing if swing > 0 else math.inf
    try:
        scaled = replace(law, coefficients=tuple(factor * c for c in law.coefficients), b1=law.b1 / factor)
    except ValueError:
        return head
    gains = {c: g if c == "drive_monitor" else g / factor for c, g in head.gains.items()}
    return Head(scaled, gains, head.offsets)


def gains_and_offsets(
    observed: Sequence[ObservedRecording], printhead: Printhead
) -> tuple[dict[str, float], dict[str, float]]:
    """Gain and offset of each channel, by least squares with a given head; the gain of self-sensing is its ``b1``.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        Recordings of which the fitted samples are used; the drive monitor is left out.
    printhead : Printhead
        The given head.

    Returns
    -------
    gains, offsets : dict of str to float
        By channel, as `Head` has them.
    """
    gains, offsets = {}, {}
    head = Head(printhead, {"self_sensing": printhead.b1}, {})
    for channel in sorted({o.channel for o in observed} - {"drive_monitor"}):
        mine = [o for o in observed if o.channel == channel]
        shape = np.concatenate(
            [head.plant().motion(o.excitation.drive_at_nodes_V, o.excitation)[: o.fitted] for o in mine]
        )
        measured = np.concatenate([o.measured[: o.fitted] for o in mine])
        if channel == "self_sensing":
            gains[channel] = printhead.b1
            offsets[channel] = float(np.mean(measured - printhead.b1 * shape))
        else:
            size = max(float(np.abs(shape).max()), 1e-300)
            found = np.linalg.lstsq(np.column_stack([shape / size, np.ones(shape.size)]), measured, rcond=None)[0]
            gains[channel], offsets[channel] = float(found[0]) / size, float(found[1])
    return gains, offsets
