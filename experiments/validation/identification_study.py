"""Performance of the identification in figures: ``python -m inkjet_env.experiments.validation.identification_study``.

``published``: the published head's hysteresis from one 90 V loop, as in the paper's section 3.1.
``heads``: random heads at 40 dB; errors, coverage of the intervals, seconds per head.
``peers``: held-out error compared with a linear fit without hysteresis and with the paper's procedure.
``measured FOLDER``: a measured piezo actuator, split into a part that determines the hysteresis and one that determines
the resonance.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from inkjet_env.envs.task import CONTEXT_LOWER, CONTEXT_NAMES, CONTEXT_UPPER
from inkjet_env.extras import extra
from inkjet_env.identification import Identification, identify, in_convention
from inkjet_env.printhead import BranchLaw, Printhead
from inkjet_env.progress import shown_progress
from inkjet_env.recordings import Campaign, Recording, read_campaign
from inkjet_env.rig import record_campaign
from inkjet_env.typing import Real

SNR_dB = 40.0
HEADS = 50
PARAMETERS = ("a0", "a1", "b1")


def published_loop(seed: int = 0) -> tuple[Identification, Recording]:
    """The published head identified from self-sensing and a single 90 V loop at 1 rad/s, and that loop."""
    campaign = record_campaign(Printhead.published(), seed)
    loops = [r for r in campaign.select("strain_gauge", "sine") if r.repeat_of is None]
    loop = min(loops, key=lambda r: abs(r.step_s * r.time_s.size - 2 * math.pi))
    kept = [r for r in campaign.recordings if r.channel != "strain_gauge"]
    alone = Campaign(campaign.name, (loop, *(replace(r, order=i + 2) for i, r in enumerate(kept))))
    return identify(alone), loop


@dataclass(frozen=True)
class HeadResult:
    """One random head: relative errors and coverage of `PARAMETERS`, held-out residual over noise, degree, seconds."""

    errors: tuple[float, ...]
    covered: tuple[bool, ...]
    held_out_ratio: float
    degree: int
    seconds: float


def identified_head(seed: int, snr_dB: float = SNR_dB) -> HeadResult:
    """Draw a head, record it with the virtual rig, identify it and compare with the truth."""
    rng = np.random.default_rng(seed)
    drawn = dict(zip(CONTEXT_NAMES, rng.uniform(CONTEXT_LOWER, CONTEXT_UPPER), strict=True))
    head = Printhead.published().varied(**drawn)
    campaign = record_campaign(head, rng, snr_dB=snr_dB)
    begun = time.perf_counter()
    found = identify(campaign)
    seconds = time.perf_counter() - begun
    truth = in_convention(head, found.printhead.full_scale_V)
    pairs = [(found.dynamics[name], getattr(truth, name)) for name in PARAMETERS]
    residual, noise = found.rms("self_sensing", held_out=True)
    return HeadResult(
        tuple(abs(estimate.value / value - 1) for estimate, value in pairs),
        tuple(estimate.low <= value <= estimate.high for estimate, value in pairs),
        residual / noise,
        len(found.printhead.coefficients) - 1,
        seconds,
    )


def identified_heads(count: int, workers: int | None = None) -> list[HeadResult]:
    """Results for random heads with seeds from 0, identified in parallel, with progress."""
    with extra("the study"):
        from joblib import Parallel, delayed

    results = []
    with shown_progress("heads", count) as progress:
        finished = Parallel(n_jobs=workers or -1, return_as="generator")(
            delayed(identified_head)(seed) for seed in range(count)
        )
        for done, result in enumerate(finished, start=1):
            results.append(result)
            progress(done)
    return results


@dataclass(frozen=True)
class LinearBaseline:
    """A second-order system with a given input, fitted as a SciPy user would: output error, one gain, one offset."""

    a0: float
    a1: float
    gain: float
    offset: float

    def predicted(self, input_V: Real, recording: Recording) -> Real:
        """Predicted signal at every sample, in the recording's unit."""
        return self.gain * unit_response(self.a0, self.a1, input_V, recording) + self.offset


def unit_response(a0: float, a1: float, input_V: Real, recording: Recording) -> Real:
    """``s / (s² + a1 s + a0)`` on an input that is linear between samples (scipy.signal: cont2discrete and lfilter).

    The input of a periodic recording is repeated until the response is steady.
    """
    from scipy.signal import cont2discrete, lfilter

    numerator, denominator, _ = cont2discrete(([1.0, 0.0], [1.0, a1, a0]), recording.step_s, method="foh")
    warm_up_periods = 1
    if recording.initial_state == "periodic":
        warm_up_periods += math.ceil(2 * math.log(1e6) / a1 / (recording.step_s * input_V.size))
    answer = lfilter(numerator[0], denominator, np.tile(input_V - input_V[0], warm_up_periods))
    return np.asarray(answer[-input_V.size :])


