"""Drive stage: the generator's steps, the amplifier's supply, the cable, and a capacitance that follows the voltage."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.effects.sensing import slope_V_per_s
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.linear import filtered, relaxations
from experiments.concealed_rig.measurement import Measurement

SECOND_SECTION = 1.7
# What a grid has to follow, over the ringing. A ferrite's corners are sharper; a line's echoes have corners for ever,
# and are taken from the resonator's own grid.
FOLLOWED = {"series": 1.0, "ladder": SECOND_SECTION, "ferrite": 1.5, "line": 0.0}


def _shifted(drive_V: np.ndarray, points: float, periodic: bool) -> np.ndarray:
    """A drive some points later, linear between them."""
    late = np.arange(drive_V.size) - points
    late = late % (drive_V.size - 1) if periodic else np.clip(late, 0, drive_V.size - 1)
    return np.interp(late, np.arange(drive_V.size), drive_V)


@njit(cache=True)
def _reflected(u, delay, q, laps, out):
    """v(t) = (1 − q) u(t − delay/2) + q v(t − delay), the delay in points, at least one; `u` comes delayed."""
    points = u.size - (1 if laps > 1 else 0)
    before = np.full(u.size, u[0])
    whole = int(np.floor(delay))
    part = delay - whole
    for _ in range(laps):
        for k in range(u.size):
            late = 0.0
            for side in range(2):
                i = k - whole - side
                share = part if side == 1 else 1.0 - part
                if i >= 0:
                    late += share * out[i]
                elif laps > 1:
                    late += share * before[(i + points) % points]
                else:
                    late += share * u[0]
            out[k] = (1.0 - q) * u[k] + q * late
        before[:] = out


@dataclass(frozen=True)
class DriveResonance(Effect):
    """Cable and head ring with each other; its strength is f₀ over the frequency of that ringing.

    Variants: "series", inductance and capacitance, 1/(s²/w² + 2ζs/w + 1); "ladder", two such sections, the second one
    1.7 times as high; "ferrite", an inductance that a resistance bridges, (1 + 2ζs/w)/(s²/w² + 2ζs/w + 1), without a
    mean delay; "line", a cable of some length whose two ends reflect, v = (1 − q)u(t − T) + q v(t − 2T), q < 0, ringing
    at 1/(4T).

    Source: H. W. Johnson, M. Graham, High-Speed Digital Design (1993), chapters 3 and 4 (ringing of a lumped circuit;
    of a line with a low source and a high load impedance).
    """

    id = "drive_resonance"
    stage = "drive"
    start = 0.1
    weakest = 1e-4
    strongest = 0.9

    resonance_Hz: float = field(default=5e4, kw_only=True)
    damping_ratio: float = field(default=0.2, kw_only=True)
    reflection: float = field(default=-0.5, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "DriveResonance":
        """Damping ratios of 0.02 … 0.12; reflections of −0.6 … −0.9: a circuit that damps more is but a delay."""
        return cls(
            variant=str(rng.choice(["series", "ladder", "ferrite", "line"])),
            resonance_Hz=situation.head.resonance_Hz,
            damping_ratio=float(rng.uniform(0.02, 0.12)),
            reflection=-float(rng.uniform(0.6, 0.9)),
        )

    @property
    def ringing_Hz(self) -> float:
        """Frequency of the (first) ringing."""
        return self.resonance_Hz / self.strength

    @property
    def fastest_Hz(self) -> float:
        """Frequency of the highest ringing, or what it takes to follow it."""
        return FOLLOWED[self.variant] * self.ringing_Hz if self.strength else 0.0

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Ring."""
        if not self.strength:
            return drive_V
        if self.variant == "line":
            delay = 1 / (2 * self.ringing_Hz) / grid.half_s
            if delay < 1:  # shorter than the points: only the line's mean delay is left
                return _shifted(drive_V, delay / 2 * (1 + self.reflection) / (1 - self.reflection), grid.periodic)
            out = np.empty(drive_V.size)
            laps = 3 if grid.periodic else 1
            _reflected(_shifted(drive_V, delay / 2, grid.periodic), delay, self.reflection, laps, out)
            return out
        w, zeta = 2 * np.pi * self.ringing_Hz, self.damping_ratio
        if w * grid.half_s > 300:
            return drive_V
        start = drive_V[0]
        lead = [2 * zeta / w, 1.0] if self.variant == "ferrite" else [1.0]
        section = [1 / w**2, 2 * zeta / w, 1.0]
        if self.variant == "ladder":  # both at once: what comes out of the first one is not straight between the points
            w *= SECOND_SECTION
            section = list(np.polymul(section, [1 / w**2, 2 * zeta / w, 1.0]))
        return start + filtered(lead, section, drive_V - start, grid.half_s, grid.periodic)

    def parameters(self) -> dict[str, Any]:
        """Frequency of the ringing, and its damping ratio or the product of the reflections."""
        if self.variant == "line":
            return {"frequency_Hz": self.ringing_Hz, "reflection": self.reflection}
        return {"frequency_Hz": self.ringing_Hz, "damping_ratio": self.damping_ratio}


