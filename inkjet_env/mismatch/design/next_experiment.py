"""The recording that would separate the candidates that a campaign cannot distinguish.

The design is T-optimal: the largest distance between the rival models' predictions (Atkinson & Fedorov, Biometrika 62,
1975). The rivals may adapt: before two predictions are compared, base and effect parameters move towards the rival as
far as the campaign's information on them allows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from inkjet_env.mismatch.design.drive_library import Proposal, benches, library
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.joint_fit import DIFFERENCE
from inkjet_env.mismatch.localization.views import CHANNELS, largest_V
from inkjet_env.mismatch.settings import DesignSettings
from inkjet_env.plant import Effect, Excitation
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.plant.wording import with_prefix
from inkjet_env.typing import Real


@dataclass(frozen=True)
class NextExperiment:
    """The recording that would separate the remaining candidates.

    Attributes
    ----------
    sentence : str
        What to record, and what it would show, in words.
    channel : str
        Channel to record; empty, as all below, if no drive can be computed.
    initial_state : str
        Initial state: "periodic" or "demagnetised".
    step_s : float
        Sampling step.
    drive_V : tuple of float
        Drive at each sample.
    neighbour_V : tuple of float
        Drive of the neighbouring channel at each sample; empty if it stays at 0 V.
    separation : float
        Expected difference of log-likelihoods between the two candidates that are separated worst.
    repeats : int
        Number of recordings to take of it.
    drive_monitor : bool
        Whether the voltage at the head must be recorded beside the sensor.
    """

    sentence: str
    channel: str = ""
    initial_state: str = ""
    step_s: float = 0.0
    drive_V: tuple[float, ...] = ()
    neighbour_V: tuple[float, ...] = ()
    separation: float = 0.0
    repeats: int = 1
    drive_monitor: bool = False

    def as_json(self, drive_csv: str | None) -> dict[str, Any]:
        """The experiment within a ``diagnosis/1``; ``drive_csv`` names the file of its drive."""
        known = bool(self.drive_V)
        return {
            "sentence": self.sentence,
            "drive_csv": drive_csv,
            "channel": self.channel if known else None,
            "initial_state": self.initial_state if known else None,
            "step_s": self.step_s if known else None,
            "repeats": self.repeats if known else None,
            "drive_monitor": self.drive_monitor if known else None,
        }


@dataclass(frozen=True, eq=False)
class _Judged:
    """A proposal with the distance between the candidates' predictions, pair by pair.

    ``separations`` are half the squared whitened distances, ``differences`` the largest differences of the signals, in
    the channel's unit.
    """

    proposal: Proposal
    separations: tuple[float, ...]
    differences: tuple[float, ...]

    @property
    def utility(self) -> float:
        """Sum of ln(1 + separation) over the pairs, so that no pair counts for everything."""
        return math.fsum(math.log1p(s) for s in self.separations)

    @property
    def least(self) -> int:
        """Index of the pair that is separated worst."""
        return int(np.argmin(self.separations))


def next_experiment(
    fits: Sequence[FitResult],
    noise: Noise,
    observed: Sequence[ObservedRecording],
    effects: Sequence[Effect],
    settings: DesignSettings,
) -> NextExperiment | None:
    """The recording that best separates the candidates that explain a campaign equally well.

    Parameters
    ----------
    fits : sequence of FitResult
        Two or more candidates. For a single one, the answer says in words what shows its effects best; without any
        effect, it says which effects the campaign cannot show and what would show them.
    noise : Noise
        Noise of the channels, expected in the next recording too.
    observed : sequence of ObservedRecording
        The campaign's recordings.
    effects : sequence of Effect
        Effects that the diagnosis looked for.
    settings : DesignSettings
        Settings of the design.

    Returns
    -------
    NextExperiment or None
        None if there is nothing to propose. Its ``separation`` is the expected difference of log-likelihoods between
        the two candidates that it separates worst.
    """
    candidates = [effect for fit in fits for effect in fit.active.effects]
    if len(fits) < 2:
        return _in_words(candidates, effects, observed)
    judge = _Judge(fits, noise, observed, settings)
    tried = [
        judged
        for bench in benches(observed, fits[0].head.printhead.frequency_Hz, settings)
        for proposal in library(bench)
        if (judged := judge.judged(proposal)) is not None
    ]
    best = max(tried, key=lambda judged: judged.utility, default=None)
    if best is None:
        return _in_words(candidates, effects, observed)
    best = _refined(best, judge)
    separation = best.separations[best.least]
    if separation < settings.separation:
        monitored = judge.monitored(tried)
        if monitored is not None and monitored.separations[monitored.least] > separation:
            return _proposed(monitored, judge, at_head=True)
    if settings.most_repeats * separation < settings.separation:
        return _in_words(candidates, effects, observed)
    return _proposed(best, judge, at_head=False)


class _Judge:
    """Predictions of the candidates, and how far the campaign's information lets each adapt."""

    def __init__(
        self,
        fits: Sequence[FitResult],
        noise: Noise,
        observed: Sequence[ObservedRecording],
        settings: DesignSettings,
    ) -> None:
        self.fits, self.noise, self.observed, self.settings = tuple(fits), noise, tuple(observed), settings
        self.pairs = tuple(itertools.combinations(range(len(fits)), 2))
        seen = [o for o in observed if o.fitted]
        base = np.concatenate([noise.whitened(o, fits[0].head.sensitivities(o))[: o.fitted] for o in seen])
        self.information: list[Real] = []
        for fit in fits:
            self.information.append(np.asarray(np.linalg.qr(np.column_stack([base, fit.jacobian]), mode="r")))

    def recording(self, excitation: Excitation) -> ObservedRecording:
        """An excitation as a recording still to be taken."""
        unit = next(o.unit for o in self.observed if o.channel == excitation.channel)
        return ObservedRecording(
            "next", excitation.channel, unit, -1, excitation, np.zeros(excitation.samples), excitation.samples
        )

    def judged(self, proposal: Proposal) -> _Judged | None:
        """How well a proposal separates each pair; None if a candidate cannot predict it."""
        excitation = proposal.excitation
        o = self.recording(excitation)
        if o.noise_key not in self.noise.models:
            return None
        try:
            signals = [fit.head.plant(fit.active.pairs).signal(excitation) for fit in self.fits]
            columns = [np.column_stack([fit.head.sensitivities(o), _jacobian(fit, excitation)]) for fit in self.fits]
        except NUMERICAL:
            return None
        largest = max(
            float(np.abs(other.measured).max()) for other in self.observed if other.channel == excitation.channel
        )
        if not all(float(np.abs(signal).max()) <= self.settings.plausible_signal * largest for signal in signals):
            return None
        white = [self.noise.whitened(o, c) for c in columns]
        separations, differences = [], []
        for i, j in self.pairs:
            difference = signals[i] - signals[j]
            d = self.noise.whitened(o, difference)
            found = []
            for k in (i, j):
                step, square = _adapted(self.information[k], white[k], d)
                found.append((square, difference - columns[k] @ step))
            square, remains = min(found, key=lambda pair: pair[0])
            separations.append(0.5 * square)
            differences.append(float(np.abs(remains).max()))
        if not np.isfinite(separations).all():
            return None
        return _Judged(proposal, tuple(separations), tuple(differences))

    def monitored(self, tried: Sequence[_Judged]) -> _Judged | None:
        """The proposal under which the voltages at the head differ most; None if they are recorded already."""
        if any(o.channel == "drive_monitor" for o in self.observed):
            return None
        noise_V = self.monitor_noise_V
        best = None
        for judged in tried:
            excitation = judged.proposal.excitation
            if not excitation.fast:
                continue
            try:
                voltages = [
                    excitation.sampled(fit.head.plant(fit.active.pairs).at_ceramic_V(excitation)) for fit in self.fits
                ]
            except NUMERICAL:
                continue
            apart = [voltages[i] - voltages[j] for i, j in self.pairs]
            found = _Judged(
                judged.proposal,
                tuple(0.5 * float(d @ d) / noise_V**2 for d in apart),
                tuple(float(np.abs(d).max()) for d in apart),
            )
            if best is None or found.utility > best.utility:
                best = found
        return best

    @property
    def monitor_noise_V(self) -> float:
        """Noise RMS of a voltage measured at the head, in volts."""
        return self.settings.monitor_noise * max(largest_V(o) for o in self.observed)