def fit_linear_baseline(
    inputs: Sequence[Real], recordings: Sequence[Recording], start: tuple[float, float]
) -> LinearBaseline:
    """Least squares over all recordings (`scipy.optimize.least_squares`); gain and offset are eliminated linearly."""
    from scipy.optimize import least_squares

    target = np.concatenate([r.sensor for r in recordings])

    def linear(logarithms: Real) -> tuple[Real, Real]:
        a0, a1 = np.exp(logarithms)
        answer = np.concatenate([unit_response(a0, a1, v, r) for v, r in zip(inputs, recordings, strict=True)])
        matrix = np.column_stack([answer, np.ones_like(answer)])
        return matrix, np.linalg.lstsq(matrix, target, rcond=None)[0]

    def residual(logarithms: Real) -> Real:
        matrix, solution = linear(logarithms)
        return np.asarray(target - matrix @ solution)

    found = least_squares(residual, np.log(start), x_scale=[1e-3, 1e-2])
    gain, offset = linear(found.x)[1]
    a0, a1 = np.exp(found.x)
    return LinearBaseline(a0, a1, gain, offset)


def paper_branch_law(loop: Recording, degree: int = 8) -> BranchLaw:
    """Polynomial fitted to the two branches of one measured loop, both axes normalised by their swing (section 3.1)."""
    top, bottom = int(np.argmax(loop.drive_V)), int(np.argmin(loop.drive_V))
    full_scale_V, swing = float(np.ptp(loop.drive_V)), loop.sensor[top] - loop.sensor[bottom]
    n = loop.drive_V.size
    x, y = [], []
    for start, end in ((bottom, top), (top, bottom)):
        branch = np.arange(start, start + (end - start) % n + 1) % n
        x.append(np.abs(loop.drive_V[branch] - loop.drive_V[start]) / full_scale_V)
        y.append(np.abs(loop.sensor[branch] - loop.sensor[start]) / abs(swing))
    powers = np.concatenate(x)[:, None] ** np.arange(1, degree + 1)
    coefficients = np.linalg.lstsq(powers, np.concatenate(y), rcond=None)[0]
    return BranchLaw((*(float(c) for c in coefficients[::-1]), 0.0), full_scale_V)


def held_out_errors(seed: int = 0, snr_dB: float | None = None) -> dict[str, float]:
    """Held-out RMS residual of self-sensing in volts: this package, linear fit, the paper's procedure; noise."""
    head = Printhead.published()
    campaign = record_campaign(head, seed, snr_dB=snr_dB)
    found = identify(campaign)
    ours, noise = found.rms("self_sensing", held_out=True)
    held_out = {r.name for r in found.heldout}
    fast = campaign.select("self_sensing")
    train = [r for r in fast if r.name not in held_out and np.ptp(r.drive_V) > 0]
    unseen = [r for r in fast if r.name in held_out]
    law = paper_branch_law(min(campaign.select("strain_gauge", "sine"), key=lambda r: r.step_s))
    views: dict[str, Callable[[Recording], Real]] = {
        "linear fit, no hysteresis": lambda r: r.drive_V,
        "the paper: one-point Q, then linear fit": lambda r: law.hysteretic_V(
            r.drive_V, "periodic" if r.initial_state == "periodic" else "demagnetised", one_point=True
        ),
    }
    errors = {"this package": ours}
    for name, view in views.items():
        baseline = fit_linear_baseline([view(r) for r in train], train, (head.a0, head.a1))
        errors[name] = math.sqrt(
            sum(float(np.mean((r.sensor - baseline.predicted(view(r), r)) ** 2)) for r in unseen) / len(unseen)
        )
    errors["noise"] = noise
    return errors


def measured_pieces(folder: Path) -> Campaign:
    """The measured piezo actuator's recording, split into three periods of the sine and the step's ring-down."""
    whole = read_campaign(folder).recordings[0]
    period = round(1.0 / whole.step_s)
    step = int(np.argmax(whole.drive_V != 0))

    def cut(name: str, start: int, stop: int, initial_state: str, order: int) -> Recording:
        part = slice(start, stop)
        return replace(
            whole,
            name=name,
            time_s=whole.time_s[part] - whole.time_s[start],
            drive_V=whole.drive_V[part],
            sensor=whole.sensor[part],
            initial_state=initial_state,
            order=order,
        )

    sines = [cut(f"period-{i}", i * period, (i + 1) * period, "periodic", i + 1) for i in (1, 2, 3)]
    return Campaign("piezo-actuator", (cut("ring-down", step - 284, step + 516, "demagnetised", 1), *sines))


