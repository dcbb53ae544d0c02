"""What a head does under a drive, on one scale: the signals from which the features of a remainder are made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.lag import lagged
from inkjet_env.plant.resonance import Resonance
from inkjet_env.typing import Real

SIGNALS = ("drive", "hysteretic", "deflection", "speed")
"""Signals of a head: drive at the ceramic, hysteretic drive, deflection, and speed over ω0. All are in volts."""


@dataclass(frozen=True, eq=False)
class HeadMotion:
    """Signals of a head in one recording, simulated freely.

    Parameters
    ----------
    excitation : Excitation
        The recording: nodes, initial state and repetition.
    signals_V : mapping of str to ndarray, shape (nodes,)
        Those of `SIGNALS` that the channel has: a quasi-static channel has neither deflection nor speed.
    """

    excitation: Excitation
    signals_V: Mapping[str, Real]

    def largest_V(self, samples: int) -> dict[str, float]:
        """Largest magnitude of each signal in the first samples, in volts."""
        nodes = samples * self.excitation.substeps
        return {name: float(np.abs(signal[:nodes]).max(initial=0.0)) for name, signal in self.signals_V.items()}

    def scaled(self, scales_V: Mapping[str, float]) -> ScaledMotion:
        """The signals divided by their scales, and limited to the range from -1 to 1.

        Parameters
        ----------
        scales_V : mapping of str to float
            Scale of each signal, in volts, above 0.
        """
        limited = {name: np.clip(signal / scales_V[name], -1.0, 1.0) for name, signal in self.signals_V.items()}
        return ScaledMotion(self.excitation, limited)


@dataclass(frozen=True, eq=False)
class ScaledMotion:
    """Signals of a head between -1 and 1, and their copies with a memory.

    Parameters
    ----------
    excitation : Excitation
        The recording.
    signals : mapping of str to ndarray, shape (nodes,)
        Dimensionless signals.
    """

    excitation: Excitation
    signals: Mapping[str, Real]

    def __getitem__(self, name: str) -> Real:
        return self.signals[name]

    def delayed(self, name: str, delay_s: float) -> Real:
        """A signal ``delay_s`` seconds later (earlier if negative), linear between nodes, shape (nodes,).

        Before the first node of a drive that has not been repeated, the signal is its first value; after the last
        one, its last value.
        """
        signal, step_s = self.signals[name], self.excitation.node_step_s
        places = np.arange(signal.size, dtype=np.float64) - delay_s / step_s
        if self.excitation.periodic:
            return np.interp(places % signal.size, np.arange(signal.size + 1), np.append(signal, signal[0]))
        return np.interp(places, np.arange(signal.size), signal)

    def lagged(self, name: str, time_constant_s: float) -> Real:
        """A signal behind a first-order low-pass, shape (nodes,)."""
        return lagged(self.signals[name], time_constant_s, self.excitation.node_step_s, self.excitation.periodic)

    def play(self, name: str, threshold: float) -> Real:
        """Output of a play operator, shape (nodes,): it follows the signal at a distance of at most ``threshold``.

        It starts relaxed, at the value nearest to 0; under a repeated drive the output is that of the second period.
        """
        from inkjet_env.plant.compiled_hysteresis import played

        signal, periodic = np.ascontiguousarray(self.signals[name]), self.excitation.periodic
        ends = np.append(signal, signal[0]) if periodic else signal
        output = np.empty(ends.size)
        played(ends, threshold, 2 if periodic else 1, output)
        return output[: signal.size]


def head_motion(resonance: Resonance | None, drive_V: Real, hysteretic_V: Real, excitation: Excitation) -> HeadMotion:
    """The signals of a head, simulated freely.

    Parameters
    ----------
    resonance : Resonance or None
        Resonance of the head in this recording; None for a quasi-static channel.
    drive_V, hysteretic_V : ndarray, shape (nodes,)
        Voltage at the ceramic, and hysteretic drive, in volts.
    excitation : Excitation
        The recording.

    Raises
    ------
    SimulationError
        The head cannot be simulated under this drive.
    """
    signals = {"drive": drive_V, "hysteretic": hysteretic_V}
    if resonance is not None:
        own = resonance.refilled(hysteretic_V, excitation).oscillator
        deflection_V, rate = own.motion(hysteretic_V, excitation)
        signals["deflection"] = _at_nodes(deflection_V, rate, excitation)
        signals["speed"] = _at_nodes(rate / math.sqrt(own.a0), None, excitation)
    return HeadMotion(excitation, signals)


def _at_nodes(samples: Real, slopes: Real | None, excitation: Excitation) -> Real:
    """Values at the nodes, shape (nodes,), from those at the samples and, if known, their slopes per second.

    Linear interpolation is not enough: a recording may have fewer than ten samples in a period of the resonance.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    if excitation.periodic:
        samples = np.append(samples, samples[0])
        slopes = None if slopes is None else np.append(slopes, slopes[0])
    times_s = np.arange(samples.size) * np.float64(excitation.step_s)
    if slopes is not None:
        curve = CubicHermiteSpline(times_s, samples, slopes)
    elif samples.size > 2:
        curve = CubicSpline(times_s, samples, bc_type="periodic" if excitation.periodic else "not-a-knot")
    else:
        return excitation.refined(samples[: excitation.samples])
    return np.asarray(curve(excitation.time_s), dtype=np.float64)
