"""Resonator stage: other modes and travelling waves."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numba import njit

from experiments.concealed_rig.effects.effect import Effect, Situation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.linear import filtered, linear_motion
from experiments.concealed_rig.resonator import Motion, Resonator


def half_steps(stepped: np.ndarray, grid: Grid) -> np.ndarray:
    """Values at the steps, shape (steps + 1,), at the half steps too, shape (2·steps + 1,), by cubics."""
    if grid.periodic:
        before, after = stepped[-2], stepped[1]
    else:
        before, after = 2 * stepped[0] - stepped[1], 2 * stepped[-1] - stepped[-2]
    wide = np.concatenate(([before], stepped, [after]))
    out = np.empty(2 * stepped.size - 1)
    out[::2] = stepped
    out[1::2] = (9 * (wide[1:-2] + wide[2:-1]) - wide[:-3] - wide[3:]) / 16
    return out


def with_parallel_mode(
    motion: Motion,
    hysteretic_V: np.ndarray,
    resonator: Resonator,
    grid: Grid,
    share: float,
    frequency_Hz: float,
    damping_ratio: float,
) -> Motion:
    """The motion and a share of a second mode's, both driven alike (modal superposition)."""
    w = 2 * np.pi * frequency_Hz
    x, v = linear_motion(w, damping_ratio, hysteretic_V, grid)
    ratio = w / resonator.angular_rad_per_s
    return Motion(motion.deflection_V + share * x, motion.speed_V + share * ratio * v)


def coupled_modes_Hz(resonance_Hz: float, mass_ratio: float, second_ratio: float) -> list[float]:
    """Undamped natural frequencies of a mass with a second mass on it, lower one first.

    Source: J. P. Den Hartog, Mechanical Vibrations (1956).
    """
    r2 = second_ratio**2
    stiffness = np.array([[1 + mass_ratio * r2, -mass_ratio * r2], [-r2, r2]])
    return (resonance_Hz * np.sqrt(np.sort(np.linalg.eigvals(stiffness).real))).tolist()


