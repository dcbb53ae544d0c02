"""The measuring plan: which drives a campaign holds, in which order."""

from dataclasses import replace

import numpy as np

from experiments.concealed_rig.head import Head
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.shapes import (
    bipolar_V,
    fast,
    minor_loops_V,
    multisine_V,
    staircase_V,
    times_s,
    trapezoid_V,
    triangle_V,
)

SAMPLES = 2000


def fast_step_s(head: Head, rng: np.random.Generator) -> float:
    """Sampling interval with 42 … 56 samples in a period of the resonance, a multiple of 5 ns."""
    return round(1 / head.resonance_Hz / rng.uniform(42, 56) / 5e-9) * 5e-9


def _jitter(rng: np.random.Generator) -> float:
    return 1 + 0.01 * rng.uniform(-1, 1)


def _trapezoids(step: float, rng: np.random.Generator) -> list[Measurement]:
    t = times_s(SAMPLES, step)
    rows = []
    for top, edge in ((100, 1.5), (80, 3), (60, 12), (40, 2), (20, 4), (-40, 2.5), (-100, 8)):
        rise, dwell, fall = (x * 1e-6 * _jitter(rng) for x in (edge, rng.uniform(8, 25), edge * rng.uniform(0.7, 1.4)))
        drive = trapezoid_V(t, 20 * step, top * _jitter(rng), rise, dwell, fall)
        rows.append(fast("trapezoid", "periodic", step, drive))
    return rows


def _bipolars(step: float, rng: np.random.Generator) -> list[Measurement]:
    t = times_s(SAMPLES, step)
    rows = []
    for first, second, dwell in ((90, -60, 9), (60, -90, 14), (45, -30, 6)):
        times = np.array([2.5, dwell, 5, dwell * rng.uniform(0.8, 1.3), 4]) * 1e-6 * [_jitter(rng) for _ in range(5)]
        waveform = np.array([first * _jitter(rng), second * _jitter(rng), *times])
        rows.append(fast("bipolar", "periodic", step, bipolar_V(t, 20 * step, waveform)))
    return rows


def _pairs(step: float, period: float, rng: np.random.Generator) -> list[Measurement]:
    t = times_s(SAMPLES, step)
    rows = []
    for gap in (0.5, 1.5, 3.25):
        top, edge, dwell = 60 * _jitter(rng), 1.5e-6 * _jitter(rng), 0.2 * period
        one = trapezoid_V(t, 20 * step, top, edge, dwell, edge)
        # The second pulse follows the first after `gap` periods of the resonance, corner for corner.
        two = trapezoid_V(t, 20 * step + max(gap * period, dwell + 2.2 * edge), top, edge, dwell, edge)
        rows.append(fast("pulse_pair", "periodic", step, one + two))
    return rows


def _many_pulses(step: float, rng: np.random.Generator) -> Measurement:
    t = times_s(SAMPLES, step)
    firings = int(rng.integers(9, 13))
    apart, edge, dwell = SAMPLES * step / firings, 2e-6 * _jitter(rng), 8e-6 * _jitter(rng)
    drive = sum(trapezoid_V(t, 20 * step + k * apart, 70.0, edge, dwell, edge) for k in range(firings))
    return fast("trapezoid", "periodic", step, np.asarray(drive))


def _multisines(step: float, resonance_Hz: float, rng: np.random.Generator) -> list[Measurement]:
    t = times_s(SAMPLES, step)
    spacing = 1 / (SAMPLES * step)
    odd = np.arange(1, int(2.2 * resonance_Hz / spacing), 2)
    lines = np.sort(rng.choice(odd, size=min(24, odd.size), replace=False))
    return [
        fast("multisine", "periodic", step, multisine_V(t, lines, amplitude * _jitter(rng), rng))
        for amplitude in (12, 45)
    ]


def _from_rest(step: float, rng: np.random.Generator) -> list[Measurement]:
    t = times_s(SAMPLES, step)
    waveform = np.array([75 * _jitter(rng), -75 * _jitter(rng), 3e-6, 10e-6, 5e-6, 12e-6, 4e-6])
    return [
        fast("trapezoid", "demagnetised", step, trapezoid_V(t, 20 * step, 70 * _jitter(rng), 2e-6, 15e-6, 3e-6)),
        fast("bipolar", "demagnetised", step, bipolar_V(t, 20 * step, waveform)),
    ]


def _gauge(excitation: str, initial_state: str, step: float, drive: np.ndarray) -> Measurement:
    return Measurement("strain_gauge", excitation, initial_state, step, np.round(drive, 4))