@dataclass(frozen=True)
class SupplyDroop(Effect):
    """The amplifier's supply sags under load and recovers; its strength is the largest sag of a steep full swing.

    The load current is |C dU/dt|; a reservoir q' = (|dU/dt|·T/100 V − q)/T gives it and is recharged within T.

    Variants: "common", one supply, v = u(1 − s q); "split", positive and negative supplies, each sagging under its own
    edges and lowering its own polarity; "foldback", one that only sags beyond a first part, s·max(q − q₀, 0).

    Source: P. Horowitz, W. Hill, The Art of Electronics (2015), chapter 9 (reservoir capacitors, sag and recovery).
    """

    id = "supply_droop"
    stage = "drive"
    start = 1e-2
    weakest = 1e-7
    strongest = 0.6

    recovery_s: float = field(default=1e-4, kw_only=True)
    reserve: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SupplyDroop":
        """Recoveries of 30 … 400 µs."""
        variant = str(rng.choice(["common", "split", "foldback"]))
        reserve = float(rng.uniform(0.2, 0.8)) if variant == "foldback" else 0.0
        return cls(variant=variant, recovery_s=float(10 ** rng.uniform(-4.5, -3.4)), reserve=reserve)

    def _sag(self, edges_V_per_s: np.ndarray, grid: Grid) -> np.ndarray:
        """State of a reservoir at the half steps: 1 after an edge of 100 V that is short against its recovery."""
        ends = (edges_V_per_s[-1], edges_V_per_s[0]) if grid.periodic else (edges_V_per_s[0], edges_V_per_s[-1])
        around = np.concatenate((ends[:1], edges_V_per_s, ends[1:]))
        load = (around[:-1] + around[1:]) / 2 * self.recovery_s / 100.0
        state = relaxations(load, np.array([self.recovery_s]), grid.half_s, grid.periodic)[0]
        return np.maximum(state - self.reserve, 0.0)

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Sag and recover."""
        if not self.strength:
            return drive_V
        rate = np.diff(drive_V) / grid.half_s
        if self.variant != "split":
            return drive_V * (1 - np.minimum(self.strength * self._sag(np.abs(rate), grid), 0.95))
        up, down = self._sag(np.maximum(rate, 0.0), grid), self._sag(np.maximum(-rate, 0.0), grid)
        sag = np.where(drive_V > 0, up, down)
        return drive_V * (1 - np.minimum(self.strength * sag, 0.95))

    def parameters(self) -> dict[str, Any]:
        """Sag after an edge of 100 V, recovery time, and the part of it that the reservoir gives freely."""
        return {"droop_per_100_V": self.strength, "recovery_s": self.recovery_s, "reserve": self.reserve}


@dataclass(frozen=True)
class GeneratorSteps(Effect):
    """The generator holds its output between updates, and has few bits; strength: update interval or step.

    Variants: "hold", a clock of its own, its interval as a share of the resonance's period; "memory", a fixed number of
    points in each recording; "bits", a rounded voltage, its step as a share of 100 V. Of a hold the mean delay of half
    an interval is no part: the trigger is set by what comes out, and a delay has an id of its own.

    Source: A. V. Oppenheim, R. W. Schafer, Discrete-Time Signal Processing (2010), chapter 4 (zero-order hold);
    B. Widrow, I. Kollár, Quantization Noise (2008).
    """

    id = "generator_steps"
    stage = "drive"
    start = 2e-2
    weakest = 1e-5
    strongest = 0.5

    period_s: float = field(default=2e-5, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "GeneratorSteps":
        """One of three."""
        return cls(variant=str(rng.choice(["hold", "memory", "bits"])), period_s=1 / situation.head.resonance_Hz)

    def _interval_s(self, grid: Grid) -> float:
        if self.variant == "memory":
            # Of a recording of forty periods, the interval is the one of "hold".
            return self.strength * grid.steps * grid.step_s / 40
        return self.strength * self.period_s

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Hold, or round."""
        if not self.strength:
            return drive_V
        if self.variant == "bits":
            step = 100.0 * self.strength
            return step * np.round(drive_V / step)
        interval = self._interval_s(grid) / grid.half_s
        if interval < 1e-3:
            return drive_V
        # Mean over each interval between points of what is held, so that no point is all or nothing.
        at = np.arange(drive_V.size)
        edges = np.linspace(-0.5, 0.5, 17)[:-1] + 1 / 32
        held = np.zeros(drive_V.size)
        for edge in edges:
            moment = (np.floor((at + edge) / interval + 1e-9) + 0.5) * interval
            moment = moment % (drive_V.size - 1) if grid.periodic else np.maximum(moment, 0.0)
            held += np.interp(moment, at, drive_V)
        return held / edges.size

    def parameters(self) -> dict[str, Any]:
        """Update interval on the fast channels, points in a recording, or voltage step."""
        if self.variant == "bits":
            return {"step_V": 100.0 * self.strength}
        if self.variant == "memory":
            return {"points_per_recording": 40 / self.strength}
        return {"update_s": self.strength * self.period_s}


