"""Input of each instrument from a head: hysteretic drive, self-sensed signal, deflection."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.plant import Excitation, Plant
from inkjet_env.plant.augmented import STEPS_A_PERIOD, AugmentedPrinthead
from inkjet_env.printhead import Printhead, respond_sampled
from inkjet_env.printhead.resonator import PiecewiseResponse
from inkjet_env.printhead.response import branch_rates
from inkjet_env.rig.battery import DriveLine
from inkjet_env.typing import Real


def answer_V(printhead: Printhead | AugmentedPrinthead, line: DriveLine, order: int = 1) -> Real:
    """Input of the line's instrument in volts, shape (n,); exact at the samples, but for a head with effects.

    Strain gauge: `absolute_hysteretic_V`. Displacement: `deflection_V`. Self-sensing: the head's sensor signal, in the
    steady state of a repeated drive, in which the resonator rings over from one repetition to the next; otherwise from
    rest.

    Parameters
    ----------
    printhead : Printhead or AugmentedPrinthead
        The head. Random effects of a head contribute nothing.
    line : DriveLine
        The drive and the channel.
    order : int
        Position of the recording within its session, for effects that change with it.
    """
    if isinstance(printhead, AugmentedPrinthead):
        return _answer_with_effects_V(printhead, line, order)
    if line.channel == "strain_gauge":
        return absolute_hysteretic_V(printhead, line.drive_V, line.initial_state)
    if line.channel == "displacement":
        return deflection_V(printhead, line.drive_V, line.step_s, line.initial_state)
    ringing = "steady" if line.initial_state == "periodic" else "rest"
    return respond_sampled(printhead, line.time_s, line.drive_V, line.initial_state, ringing=ringing).sensor_V


def excitation_of(head: AugmentedPrinthead, line: DriveLine, order: int) -> Excitation:
    """A line as the plant sees it: a fast one on at least 200 nodes per period of the head's resonance."""
    least = line.step_s * STEPS_A_PERIOD * head.frequency_Hz if line.channel != "strain_gauge" else 2.0
    substeps = 2 * max(math.ceil(least / 2), 1)
    return Excitation(line.channel, line.initial_state, line.step_s, line.drive_V, order, substeps=substeps)


def _answer_with_effects_V(head: AugmentedPrinthead, line: DriveLine, order: int) -> Real:
    remainder = head.remainder if line.channel == "self_sensing" else None  # other channels' have other units
    gains = {"strain_gauge": 1.0, "displacement": 1.0}
    plant = Plant(head.printhead, gains, effects=head.effects, remainder=remainder)
    try:
        return plant.signal(excitation_of(head, line, order))
    except FloatingPointError as error:
        raise ValueError(f"line {line.label}: the head with its effects cannot follow this drive: {error}") from None


def absolute_hysteretic_V(printhead: Printhead, drive_V: ArrayLike, initial_state: str) -> Real:
    """Hysteretic drive at the samples in volts, shape (n,); 0 V is the demagnetised ceramic.

    A repeated drive started from there too, so its hysteretic drive has a definite level, and one offset holds for
    every recording of a channel.
    """
    drive = np.asarray(drive_V, dtype=np.float64)
    if initial_state == "demagnetised":
        return printhead.branch_law.hysteretic_V(drive, "demagnetised")
    return printhead.branch_law.hysteretic_V(np.tile(drive, 2), "demagnetised")[drive.size :]


def deflection_V(printhead: Printhead, drive_V: ArrayLike, step_s: float, initial_state: str) -> Real:
    """Deflection at the samples as the static hysteretic drive that would hold it, in volts, shape (n,).

    It is ``a0 / (s² + a1 s + a0)`` on the hysteretic drive, exact for a drive that is linear between samples.

    Parameters
    ----------
    printhead : Printhead
        The head.
    drive_V : array_like, shape (n,)
        Drive at the samples in volts, linear between them.
    step_s : float
        Sampling step, in seconds.
    initial_state : {"periodic", "demagnetised"}
        ``periodic``: steady state of the repeated drive. ``demagnetised``: the resonator rests at the first sample.
    """
    law, drive = printhead.branch_law, np.asarray(drive_V, dtype=np.float64)
    periodic = initial_state == "periodic"
    rows = law.pieces(np.append(drive, drive[0]) if periodic else drive, initial_state)
    segments = drive.size if periodic else drive.size - 1
    standing = np.setdiff1d(np.arange(segments), rows[:, 0].astype(int))
    rates = branch_rates(law, rows)
    segment = np.concatenate([rows[:, 0], standing])
    order = np.argsort(segment, kind="stable")
    duration_s = np.concatenate([rows[:, 2], np.ones(standing.size)])[order] * step_s
    rate_V = np.concatenate([rates, np.zeros((standing.size, rates.shape[1]))])[order]
    ringing = PiecewiseResponse(printhead.a0, printhead.a1, printhead.b1, duration_s, rate_V)
    if periodic:
        left = np.exp(ringing.pole * segments * step_s)
        ringing = PiecewiseResponse(
            printhead.a0, printhead.a1, printhead.b1, duration_s, rate_V, ringing.amplitude[-1] / (1 - left)
        )
    first = np.searchsorted(segment[order], np.arange(drive.size))  # index of the piece that starts at each sample
    amplitude = ringing.amplitude[first]
    moved = ((ringing.pole + printhead.a1) * amplitude).imag / printhead.b1  # as in Response.deflection_V
    return absolute_hysteretic_V(printhead, drive, initial_state) - moved
