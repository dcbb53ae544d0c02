"""Peaks of the closed form compared with an 80-digit reference that shares no formula with it.

``python -m inkjet_env.experiments.validation.closed_form_accuracy`` draws waveforms (ordinary, with durations from 0.1
ns to 1 ms, and degenerate ones), finds every extremum of the response in a second way, and prints the largest
differences.

The reference writes dv/du of the bipolar trapezoid edge by edge, solves each piece as a particular polynomial plus
ring-down in mpmath, scans y' on a grid of thousands of points per edge (in 80-bit floats) and refines each change of
sign with 80 digits.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import mpmath
import numpy as np
from numpy.typing import NDArray

from inkjet_env.printhead import Bounds, Printhead, Waveform
from inkjet_env.typing import Real

DIGITS = 80
SCAN_POINTS = 1500
WINDOW_S = 350e-6


def draw_waveforms(rng: np.random.Generator, count: int) -> Real:
    """Waveforms, shape (count, 7): 60 % ordinary, 20 % with log-uniform durations 0.1 ns…1 ms, 20 % degenerate."""
    waveforms = Bounds().from_unit(rng.uniform(-1, 1, (count, 7)))
    extreme = np.arange(count) % 5 == 3
    waveforms[extreme, 2:] = 10.0 ** rng.uniform(-10, -3, (extreme.sum(), 5))
    special = ((100.0, -100.0), (90.0, -90.0), (100.0, 0.0), (0.0, -100.0), (30.0, -60.0), (0.0, 0.0))
    for i in range(4, count, 5):
        if i % 10 == 4:
            waveforms[i, :2] = special[rng.integers(len(special))]
        waveforms[i, rng.integers(0, 7, rng.integers(0, 5))] = 0.0
    return waveforms


def _edges(waveform: Waveform, initial_state: str, full_scale: float) -> list[tuple]:
    """(start, duration, u at the start, u at the end, origin, factor) of each segment with one smooth slope law.

    The slope is ``Q'(factor |u - origin| / full_scale)``, with its argument limited to 1.
    """
    mp = mpmath.mpf
    U1, U2, *durations = (mp(v) for v in waveform.to_array())
    t1, t2, t3, t4, t5 = durations
    if initial_state == "periodic":
        laws = [(0, t1, mp(0), U1, U2, 1), (t1 + t2, t3, U1, U2, U1, 1), (t1 + t2 + t3 + t4, t5, U2, mp(0), U2, 1)]
    else:
        laws = [(0, t1, mp(0), U1, mp(0), 2)]
        meet = max(U2, -U1)  # the drive returns to the virgin curve at -U1
        share = (U1 - meet) / (U1 - U2) if U1 != U2 else mp(1)
        laws.append((t1 + t2, t3 * share, U1, meet, U1, 1))
        laws.append((t1 + t2 + t3 * share, t3 * (1 - share), meet, U2, mp(0), 2))
        laws.append((t1 + t2 + t3 + t4, t5, U2, mp(0), U2, 1))
    stretches = []
    for start, duration, u0, u1, origin, factor in laws:
        if u0 == u1:
            continue
        x0, x1 = (factor * abs(u - origin) / full_scale for u in (u0, u1))
        if x0 < 1 < x1:
            share = (1 - x0) / (x1 - x0)
            middle = u0 + (u1 - u0) * share
            stretches.append((start, duration * share, u0, middle, origin, factor))
            stretches.append((start + duration * share, duration * (1 - share), middle, u1, origin, factor))
        else:
            stretches.append((start, duration, u0, u1, origin, factor))
    return stretches


@dataclass
class _Stretch:
    """The response on one segment: ``Σ p_k (t/T)^k + e^{-σt}(c cos ωt + s sin ωt)``."""

    start: mpmath.mpf
    duration: mpmath.mpf
    poly: list
    c: mpmath.mpf
    s: mpmath.mpf
    sigma: mpmath.mpf
    omega: mpmath.mpf

    def value_and_slope(self, t: mpmath.mpf) -> tuple[mpmath.mpf, mpmath.mpf]:
        tau = t / self.duration if self.duration else mpmath.mpf(0)
        value, slope = mpmath.mpf(0), mpmath.mpf(0)
        for p in reversed(self.poly):
            slope = slope * tau + value
            value = value * tau + p
        decay = mpmath.exp(-self.sigma * t)
        cos, sin = decay * mpmath.cos(self.omega * t), decay * mpmath.sin(self.omega * t)
        slope = slope / self.duration if self.duration else slope
        value += self.c * cos + self.s * sin
        slope += (self.omega * self.s - self.sigma * self.c) * cos - (self.omega * self.c + self.sigma * self.s) * sin
        return value, slope

    def scan_slope(self, count: int) -> tuple[NDArray, NDArray]:
        """Slope at ``count`` interior times in 80-bit floats; at 200 times with all digits where the terms cancel."""
        wide = np.longdouble
        if self.omega * self.duration < 1:
            exact = [self.duration * i / 201 for i in range(1, 201)]
            return np.array(exact, dtype=object), np.array([self.value_and_slope(x)[1] for x in exact], dtype=object)
        t: NDArray = wide(str(self.duration)) * np.linspace(wide(0), wide(1), count + 2)[1:-1]
        tau = t / wide(str(self.duration))
        slope = np.zeros_like(t)
        for k in range(len(self.poly) - 1, 0, -1):
            slope = slope * tau + wide(str(k * self.poly[k] / self.duration))
        a = wide(str(self.omega * self.s - self.sigma * self.c))
        b = wide(str(self.omega * self.c + self.sigma * self.s))
        decay = np.exp(-wide(str(self.sigma)) * t)
        phase = wide(str(self.omega)) * t
        return t, slope + decay * (a * np.cos(phase) - b * np.sin(phase))


def reference_extrema(head: Printhead, waveform: Waveform, initial_state: str, window_s: float) -> tuple[list, list]:
    """Times in seconds and values in volts of every extremum up to the window's end, as mpmath numbers."""
    mp = mpmath.mpf
    a0, a1, b1, full_scale = mp(head.a0), mp(head.a1), mp(head.b1), mp(head.full_scale_V)
    sigma, omega = a1 / 2, mpmath.sqrt(a0 - a1 * a1 / 4)
    Q = [mp(c) for c in reversed(head.coefficients)]
    slope_law = [k * q for k, q in enumerate(Q)][1:]
    stretches = _edges(waveform, initial_state, full_scale)
    end = sum((mp(v) for v in waveform.to_array()[2:]), mp(0))
    time, y, yd = mp(0), mp(0), mp(0)
    times: list = []
    values: list = []
    before = mp(0)  # the slope before a jump

    def advance(duration: mpmath.mpf, poly: list, forced: bool) -> None:
        """Solve one segment, collect its extrema, and advance the state to its end."""
        nonlocal time, y, yd, before
        c = y - poly[0]
        first = poly[1] / duration if forced and len(poly) > 1 else mp(0)
        s = (yd - first + sigma * c) / omega
        stretch = _Stretch(time, duration, poly, c, s, sigma, omega)
        if forced:
            scanned, scanned_slopes = stretch.scan_slope(SCAN_POINTS + int(200 * duration * omega))
            t = [mp(0), *(mp(str(x)) for x in scanned), duration]
            slopes = [yd, *scanned_slopes, stretch.value_and_slope(duration)[1]]
            signs = np.array([int(x > 0) - int(x < 0) for x in slopes])
            for i in np.flatnonzero(signs[1:] * signs[:-1] < 0):
                root = mpmath.findroot(
                    lambda x: stretch.value_and_slope(x)[1],
                    tuple(t[i : i + 2]),
                    "ridder",
                    maxsteps=80,
                    tol=1e-60,
                    verify=False,
                )
                times.append(time + root)
                values.append(stretch.value_and_slope(root)[0])
        elif c or s:
            # y' ∝ sin(ωt + φ) of a pure ring-down
            phase = mpmath.atan2(omega * s - sigma * c, -(omega * c + sigma * s))
            k = mpmath.floor(phase / mpmath.pi) + 1
            while True:
                t = (k * mpmath.pi - phase) / omega
                if t > duration or time + t > window_s:
                    break
                if t > 0:
                    times.append(time + t)
                    values.append(stretch.value_and_slope(t)[0])
                k += 1
        y, yd = stretch.value_and_slope(duration)
        time += duration

    for start, duration, u0, u1, origin, factor in stretches:
        if start > time:
            if before * yd < 0:
                times.append(time)
                values.append(y)
            before = mp(0)
            advance(start - time, [mp(0)], False)
        jump = b1 * full_scale / factor
        x0, x1 = (factor * abs(u - origin) / full_scale for u in (u0, u1))
        sign = 1 if u1 > u0 else -1
        if duration == 0:
            before = before or yd
            xs = [min(x, mp(1)) for x in (x0, x1)]
            end_slope = sum(slope_law)
            q = [
                mpmath.polyval(Q[::-1], inside) + end_slope * (x - inside)
                for x, inside in zip((x0, x1), xs, strict=True)
            ]
            yd += sign * jump * (q[1] - q[0])
            continue
        dx = x1 - x0
        if x0 > 1 - mp(10) ** (-DIGITS // 2):  # the segments were split at x = 1
            rate = [sum(slope_law) * dx]
        else:
            rate = [
                sum(slope_law[k] * mpmath.binomial(k, j) * x0 ** (k - j) for k in range(j, len(slope_law)))
                * dx ** (j + 1)
                for j in range(len(slope_law))
            ]
        if before * yd < 0:
            times.append(time)
            values.append(y)
        before = mp(0)
        poly = [mp(0)] * (len(rate) + 2)
        for k in range(len(rate) - 1, -1, -1):
            f = sign * jump * rate[k] / duration
            poly[k] = (f - a1 * (k + 1) * poly[k + 1] / duration - (k + 1) * (k + 2) * poly[k + 2] / duration**2) / a0
        advance(duration, poly[: len(rate)], True)
    if end > time:
        if before * yd < 0:
            times.append(time)
            values.append(y)
        before = mp(0)
        advance(end - time, [mp(0)], False)
    if before * yd < 0:
        times.append(time)
        values.append(y)
    if time < window_s:
        advance(mp(window_s) - time, [mp(0)], False)
    kept = [(t, v) for t, v in zip(times, values, strict=True) if t <= window_s]
    return [t for t, _ in kept], [v for _, v in kept]


@dataclass(frozen=True)
class Accuracy:
    """Result of `compare`: counts of waveforms, of peaks, of waveforms with other peak counts; largest differences."""

    waveforms: int
    peaks: int
    different_count: int
    worst_peak: float
    worst_time: float


def compare(count: int, seed: int, initial_state: str = "periodic", compiled: bool = True) -> Accuracy:
    """Largest relative differences in peaks and in their times between the closed form and the reference.

    ``compiled`` selects the compiled batch path instead of the plain one.
    """
    from inkjet_env.printhead import batch

    head = Printhead.published()
    worst_peak = worst_time = 0.0
    peaks = different = 0
    with mpmath.workdps(DIGITS):
        for row in draw_waveforms(np.random.default_rng(seed), count):
            waveform = Waveform.from_array(row)
            times, values = reference_extrema(head, waveform, initial_state, WINDOW_S)
            if compiled:
                got_times, got_values = batch.peaks(waveform, head, initial_state, WINDOW_S)
            else:
                response = head.respond(waveform, initial_state, WINDOW_S)
                got_times, got_values = response.peak_times_s, response.peaks_V
            peaks += len(times)
            if len(times) != len(got_times):
                different += 1
                continue
            for t, v, got_t, got_v in zip(times, values, got_times, got_values, strict=True):
                worst_time = max(worst_time, float(abs(got_t - t) / t))
                worst_peak = max(worst_peak, float(abs(got_v - v) / abs(v)))
    return Accuracy(count, peaks, different, worst_peak, worst_time)


def main() -> None:
    """Print the comparison for both paths and both initial states."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000, help="number of waveforms (default 1000)")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.count < 1:
        parser.error(f"--count must be at least 1; got {arguments.count}.")
    for state in ("periodic", "demagnetised"):
        for compiled in (True, False):
            found = compare(arguments.count, arguments.seed, state, compiled)
            print(
                f"{state:12s} {'compiled' if compiled else 'plain':8s}: "
                f"{found.waveforms} waveforms, {found.peaks} peaks, "
                f"{found.different_count} waveforms with another number of peaks; "
                f"largest relative difference: peak {found.worst_peak:.1e}, time {found.worst_time:.1e}"
            )


if __name__ == "__main__":
    main()
