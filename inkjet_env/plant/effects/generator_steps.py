"""A generator whose output is a staircase: it is updated at intervals, in steps of its converter."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.effects.trigger_delay import late
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

PERIODS = (0.01, 0.025, 0.05, 0.1, 0.2)
"""Update intervals of the starts, in periods of the head."""
BITS = (8, 7, 6, 5, 4)
"""Numbers of bits of the starts, for a range as large as the drive's."""
UNRESOLVED = 1 / 16
"""Update interval in nodes below which its steps are not followed; the hold is then a delay by half an interval."""
LEAST_V = 1e-9
"""Step in volts below which there is none."""


class GeneratorSteps(Effect):
    """Zero-order hold, begun with the recording, and rounding to the levels of the converter.

    A node has the mean of the staircase over one node step, so that edges between nodes count.
    """

    id = "generator_steps"
    stage = "drive"
    sentence = "The generator's output is a staircase: it is updated at intervals and has a finite resolution."
    equation = (
        "u(t) = q round(u_requested((⌊t/T⌋ + ahead) T) / q), T = update_s + update_share × duration of the "
        "recording, q resolution_V; T = 0: no hold, q = 0: no rounding; points_share of the rounding is that of the "
        "drive's samples, with straight lines between them"
    )
    source = (
        "A. V. Oppenheim, R. W. Schafer, Discrete-Time Signal Processing, 3rd edition, Pearson, 2010, chapter 4: "
        "zero-order hold and quantisation"
    )
    parameters = (
        Parameter("update_s", "s", 0.0, 1.0, meaning="T: interval between updates of the output"),
        Parameter("resolution_V", "V", 0.0, 1e3, meaning="q: step between neighbouring levels"),
        Parameter("update_share", "1", 0.0, 0.5, meaning="T over the duration: a memory of so many points, 1/share"),
        Parameter(
            "ahead", "1", 0.0, 1.0, meaning="place in an interval whose value is held; 1/2: no mean delay", plain=0.0
        ),
        Parameter(
            "points_share",
            "1",
            0.0,
            1.0,
            meaning="1: points of the drive are rounded; 0: the voltage in between too",
            open_ended=True,
            plain=0.0,
        ),
    )
    strengths = ("update_s", "resolution_V", "update_share")
    rugged = ("update_s", "resolution_V", "update_share")
    signature = "edges are staircases, late by half an update on average; held levels are off by up to half a step"
    confusable_with = ("trigger_delay", "amplifier_bandwidth", "sensor_bandwidth")
    shown_by = "slow edges sampled finely, and the voltage at the head (column drive_monitor_V)"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        swing_V = max((float(np.ptp(s.drive_V)) for s in excitations if s.fast), default=0.0) or printhead.full_scale_V
        off = {p.name: 0.0 for p in self.parameters}
        held = [off | {"update_s": part / printhead.frequency_Hz} for part in PERIODS]
        centred = [one | {"ahead": 0.5} for one in held]
        usual_s = float(np.median([_duration_s(s) for s in excitations if s.fast] or [100 / printhead.frequency_Hz]))
        shared = [off | {"update_share": one["update_s"] / usual_s, "ahead": 0.5} for one in held]
        return [*held, *centred, *shared, *(off | {"resolution_V": swing_V / 2**bits} for bits in BITS)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"update_s": 0.05 / printhead.frequency_Hz, "resolution_V": 1.0}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        largest_V = max((float(np.abs(s.drive_V).max()) for s in excitations), default=0.0)
        most_V = min(largest_V, 1e3) if largest_V > LEAST_V else 1e3
        period_s = 1 / printhead.frequency_Hz
        shortest_s = min((_duration_s(s) for s in excitations if s.fast), default=10 * period_s)
        return {
            "update_s": (0.0, min(period_s, 1.0)),
            "resolution_V": (0.0, most_V),
            "update_share": (0.0, min(period_s / shortest_s, 0.5)),
        }

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        said = []
        if values["update_s"]:
            said.append(f"is updated only every {with_prefix(values['update_s'], 's', 3)}")
        if values["resolution_V"]:
            said.append(f"has steps of {with_prefix(values['resolution_V'], 'V', 3)}")
        if values["update_share"]:
            said.append(f"has {1 / values['update_share']:.4g} points in each recording, however long")
        return f"The generator's output {' and '.join(said)}." if said else self.sentence

    def advance_s(self, values: Values) -> float:
        return values["update_s"] if values["ahead"] else 0.0  # the update before the start

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        update_s = values["update_s"] + values["update_share"] * _duration_s(excitation)
        nodes = min(update_s, excitation.nodes * excitation.node_step_s) / excitation.node_step_s
        step_V = values["resolution_V"]
        if step_V < LEAST_V:
            step_V = 0.0
        if nodes == step_V == 0:
            return drive_V
        share = values["points_share"] if nodes < UNRESOLVED and step_V else 0.0
        if nodes < UNRESOLVED:
            held_V = late(drive_V, (0.5 - values["ahead"]) * nodes, excitation.periodic) if nodes else drive_V
            stairs_V = _cell_means(held_V, excitation.periodic, step_V)
        else:
            stairs_V = staircase_means(drive_V, nodes, step_V, excitation.periodic, values["ahead"])
        result: Real = drive_V + (1 - share) * (stairs_V - _cell_means(drive_V, excitation.periodic))
        return result + share * (_rounded_points(held_V, step_V, excitation) - drive_V) if share else result