def _adapted(information: Real, columns: Real, difference: Real) -> tuple[Real, float]:
    """Step of a candidate's parameters towards its rival, shape (size,), and the squared distance that remains.

    The campaign's information, a triangular factor, restrains the step; parameters on which it has none move freely.
    """
    rows = np.concatenate([information, columns])
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    target = np.concatenate([np.zeros(len(information)), difference])
    step = np.linalg.lstsq(rows / size, target, rcond=1e-15)[0]
    remains = target - rows / size @ step
    return np.asarray(step / size), float(remains @ remains)


def _jacobian(fit: FitResult, excitation: Excitation) -> Real:
    """Derivatives of a signal with respect to the coordinates of a candidate's effects, shape (n, k)."""
    active = fit.active
    columns = np.zeros((excitation.samples, active.theta.size))
    if not active.theta.size:
        return columns
    here = fit.head.plant(active.pairs).signal(excitation)
    for k, (_, parameter) in enumerate(active.parameters):
        size = DIFFERENCE * active.scale(k)
        there = active.stepped(k, -size if active.theta[k] + size > parameter.bounds[1] else size)
        columns[:, k] = (fit.head.plant(there.pairs).signal(excitation) - here) / (there.theta[k] - active.theta[k])
    return columns


def _refined(best: _Judged, judge: _Judge) -> _Judged:
    """The best proposal with height, edges, dwell and gap of its pulses optimised; unchanged if it has no pulses."""
    from scipy.optimize import minimize

    train, excitation = best.proposal.train, best.proposal.excitation
    if train is None:
        return best
    settings = judge.settings
    available = benches(judge.observed, judge.fits[0].head.printhead.frequency_Hz, settings)
    bench = next(b for b in available if b.channel == excitation.channel)
    periods = excitation.samples * excitation.step_s / bench.period_s
    found = best

    def loss(theta: Real) -> float:
        nonlocal found
        height, *times = (float(factor) for factor in np.exp(theta))
        proposal = bench.changed(train, periods, height, times)
        judged = judge.judged(proposal) if proposal is not None else None
        if judged is None:
            return math.inf
        if judged.utility > found.utility:
            found = judged
        return -judged.utility

    size = 4 if train.gap_s else 3
    simplex = np.vstack([np.zeros(size), settings.refining_step * np.diag([-1.0, *np.ones(size - 1)])])
    options = {"maxfev": settings.refining_evaluations, "initial_simplex": simplex}
    minimize(loss, np.zeros(size), method="Nelder-Mead", options=options)
    return found


