"""Whether a resonance is found where there is one and refused where there is none.

``python -m inkjet_env.experiments.validation.resonance_study --count 60``

Systems without a resonance: a static law, creep, one pole, a clipped sensor, and one sine that nobody could identify a
resonance from, whatever answered it. Systems with one, of damping ratios of 0.005 to 0.3: a resonator, one that creeps
too, and one whose sensor clips. Hysteresis is a sum of random
plays; the linear part is exact on a finer grid, in the frequency domain for repeated drives. Nothing here uses the
project's simulator.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from inkjet_env.identification import UnidentifiableError, identify
from inkjet_env.progress import shown_progress
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.typing import Real

WITHOUT = ("static", "creep", "one_pole", "clipped", "one_sine")
"""Systems without a resonance, or drives that cannot show one."""
WITH = ("resonator", "creeping_resonator", "clipped_resonator")
"""Systems with a resonance."""
FINER = 8
"""Samples of the simulation for each sample of a recording."""
SAMPLES = 600


@dataclass(frozen=True)
class System:
    """A system to be recorded.

    Attributes
    ----------
    kind : str
        One of `WITHOUT` or `WITH`.
    frequency_Hz : float
        Its characteristic frequency.
    damping_ratio : float
        Damping ratio of a resonator.
    plays : ndarray, shape (k, 2)
        Thresholds in volts and weights of the hysteresis.
    curvature : float
        Relative change of the slope of a static law over the drive's range.
    limit : float
        Share of the largest signal at which the sensor clips.
    """

    kind: str
    frequency_Hz: float
    damping_ratio: float
    plays: Real
    curvature: float
    limit: float


def drawn_system(kind: str, rng: np.random.Generator) -> System:
    """A random system of a kind."""
    thresholds = np.sort(rng.uniform(0, 20, 8))
    weights = rng.uniform(0, 0.08, 8)
    return System(
        kind,
        math.exp(rng.uniform(math.log(2e3), math.log(80e3))),
        math.exp(rng.uniform(math.log(0.005), math.log(0.3))),
        np.column_stack([thresholds, weights]),
        rng.uniform(-0.3, 0.3),
        rng.uniform(0.4, 0.8),
    )


def drives(kind: str, step_s: float, frequency_Hz: float, rng: np.random.Generator) -> list[tuple[Real, str]]:
    """Drives in volts on the fine grid with their initial states, about a characteristic frequency."""
    n = SAMPLES * FINER
    time_s = np.arange(n) * step_s / FINER
    length_s = SAMPLES * step_s
    made: list[tuple[Real, str]] = []
    if kind == "one_sine":
        cycles = int(rng.integers(2, 12))
        state = "periodic" if rng.random() < 0.7 else "free"
        return [
            (level * np.sin(2 * np.pi * cycles * time_s / length_s), state)
            for level in (10.0, 20.0, 20.0, 30.0, 40.0)
        ]  # fmt: skip
    pulse_state = str(rng.choice(["demagnetised", "free"]))
    for level in rng.uniform(10, 40, 4):
        width_s = rng.uniform(0.3, 2) / frequency_Hz
        edge_s = rng.uniform(0.05, 0.3) / frequency_Hz
        start_s = 0.15 * length_s
        corners = start_s + np.cumsum([0.0, edge_s, width_s, edge_s])
        made.append((level * np.interp(time_s, corners, [0.0, 1.0, 1.0, 0.0]), pulse_state))
    made.append(made[0])
    for level in (15.0, 25.0):
        lines = np.arange(1, max(int(3 * frequency_Hz * length_s), 12))
        phases = rng.uniform(0, 2 * np.pi, lines.size)
        wave = np.cos(2 * np.pi * np.outer(time_s / length_s, lines) + phases).sum(axis=1)
        made.append((level * wave / np.abs(wave).max(), "periodic"))
    cycles = max(round(0.3 * frequency_Hz * length_s), 1)
    made.append((30 * np.sin(2 * np.pi * cycles * time_s / length_s), "periodic"))
    return made


def hysteretic(system: System, drive_V: Real, periodic: bool) -> Real:
    """Drive after hysteresis and curvature, shape (n,), from the demagnetised state or after repeats."""
    periods = 3 if periodic else 1
    u = np.tile(drive_V, periods)
    out = u.copy()
    for threshold_V, weight in system.plays:
        play = np.empty_like(u)
        x = 0.0
        for k, value in enumerate(u.tolist()):
            x = min(max(x, value - threshold_V), value + threshold_V)
            play[k] = x
        out += weight * play
    out = out[-drive_V.size :]
    return out * (1 + system.curvature * out / 80)


def answered(system: System, drive_V: Real, step_s: float, velocity: bool, state: str) -> Real:
    """Signal on the fine grid, shape (n,)."""
    periodic = state == "periodic"
    v = hysteretic(system, drive_V, periodic)
    omega = 2 * np.pi * system.frequency_Hz
    numerator, denominator = [1.0], [1.0]
    if system.kind.startswith("creep"):
        for slowness in (1.0, 4.0, 16.0):  # three Kelvin-Voigt elements beside the elastic part
            tau_s = slowness / omega
            numerator = np.polyadd(np.polymul(numerator, [tau_s, 1.0]), np.multiply(0.08, denominator)).tolist()
            denominator = np.polymul(denominator, [tau_s, 1.0]).tolist()
    elif system.kind == "one_pole":
        denominator = [1 / omega, 1.0]
    if system.kind in WITH:
        denominator = np.polymul(denominator, [omega**-2, 2 * system.damping_ratio / omega, 1.0]).tolist()
    y = v if denominator == [1.0] else _filtered(numerator, denominator, v, step_s, periodic)
    return np.gradient(y, step_s * omega) if velocity else y


def _filtered(numerator: Sequence[float], denominator: Sequence[float], v: Real, step_s: float, periodic: bool) -> Real:
    if periodic:
        s = 2j * np.pi * np.fft.rfftfreq(v.size, step_s)
        return np.fft.irfft(np.fft.rfft(v) * np.polyval(numerator, s) / np.polyval(denominator, s), v.size)
    b, a, _ = signal.cont2discrete((list(numerator), list(denominator)), step_s, method="foh")
    rest = signal.lfilter_zi(b[0], a) * v[0]
    return np.asarray(signal.lfilter(b[0], a, v, zi=rest)[0])


def recorded(system: System, rng: np.random.Generator) -> Campaign:
    """A campaign of the system: pulses, multisines and a sine, of one channel, with noise of a random kind."""
    step_s = 1 / (system.frequency_Hz * rng.uniform(12, 30))
    channel = str(rng.choice(["self_sensing", "displacement"]))
    velocity = channel == "self_sensing" and (system.kind in WITH or rng.random() < 0.7)
    snr_dB = rng.uniform(35, 60)
    colour, bits = rng.choice([0.0, 0.6]), rng.choice([0, 12])
    made = drives(system.kind, step_s, system.frequency_Hz, rng)
    if system.kind == "one_sine":  # anything may answer: the drive cannot tell
        steady = made[0][1] == "periodic"  # a start from rest does show a resonance
        system = drawn_system(str(rng.choice(["static", "creep", "one_pole", *(["resonator"] * steady)])), rng)
    clean = [answered(system, drive, step_s / FINER, velocity, state)[::FINER] for drive, state in made]
    largest = max(float(np.abs(y).max()) for y in clean)
    if system.kind.startswith("clipped"):
        clean = [np.clip(y, -system.limit * largest, system.limit * largest) for y in clean]
    gain = math.exp(rng.uniform(-3, 1)) / largest
    rms = 10 ** (-snr_dB / 20) * max(float(np.std(y)) for y in clean)
    recordings = []
    for k, (y, (drive, state)) in enumerate(zip(clean, made, strict=True)):
        white = rng.normal(0, rms, y.size)
        noise = np.asarray(signal.lfilter([math.sqrt(1 - colour**2)], [1, -colour], white))
        sensor = gain * (y + noise)
        if bits:
            level = 2 * gain * largest / 2**bits
            sensor = np.round(sensor / level) * level
        recordings.append(
            Recording(
                name=f"r{k}",
                channel=channel,
                time_s=np.arange(y.size, dtype=np.float64) * step_s,
                drive_V=drive[::FINER].copy(),
                sensor=sensor,
                unit="um" if channel == "displacement" else "V",
                initial_state=state,
                order=k + 1,
            )
        )
    return Campaign("study", tuple(recordings))


def outcome(kind: str, seed: int) -> tuple[bool, str]:
    """Whether the resonance of a campaign is told rightly, and what was told."""
    rng = np.random.default_rng([seed, *kind.encode()])
    system = drawn_system(kind, rng)
    campaign = recorded(system, rng)
    try:
        found = identify(campaign)
    except UnidentifiableError as error:
        return kind in WITHOUT, str(error)
    if not found.printhead.has_dynamics:
        return kind in WITHOUT, "hysteresis alone"
    off = abs(found.printhead.frequency_Hz / system.frequency_Hz - 1)
    told = (
        f"{found.printhead.frequency_Hz:.4g} Hz, damping ratio {found.printhead.damping_ratio:.3g} "
        f"(true {system.frequency_Hz:.4g} Hz, {system.damping_ratio:.3g})"
    )
    return kind in WITH and off < max(0.05, system.damping_ratio / 2), told


def study(first: int, count: int, told: Callable[[str], None]) -> dict[str, Counter[bool]]:
    """Right and wrong outcomes for each kind of system: ``count`` without a resonance and as many with one."""
    seeds = range(first, first + count)
    cases = [(half[k % len(half)], k) for half in (WITHOUT, WITH) for k in seeds]
    counts: dict[str, Counter[bool]] = defaultdict(Counter)
    with shown_progress("systems", len(cases)) as progress:
        for done, (kind, seed) in enumerate(cases, start=1):
            right, said = outcome(kind, seed)
            counts[kind][right] += 1
            if not right:
                told(f"{kind} {seed}: {said}")
            progress(done)
    return counts


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; the exit status is 1 if any outcome is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60, help="systems of each half")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    given = parser.parse_args(arguments)
    counts = study(given.first, given.count, print)
    for kind, results in counts.items():
        print(f"{kind}: {results[True]} of {results.total()} right")
    return int(any(results[False] for results in counts.values()))


if __name__ == "__main__":
    sys.exit(main())