def _print_published() -> None:
    found, _ = published_loop()
    published = np.array(Printhead.published().coefficients)
    choice = found.degree
    print("degree  squared error of the fit over the noise's")
    for degree, rms in zip(choice.degrees, choice.rms_error, strict=True):
        print(f"{degree:6d}  {rms**2:10.4f}" + ("  chosen" if degree == choice.by_flattening else ""))
    x = np.linspace(0, 1, 1001)
    print("A identified:", np.array(found.printhead.coefficients).round(3).tolist())
    print("A published: ", published.tolist())
    difference = np.abs(found.printhead.branch_law.Q(x) - Printhead.published().branch_law.Q(x)).max()
    residual, noise = found.rms("strain_gauge", held_out=False)
    loop = next(r for r in found.recordings if r.channel == "strain_gauge")
    print(f"largest difference of Q: {100 * difference:.3f} % of the swing")
    largest, rms, floor = np.array([np.abs(loop.residual()).max(), residual, noise]) * 100 / np.ptp(loop.measured)
    print(f"loop residual: at most {largest:.2f} %, RMS {rms:.3f} % of the swing; noise {floor:.3f} %")


def _print_heads(count: int) -> None:
    results = identified_heads(count)
    covered = np.array([r.covered for r in results])
    errors = np.array([r.errors for r in results])
    print(f"{count} random heads, {SNR_dB:g} dB")
    for i, name in enumerate(PARAMETERS):
        print(f"{name}: median error {100 * np.median(errors[:, i]):.4f} %, covered {100 * covered[:, i].mean():.0f} %")
    spread = 1.645 * math.sqrt(0.09 / covered.size)
    print(f"covered over all: {100 * covered.mean():.1f} % of {covered.size} (90 ± {100 * spread:.1f} % expected)")
    ratios = np.array([r.held_out_ratio for r in results])
    print(f"held-out residual over noise: median {np.median(ratios):.4f}, {ratios.min():.3f} … {ratios.max():.3f}")
    print("degrees chosen:", np.unique([r.degree for r in results], return_counts=True))
    print(f"{np.median([r.seconds for r in results]):.2f} s a head (median)")


def _print_baselines() -> None:
    for snr_dB in (None, SNR_dB):
        errors = held_out_errors(snr_dB=snr_dB)
        print("the instruments' own noise" if snr_dB is None else f"{snr_dB:g} dB")
        for name, error in errors.items():
            print(f"  {name}: {error * 1e3:.3f} mV, {error / errors['this package']:.1f} times this package's")


def _print_measured(folder: Path) -> None:
    pieces = measured_pieces(folder)
    unseen = pieces["period-3"]
    sine = float(np.std(unseen.sensor))
    line = np.polyfit(pieces["period-1"].drive_V, pieces["period-1"].sensor, 1)
    rms_um = float(np.sqrt(np.mean((unseen.sensor - np.polyval(line, unseen.drive_V)) ** 2)))
    print(
        f"a straight line through the sine: {rms_um:.3f} um = {100 * rms_um / sine:.2f} % of the sine's RMS, held out"
    )
    ring_down = Campaign("ring-down", (pieces["ring-down"],))
    for title, campaign, held_out in (
        ("the whole recording as it is", read_campaign(folder), None),
        ("cut into periods and ring-down", pieces, ("period-3",)),
        ("the ring-down alone", ring_down, ()),
    ):
        found = identify(campaign, held_out=held_out)
        head = found.printhead
        print(
            f"{title}: resonance {head.frequency_Hz:.0f} Hz, damping ratio {head.damping_ratio:.3f}, degree "
            f"{len(head.coefficients) - 1}; noise at rest {found.recordings[0].noise_rms:.3f} um"
        )
        for r in found.recordings:
            parts = [(word, r.rms(held_out=flag)) for word, flag in (("fitted", False), ("held out", True))]
            sizes = ", ".join(f"{rms:.3f} um {word}" for word, rms in parts if not math.isnan(rms))
            print(f"  {r.name}: {sizes}; at most {np.abs(r.residual()).max():.2f} um")
    alone = found.recordings[0]
    after = alone.residual()[int(np.argmax(alone.drive_V != 0)) :]
    lines = np.abs(np.fft.rfft(after - after.mean()))
    strongest = float(np.fft.rfftfreq(after.size, alone.step_s)[np.argmax(lines)])
    print(f"strongest line in the residual of the ring-down alone: {strongest:.0f} Hz")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "study", nargs="?", choices=("published", "heads", "baselines", "measured", "all"), default="all"
    )
    parser.add_argument("folder", nargs="?", type=Path, help="folder of the measured recordings")
    parser.add_argument("--count", type=int, default=HEADS, help="number of random heads")
    given = parser.parse_args(arguments)
    if given.study == "measured" and given.folder is None:
        parser.error("measured needs the folder of the recordings: measured FOLDER.")
    if given.study in ("published", "all"):
        _print_published()
    if given.study in ("heads", "all"):
        _print_heads(given.count)
    if given.study in ("baselines", "all"):
        _print_baselines()
    if given.folder is not None:
        _print_measured(given.folder)


if __name__ == "__main__":
    main()