def _gauge_loops(rng: np.random.Generator) -> list[Measurement]:
    rows = []
    for amplitude, frequency, periods in ((90, 1.0, 2), (60, 0.5, 1), (30, 2.0, 2), (100, 5.0, 4)):
        step = periods / frequency / SAMPLES
        t, top = times_s(SAMPLES, step), amplitude * _jitter(rng)
        if frequency == 5.0:
            rows.append(_gauge("sine", "periodic", step, top * np.sin(2 * np.pi * frequency * t)))
        else:
            rows.append(_gauge("arbitrary", "periodic", step, triangle_V(t, frequency, -top, top)))
    step = 1e-3
    t = times_s(SAMPLES, step)
    turning = [90, -60, 60, -30, 45, -90, 20, -45, 70, 0, 50, -20]
    rows.append(_gauge("minor_loops", "periodic", step, minor_loops_V(t, [x * _jitter(rng) for x in turning])))
    one_sided = [100, 20, 80, 30, 100]
    rows.append(_gauge("minor_loops", "demagnetised", step, minor_loops_V(t, [x * _jitter(rng) for x in one_sided])))
    return rows


def _gauge_steps(rng: np.random.Generator) -> list[Measurement]:
    step = 0.01
    t = times_s(SAMPLES, step)
    levels = [x * _jitter(rng) for x in (40, 80, 40, -40, -80, 0)]
    return [
        _gauge("step", "demagnetised", step, staircase_V(t, levels, 0.1)),
        _gauge("zero", "demagnetised", 1e-3, np.zeros(SAMPLES)),
    ]


def _neighbour(row: Measurement, rng: np.random.Generator) -> Measurement:
    t = times_s(SAMPLES, row.step_s)
    start = rng.uniform(0.1, 0.5) * SAMPLES * row.step_s
    top = float(rng.choice([-80.0, 60.0, 90.0])) * _jitter(rng)
    drive = trapezoid_V(t, start, top, 2e-6 * _jitter(rng), rng.uniform(8, 20) * 1e-6, 3e-6 * _jitter(rng))
    return replace(row, neighbour_V=np.round(drive, 4))


def _written_down(rng: np.random.Generator) -> dict[str, float]:
    return {
        "temperature_C": round(25 + 0.1 * float(rng.normal()), 1),
        "back_pressure_kPa": round(1.3 + 0.01 * float(rng.normal()), 2),
    }


def measuring_plan(
    head: Head, rng: np.random.Generator, *, meagre: bool = False, neighbour: bool = False, displacement: bool = False
) -> list[Measurement]:
    """Draw a campaign's measurements in the order in which they are taken.

    Parameters
    ----------
    head : Head
    rng : numpy.random.Generator
    meagre : bool
        Eight recordings of self-sensing instead of 24 … 29 on both channels.
    neighbour : bool
        Some recordings carry the neighbour's drive.
    displacement : bool
        Three more recordings by a vibrometer.

    Returns
    -------
    list of Measurement
        `order` is 1, 2, 3 …; a repeat comes after what it repeats.
    """
    step, period = fast_step_s(head, rng), 1 / head.resonance_Hz
    trapezoids, bipolars, pairs = _trapezoids(step, rng), _bipolars(step, rng), _pairs(step, period, rng)
    many, multisines, rest = _many_pulses(step, rng), _multisines(step, head.resonance_Hz, rng), _from_rest(step, rng)
    silence = fast("zero", "periodic", step, np.zeros(SAMPLES))
    if meagre:
        plan = [trapezoids[0], trapezoids[3], trapezoids[6], bipolars[0], pairs[1], multisines[1], silence, rest[0]]
        repeats: list[int] = []
    else:
        optional = [trapezoids[1], bipolars[2], pairs[0], rest[1], many]
        kept = [row for row in optional[:-1] if rng.random() < 0.6]
        trapezoids.pop(1)
        plan = [*trapezoids, *bipolars[:2], *pairs[1:], many, *multisines, silence, rest[0], *kept]
        plan += [*_gauge_loops(rng), *_gauge_steps(rng)]
        repeats = [0, len(plan) - 8]
    if displacement:
        plan += [replace(row, channel="displacement") for row in (trapezoids[0], bipolars[0], multisines[0])]
    if neighbour:
        quick = [k for k, row in enumerate(plan) if row.channel == "self_sensing" and k not in repeats]
        for k in rng.choice(quick, size=max(2, len(quick) // 3), replace=False):
            plan[k] = _neighbour(plan[k], rng)
    taken: list[tuple[float, int, int | None, Measurement]] = [
        (float(place), k, None, plan[k]) for k, place in enumerate(rng.permutation(len(plan)))
    ]
    for k in repeats:
        earlier = taken[k][0]
        taken.append((float(rng.uniform(earlier + 0.1, len(plan) + 0.5)), k, k, plan[k]))
    taken.sort(key=lambda row: row[0])
    order = {row[1]: number for number, row in enumerate(taken, 1) if row[2] is None}
    return [
        replace(
            row,
            order=number,
            repeat_of=None if original is None else order[original],
            condition=_written_down(rng),
        )
        for number, (_, _, original, row) in enumerate(taken, 1)
    ]