@dataclass(frozen=True)
class SecondMode(Effect):
    """Another mode; its strength is its share of the sum, or its mass over the first one's.

    Variants: "parallel", a sum of two modes; "coupled", a second mass on the first one; "cascaded", a structure that
    is shaken by the first mode, does not act back, and is seen by the sensor too.

    Source: D. J. Ewins, Modal Testing (2000) (sum); J. P. Den Hartog, Mechanical Vibrations (1956)
    (coupled pair; a light structure shaken by a heavy one).
    """

    id = "second_mode"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 1.0

    resonance_Hz: float = field(default=5e4, kw_only=True)
    frequency_Hz: float = field(default=1e5, kw_only=True)
    damping_ratio: float = field(default=0.05, kw_only=True)
    sign: float = field(default=1.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "SecondMode":
        """Below or above the first mode."""
        ratio = rng.uniform(0.35, 0.75) if rng.random() < 0.4 else rng.uniform(1.35, 2.6)
        variant = str(rng.choice(["parallel", "coupled", "cascaded"]))
        return cls(
            variant=variant,
            resonance_Hz=situation.head.resonance_Hz,
            frequency_Hz=float(ratio * situation.head.resonance_Hz),
            damping_ratio=float(rng.uniform(0.015, 0.06)),
            sign=float(rng.choice([-1.0, 1.0])) if variant != "coupled" else 1.0,
        )

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """The coupled pair."""
        if self.variant != "coupled" or not self.strength:
            return resonator
        ratio = self.frequency_Hz / self.resonance_Hz
        return replace(resonator, mass_ratio=self.strength, second_ratio=ratio, second_damping=self.damping_ratio)

    def on_motion(
        self, motion: Motion, hysteretic_V: np.ndarray, resonator: Resonator, grid: Grid, order: int
    ) -> Motion:
        """The parallel sum, or what the shaken structure adds."""
        if self.variant == "coupled" or not self.strength:
            return motion
        share = self.sign * self.strength
        if self.variant == "cascaded":
            shaken = half_steps(motion.deflection_V, grid)
            return with_parallel_mode(motion, shaken, resonator, grid, share, self.frequency_Hz, self.damping_ratio)
        return with_parallel_mode(motion, hysteretic_V, resonator, grid, share, self.frequency_Hz, self.damping_ratio)

    def parameters(self) -> dict[str, Any]:
        """Frequency, damping and share of the second mode; of the coupled pair, both modes."""
        named = {"frequency_Hz": self.frequency_Hz, "damping_ratio": self.damping_ratio}
        if self.variant == "coupled":
            modes = coupled_modes_Hz(self.resonance_Hz, self.strength, self.frequency_Hz / self.resonance_Hz)
            return {**named, "mass_ratio": self.strength, "modes_Hz": modes}
        return {**named, "share": self.sign * self.strength}


@njit(cache=True)
def _characteristics(source, delay1, delay2, r1, r2, keep, mean, laps, out):
    """Waves n towards the nozzle and m towards the refill at the actuator; what returns of both."""
    points = source.size - (1 if laps > 1 else 0)
    n, m = np.zeros(source.size), np.zeros(source.size)
    before_n, before_m = np.zeros(source.size), np.zeros(source.size)
    low_n, low_m = 0.0, 0.0
    last_n, last_m = 0.0, 0.0
    for lap in range(laps):
        change = 0.0
        largest = 0.0
        for k in range(points):
            at1, at2 = k - delay1, k - delay2
            from_n, from_m = 0.0, 0.0
            for which in range(2):
                at = at1 if which == 0 else at2
                now = n if which == 0 else m
                before = before_n if which == 0 else before_m
                base = int(np.floor(at))
                part = at - base
                value = 0.0
                for side in range(2):
                    i = base + side
                    share = part if side == 1 else 1.0 - part
                    if i >= 0:
                        value += share * now[i]
                    elif laps > 1 and i + points >= 0:
                        value += share * before[i + points]
                if which == 0:
                    from_n = value
                else:
                    from_m = value
            # First order, exact for lines between steps.
            low_n = keep * low_n + r1 * ((mean - keep) * last_n + (1.0 - mean) * from_n)
            low_m = keep * low_m + r2 * ((mean - keep) * last_m + (1.0 - mean) * from_m)
            last_n, last_m = from_n, from_m
            n[k], m[k] = source[k] + low_m, source[k] + low_n
            echo = low_n + low_m
            change = max(change, abs(echo - out[k]))
            largest = max(largest, abs(echo))
            out[k] = echo
        before_n[:], before_m[:] = n, m
        if lap > 0 and change <= 1e-8 * largest:
            break
    if laps > 1:
        out[points] = out[0]


def channel_echo(
    source: np.ndarray,
    nozzle_s: float,
    refill_s: float,
    nozzle_reflection: float,
    refill_reflection: float,
    step_s: float,
    periodic: bool,
    loss_s: float = 0.0,
) -> np.ndarray:
    """What comes back of a source in a channel, by the method of characteristics.

    Half of the source travels each way; a wave that comes back from one end passes the source and goes on to the other.

    Parameters
    ----------
    source : ndarray, shape (n,)
    nozzle_s, refill_s : float
        Times there and back, 2L/c, of the two ends.
    nozzle_reflection, refill_reflection : float
        Within −1 … 1.
    step_s : float
    periodic : bool
    loss_s : float
        Time of a first-order loss at each reflection.

    Returns
    -------
    ndarray, shape (n,)

    Notes
    -----
    Source: H. Wijshoff, Physics Reports 491 (2010) 77 (waves in the channel of a piezo inkjet head);
    E. B. Wylie, V. L. Streeter, Fluid Transients (1978) (characteristics).
    """
    if min(nozzle_s, refill_s) < step_s:
        raise ValueError(f"The waves must travel for a step, {step_s} s, at least; got {nozzle_s} and {refill_s} s.")
    out = np.zeros(source.size)
    keep = np.exp(-step_s / loss_s) if loss_s else 0.0
    mean = (1 - keep) * loss_s / step_s
    half = np.ascontiguousarray(source) / 2
    ends = (nozzle_s / step_s, refill_s / step_s, nozzle_reflection, refill_reflection)
    _characteristics(half, *ends, keep, mean, 60 if periodic else 1, out)
    return out


@dataclass(frozen=True)
class WaveEcho(Effect):
    """A travelling wave returns after a delay; its strength is the share of the signal that travels.

    Variants: "single_return"; "lossy_return", a single return through a first-order loss, of either sign; "channel",
    reflections at nozzle and refill, over and over; "lossy_channel".

    Source: see `channel_echo`.
    """

    id = "wave_echo"
    stage = "resonator"
    start = 1e-2
    weakest = 1e-7
    strongest = 1.0

    nozzle_s: float = field(default=2e-5, kw_only=True)
    refill_s: float = field(default=3e-5, kw_only=True)
    nozzle_reflection: float = field(default=-0.5, kw_only=True)
    refill_reflection: float = field(default=-0.8, kw_only=True)
    loss_s: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "WaveEcho":
        """Channels of 6 … 25 mm each side at 900 … 1300 m/s."""
        variant = str(rng.choice(["single_return", "lossy_return", "channel", "lossy_channel"]))
        speed = rng.uniform(900, 1300)
        return cls(
            variant=variant,
            nozzle_s=float(2 * rng.uniform(6e-3, 15e-3) / speed),
            refill_s=float(2 * rng.uniform(8e-3, 25e-3) / speed),
            nozzle_reflection=float(rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 0.8)),
            refill_reflection=float(-rng.uniform(0.5, 0.9)),
            loss_s=float(rng.uniform(0.5e-6, 2.5e-6)) if variant.startswith("lossy") else 0.0,
        )

    def _echo(self, signal: np.ndarray, grid: Grid) -> np.ndarray:
        if self.variant == "lossy_return":
            duller = filtered([1.0], [self.loss_s, 1.0], signal - signal[0], grid.step_s, grid.periodic) + signal[0]
            return float(np.sign(self.nozzle_reflection)) * replace(self, variant="single_return")._echo(duller, grid)
        if self.variant == "single_return":
            late = np.arange(signal.size) - self.nozzle_s / grid.step_s
            if grid.periodic:
                return np.interp(late % (signal.size - 1), np.arange(signal.size), signal)
            return np.interp(late, np.arange(signal.size), signal, left=0.0)
        ends = (self.nozzle_s, self.refill_s, self.nozzle_reflection, self.refill_reflection)
        return channel_echo(signal, *ends, grid.step_s, grid.periodic, self.loss_s)

    def on_motion(
        self, motion: Motion, hysteretic_V: np.ndarray, resonator: Resonator, grid: Grid, order: int
    ) -> Motion:
        """Add what returns."""
        if not self.strength:
            return motion
        return Motion(
            motion.deflection_V + self.strength * self._echo(motion.deflection_V, grid),
            motion.speed_V + self.strength * self._echo(motion.speed_V, grid),
        )

    def parameters(self) -> dict[str, Any]:
        """Delays and reflections."""
        if self.variant == "single_return":
            return {"delay_s": self.nozzle_s, "share": self.strength}
        if self.variant == "lossy_return":
            share = float(np.sign(self.nozzle_reflection)) * self.strength
            return {"delay_s": self.nozzle_s, "share": share, "loss_s": self.loss_s}
        return {
            "share": self.strength,
            "nozzle_delay_s": self.nozzle_s,
            "refill_delay_s": self.refill_s,
            "delay_s": self.nozzle_s + self.refill_s,
            "nozzle_reflection": self.nozzle_reflection,
            "refill_reflection": self.refill_reflection,
            "loss_s": self.loss_s,
        }