def _duration_s(excitation: Excitation) -> float:
    """Time from the first sample to the last, or the period of a repeated drive, in seconds."""
    return (excitation.samples - (not excitation.periodic)) * excitation.step_s


def staircase_means(drive_V: Real, nodes: float, step_V: float, periodic: bool, ahead: float = 0.0) -> Real:
    """Mean of the held and rounded drive from half a node before to half a node after each node, shape (n,).

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Requested drive at the nodes, in volts, linear between them.
    nodes : float
        Update interval in nodes, above 0. The first update is at the first node.
    step_V : float
        Step of the converter, in volts; 0: none.
    periodic : bool
        Whether the drive is repeated, and the updates with it; otherwise its ends are held.
    ahead : float
        Share of an interval after an update at which the drive has the value that is held.
    """
    n = drive_V.size
    ends_V = np.append(drive_V, drive_V[0] if periodic else drive_V[-1])
    updates = nodes * np.arange(math.floor(n / nodes) + 1)
    asked = updates + ahead * nodes
    levels_V = np.interp(asked % n if periodic else asked, np.arange(n + 1), ends_V)
    if step_V > 0:
        levels_V = step_V * np.round(levels_V / step_V)
    knots = np.append(updates, max(n, float(updates[-1])))
    area = np.append(0.0, np.cumsum(levels_V * np.diff(knots)))
    until = np.interp(np.arange(n + 1) - 0.5, knots, area)
    until[0] = until[-1] - area[-1] if periodic else -0.5 * levels_V[0]
    means: Real = np.diff(until)
    return means


def _cell_means(drive_V: Real, periodic: bool, step_V: float = 0.0) -> Real:
    """Mean of the drive, rounded to multiples of a step above 0, over half a node step on either side of each node."""
    before, after = np.roll(drive_V, 1), np.roll(drive_V, -1)
    if not periodic:
        before[0], after[-1] = drive_V[0], drive_V[-1]
    middles = [0.5 * (drive_V + neighbour) for neighbour in (before, after)]
    if step_V == 0:
        means: Real = 0.25 * (middles[0] + middles[1]) + 0.5 * drive_V
        return means
    first, second = (_rounded_mean(drive_V / step_V, middle / step_V) for middle in middles)
    rounded: Real = 0.5 * step_V * (first + second)
    return rounded


def _rounded_points(drive_V: Real, step_V: float, excitation: Excitation) -> Real:
    """The drive at the nodes if its samples are rounded to multiples of a step, with straight lines in between."""
    points_V = step_V * np.round(drive_V[:: excitation.substeps] / step_V)
    at = np.arange(drive_V.size) / excitation.substeps
    period = points_V.size if excitation.periodic else None
    result: Real = np.interp(at, np.arange(points_V.size), points_V, period=period)
    return result


def _rounded_mean(a: Real, b: Real) -> Real:
    """Mean of ``round`` over the straight line from a to b."""
    whole_a, whole_b = np.round(a), np.round(b)
    area = whole_b * (b - 0.5 * whole_b) - whole_a * (a - 0.5 * whole_a)
    same = whole_a == whole_b
    result: Real = np.where(same, whole_a, area / np.where(same, 1.0, b - a))
    return result
