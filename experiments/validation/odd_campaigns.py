"""Stress test of identification and diagnosis: random odd campaigns, and what becomes of each.

``python -m inkjet_env.experiments.validation.odd_campaigns --count 300``

A campaign has few samples or a single recording, a drive that never moves, a huge offset, a silent or a rounded sensor,
mixed channels and states, or a system that is no printhead: Bouc–Wen hysteresis, play, many modes, pure noise. Each
must end with a verdict or with a refusal in a plain sentence: no other exception, no warning of NumPy. The exit status
is 1 if any does not. A case is reproduced by ``--first SEED --count 1``.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.identification import evaluate, identify
from inkjet_env.mismatch import diagnose
from inkjet_env.plant import Excitation, Plant
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.storage import json_text
from inkjet_env.typing import Real

SYSTEMS = ("head", "head", "bouc_wen", "dead_play", "many_modes", "noise", "static")
"""Systems that are recorded, as often as they occur here."""
STATES = ("demagnetised", "periodic", "free")
UNITS = {"self_sensing": ("V",), "strain_gauge": ("V",), "displacement": ("um", "nm", "V")}
NUMERICAL_JARGON = frozenset(("domain", "broadcast", "singular", "array", "nan", "object", "index", "argument"))
"""Words of messages that were not written for a user; none may occur in a refusal."""


@dataclass(frozen=True)
class Outcome:
    """What became of one campaign.

    Attributes
    ----------
    seed : int
        Seed that makes the campaign.
    kind : {"none", "named", "set", "unknown", "refused", "failed"}
        The verdict, a refusal in a sentence, or a failure.
    told : str
        Headline, refusal, or the traceback of the failure.
    seconds : float
        Time it took.
    """

    seed: int
    kind: str
    told: str
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose the campaigns of the command line, tell each outcome, and return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.validation.odd_campaigns",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--count", type=int, default=300, help="number of campaigns (300)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first campaign (0)")
    parser.add_argument("--pages", action="store_true", help="make the HTML pages too")
    options = parser.parse_args(arguments)
    outcomes = []
    for seed in range(options.first, options.first + options.count):
        outcome = outcome_of(seed, options.pages)
        outcomes.append(outcome)
        print(f"{seed:4d} {outcome.kind:8s} {outcome.seconds:6.1f} s  {outcome.told}", flush=True)
    counts = Counter(outcome.kind for outcome in outcomes)
    print(", ".join(f"{kind}: {count}" for kind, count in sorted(counts.items())))
    return int(counts["failed"] > 0)


def outcome_of(seed: int, pages: bool = False) -> Outcome:
    """Identify, evaluate and diagnose the odd campaign of a seed, and write every result.

    Parameters
    ----------
    seed : int
        Seed that makes the campaign.
    pages : bool
        Whether to make the HTML pages as well.
    """
    begun = time.perf_counter()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            kind, told = _diagnosed(odd_campaign(np.random.default_rng(seed)), pages)
        except ValueError as error:
            kind, told = ("refused", str(error)) if is_sentence(str(error)) else ("failed", traceback.format_exc())
        except Exception:
            kind, told = "failed", traceback.format_exc()
    if warned and kind != "failed":
        first = warned[0]
        kind, told = "failed", f"{first.category.__name__} at {first.filename}:{first.lineno}: {first.message}"
    return Outcome(seed, kind, told, time.perf_counter() - begun)


def is_sentence(text: str) -> bool:
    """Whether the text of an error was written for a user."""
    plain = text.strip()
    jargon = NUMERICAL_JARGON & set(re.findall(r"[a-z]+", plain.lower()))
    return 20 <= len(plain) <= 700 and plain[-1] in ".?!`" and "\n" not in plain and not jargon


def _diagnosed(campaign: Campaign, pages: bool) -> tuple[str, str]:
    """Verdict and headline of a campaign; its head is identified, evaluated and read back on the way."""
    refusal = ""
    try:
        found = identify(campaign)
        printhead_of(found.as_json())
        json_text(found.as_json())
        evaluate(campaign, found.printhead, {c: gain.value for c, gain in found.gains.items()})
        if pages:
            from inkjet_env.reporting.identification_report import identification_html

            identification_html(campaign.name, found)
    except ValueError as error:
        refusal = str(error)
        if not is_sentence(refusal):
            raise
    verdict = diagnose(campaign, workers=1)
    json_text(verdict.as_json())
    printhead_of(verdict.augmented_json())
    if pages:
        from inkjet_env.reporting.diagnosis_report import diagnosis_html

        diagnosis_html(verdict)
    return verdict.verdict, verdict.headline


def odd_campaign(rng: np.random.Generator) -> Campaign:
    """A random odd campaign.

    Parameters
    ----------
    rng : Generator
        Source of everything in it.
    """
    system = str(rng.choice(SYSTEMS))
    few = rng.random() < 0.4
    count = int(rng.choice([1, 1, 2, 3, 5]))
    frequency_Hz = float(10 ** rng.uniform(1.5, 5.5))
    head = Printhead.published().varied(frequency_Hz, float(10 ** rng.uniform(-2.5, -0.1)))
    channels = list(rng.choice(list(UNITS), size=int(rng.integers(1, 3)), replace=False))
    units = {channel: str(rng.choice(UNITS[channel])) for channel in UNITS}
    slow = float(rng.choice([1.0, 1.0, 1.0, 1e3, 1e5]))  # how much slower than the resonance it is recorded
    same = rng.random() < 0.3
    recordings: list[Recording] = []
    drive_V: Real = np.zeros(2)
    for order in range(1, count + 1):
        channel = str(rng.choice(channels))
        n = int(rng.integers(2, 40)) if few else int(rng.integers(60, 500))
        if not (same and recordings):
            drive_V = _drive(rng, n)
        step_s = slow / (frequency_Hz * float(rng.choice([3.0, 20.0, 100.0])))
        state = str(rng.choice(STATES))
        signal = _signal(system, head, channel, state, step_s, drive_V, rng)
        signal = _spoilt(signal, rng)
        recordings.append(
            Recording(
                f"r{order}",
                np.float64(step_s) * (np.arange(drive_V.size, dtype=np.float64) + float(rng.choice([0.0, -1.0, 1e3]))),
                drive_V,
                signal,
                units[channel],
                channel,
                initial_state=state,
                order=int(rng.integers(1, 4)) if rng.random() < 0.3 else order,
                repeat_of="r1" if same and order > 1 and rng.random() < 0.5 else None,
                drive_monitor_V=drive_V + rng.normal(0, 0.1, drive_V.size) if rng.random() < 0.15 else None,
                neighbour_V=_drive(rng, drive_V.size) if rng.random() < 0.15 else None,
            )
        )
    if rng.random() < 0.03:  # a repeated name
        recordings.append(recordings[0])
    return Campaign(f"odd {system}", tuple(recordings))


def _drive(rng: np.random.Generator, n: int) -> Real:
    """A drive of n samples, in volts."""
    size_V = float(rng.choice([1e-4, 1.0, 40.0, 90.0, 90.0, 900.0]))
    t = np.arange(n) / n
    kind = rng.integers(7)
    if kind == 0:
        return np.full(n, float(rng.choice([0.0, size_V])))
    if kind == 1:
        return size_V * np.sin(2 * np.pi * float(rng.integers(1, 6)) * t)
    if kind == 2:
        return size_V * np.interp(t, np.sort(rng.random(6)), [0, 1, 1, -1, -1, 0])
    if kind == 3:
        return size_V * rng.standard_normal(n)
    if kind == 4:
        return np.where(t < 0.1, 0.0, size_V)
    if kind == 5:
        lines = np.arange(1, max(n // 8, 2), 2)
        waves = np.cos(2 * np.pi * (lines[:, None] * t + rng.random((lines.size, 1))))
        return size_V * waves.sum(axis=0) / np.sqrt(lines.size)
    return size_V * t + float(rng.choice([0.0, 1e3]))


def _signal(
    system: str, head: Printhead, channel: str, state: str, step_s: float, drive_V: Real, rng: np.random.Generator
) -> Real:
    """Signal of a system under a drive, without noise, shape (n,)."""
    if system == "noise":
        return np.zeros(drive_V.size)
    if system == "static":
        return np.tanh(drive_V / 50) + 0.1 * np.sign(np.gradient(drive_V))
    if system == "dead_play":
        return _dead_play(drive_V, 0.2 * float(np.ptp(drive_V)))
    if system == "bouc_wen":
        return _bouc_wen(head, step_s, drive_V, channel)
    plant = Plant(head, {"strain_gauge": 0.02, "displacement": 0.01})
    excitation = Excitation(channel, state, step_s, drive_V)
    signal = plant.signal(excitation)
    if system == "many_modes":
        for ratio in (1.7, 2.3, 3.1, 4.4):
            other = head.varied(min(ratio * head.frequency_Hz, 1e8), 0.02)
            signal = signal + rng.uniform(-1, 1) * Plant(other, plant.gains).signal(excitation)
    return signal


def _dead_play(drive_V: Real, gap_V: float) -> Real:
    """Output of a play with this gap."""
    out, result = 0.0, np.empty(drive_V.size)
    for k, u in enumerate(drive_V):
        out = min(max(out, float(u) - gap_V), float(u) + gap_V)
        result[k] = out
    return result


def _bouc_wen(head: Printhead, step_s: float, drive_V: Real, channel: str) -> Real:
    """A Bouc–Wen oscillator, by Runge and Kutta's fourth-order method; its speed for self-sensing."""
    omega, zeta = 2 * np.pi * head.frequency_Hz, 0.02
    fine = 8
    h = omega * step_s / fine
    if h > 0.5:  # quasi-static: no time step of the resonator is worth taking
        return _dead_play(drive_V, 0.2 * float(np.ptp(drive_V)))
    scale = float(np.abs(drive_V).max()) or 1.0

    def slopes(state: Real, u: float) -> Real:
        x, p, z = state
        return np.array([p, u - 2 * zeta * p - 0.5 * x - 0.5 * z, p - 2.0 * abs(p) * z - 1.0 * p * abs(z)])

    state, result = np.zeros(3), np.empty(drive_V.size)
    for k in range(drive_V.size):
        result[k] = state[1] if channel == "self_sensing" else state[0]
        after = drive_V[min(k + 1, drive_V.size - 1)]
        for j in range(fine):
            u = (drive_V[k] + (after - drive_V[k]) * j / fine) / scale
            k1 = slopes(state, u)
            k2 = slopes(state + h / 2 * k1, u)
            k3 = slopes(state + h / 2 * k2, u)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + slopes(state + h * k3, u))
    return result


def _spoilt(signal: Real, rng: np.random.Generator) -> Real:
    """The signal with noise and, at times, an offset, a converter's steps, clipping, or nothing but one value."""
    size = float(np.abs(signal).max()) or 1.0
    kind = rng.integers(8)
    noise = size * float(rng.choice([0.0, 1e-6, 1e-3, 0.1])) * rng.standard_normal(signal.size)
    signal = signal + noise
    if kind == 0:
        return signal + 1e9 * size
    if kind == 1:
        return np.round(signal / (0.05 * size)) * 0.05 * size
    if kind == 2:
        return np.clip(signal, -0.5 * size, 0.5 * size)
    if kind == 3 and rng.random() < 0.5:
        return np.full(signal.size, 1.65)
    return signal * float(rng.choice([1.0, 1.0, 1e-9, 1e9])) if kind == 4 else signal


if __name__ == "__main__":
    sys.exit(main())