@njit(cache=True)
def _charged(u, step, time, bend, turn, laps, out):
    """τ(v) v' = u − v, u linear between the points: exponential steps with τ of their middle."""
    v = u[0]
    for _ in range(laps):
        out[0] = v
        for k in range(1, u.size):
            middle = v
            for _ in range(2):
                share = middle / 100.0
                way = 1.0 if u[k] > u[k - 1] else (-1.0 if u[k] < u[k - 1] else 0.0)
                tau = time * (1.0 + bend * share * share + turn * share * way)
                tau = max(tau, 0.02 * time)
                ratio = step / tau
                keep = np.exp(-min(ratio, 600.0))
                gain = (1.0 - keep) / ratio
                new = keep * v + (gain - keep) * u[k - 1] + (1.0 - gain) * u[k]
                middle = 0.5 * (v + new)
            v = new
            out[k] = v


@dataclass(frozen=True)
class NonlinearCapacitance(Effect):
    """The head's capacitance follows its voltage; its strength is RC₀ω₀, or the residual charge at the sensor.

    Variants: "growing", C₀(1 + b(v/100 V)²) behind a resistor, b of 1 … 3; "butterfly", C₀(1 + b v/100 V·sgn(dv/dt)),
    which depends on the direction too; "self_sensing", a bridge that is balanced for C₀ alone and passes
    C₀ b(v/100 V)² dv/dt.

    Source: D. Damjanovic, Rep. Prog. Phys. 61 (1998) 1267 (permittivity under field, butterfly loops); J. J. Dosch,
    D. J. Inman, E. Garcia, J. Intell. Mater. Syst. Struct. 3 (1992) 166 (bridge).
    """

    id = "nonlinear_capacitance"
    stage = "drive"
    start = 2e-2
    weakest = 1e-6
    strongest = 2.0

    angular_rad_per_s: float = field(default=3e5, kw_only=True)
    bend: float = field(default=2.0, kw_only=True)
    gain_s: float = field(default=5e-8, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "NonlinearCapacitance":
        """One of three."""
        variant = str(rng.choice(["growing", "butterfly", "self_sensing"]))
        return cls(
            variant=variant,
            angular_rad_per_s=situation.head.angular_rad_per_s,
            bend=float(rng.uniform(0.4, 0.9) if variant == "butterfly" else rng.uniform(1.0, 3.0)),
            gain_s=float(rng.choice([-1.0, 1.0])) * situation.largest_V / situation.steepest_V_per_s,
        )

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Charge the head through the resistor."""
        if not self.strength or self.variant == "self_sensing":
            return drive_V
        bend, turn = (self.bend, 0.0) if self.variant == "growing" else (0.0, self.bend)
        out = np.empty(drive_V.size)
        time = self.strength / self.angular_rad_per_s
        _charged(np.ascontiguousarray(drive_V), grid.half_s, time, bend, turn, 3 if grid.periodic else 1, out)
        return out

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Add the current that the bridge does not balance."""
        if not self.strength or self.variant != "self_sensing" or measurement.channel != "self_sensing":
            return signal
        current = self.bend * (applied_V[::2] / 100.0) ** 2 * slope_V_per_s(applied_V, grid)
        return signal + self.strength * self.gain_s * current

    def parameters(self) -> dict[str, Any]:
        """Time constant at 0 V and its change at 100 V, or the sensor's volts for each V/s at 100 V."""
        if self.variant == "self_sensing":
            return {"feedthrough_at_100_V_s": self.strength * self.gain_s * self.bend}
        return {"time_s": self.strength / self.angular_rad_per_s, "change_at_100_V": self.bend}