def _proposed(judged: _Judged, judge: _Judge, at_head: bool) -> NextExperiment:
    """A proposal in words, with the difference between the two candidates that it separates worst."""
    excitation = judged.proposal.excitation
    separation, difference = judged.separations[judged.least], judged.differences[judged.least]
    i, j = judge.pairs[judged.least]
    if at_head:
        unit, noise = "V", judge.monitor_noise_V
        start, place = "Record the voltage at the head as well (column drive_monitor_V)", "there "
    else:
        o = judge.recording(excitation)
        unit, noise = o.unit, judge.noise.models[o.noise_key].rms
        start, place = f"Record {CHANNELS[excitation.channel]}", ""
    names = f"{_named(judge.fits[i])} and {_named(judge.fits[j])}"
    size = f"{with_prefix(difference, unit)}, {float(f'{difference / noise:.2g}'):g} times the noise"
    state = "once the repeated drive has settled" if excitation.periodic else "from the demagnetised state"
    how = f"{state}, sampled every {with_prefix(excitation.step_s, 's', 3)}"
    said = f"{start} {judged.proposal.words}, {how}: the predictions for {names} differ {place}by up to {size}"
    least, repeats = judge.settings.separation, 1
    if separation < least:
        repeats = math.ceil(least / max(separation, 1e-300))
        said += f"; record it {repeats} times"
    neighbour_V = excitation.neighbour_V
    return NextExperiment(
        said + ".", excitation.channel, excitation.initial_state, excitation.step_s,
        tuple(float(v) for v in excitation.drive_V),
        () if neighbour_V is None or not neighbour_V.any() else tuple(float(v) for v in neighbour_V),
        separation, repeats, at_head,
    )  # fmt: skip


def _named(fit: FitResult) -> str:
    return " with ".join(name.replace("_", " ") for name in fit.ids) or "no effect"


def _in_words(
    candidates: Sequence[Effect], effects: Sequence[Effect], observed: Sequence[ObservedRecording]
) -> NextExperiment | None:
    """In words, recordings that show the candidates or, without any, the effects that the campaign cannot show."""
    if candidates:
        ways = list(dict.fromkeys(effect.shown_by for effect in candidates))
        return NextExperiment(f"To find out, record {'; and '.join(ways)}.")
    excitations = [o.excitation for o in observed]
    unseen: dict[str, list[str]] = {}
    for effect in effects:
        if effect.untestable(excitations):
            unseen.setdefault(effect.shown_by, []).append(effect.id.replace("_", " "))
    if not unseen:
        return None
    missing = "; ".join(f"{way}, for {' and '.join(names)}" for way, names in unseen.items())
    return NextExperiment(f"These recordings cannot show some effects. To test for them, record {missing}.")
