"""How far a drive would set the candidates' predictions apart, each adapting to its rival as far as it may."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.mismatch.design.drive_library import Proposal
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.joint_fit import DIFFERENCE
from inkjet_env.mismatch.localization.views import largest_V
from inkjet_env.mismatch.settings import DesignSettings
from inkjet_env.plant import Excitation
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Judged:
    """A proposal with the distances between the predictions for it.

    Attributes
    ----------
    proposal : Proposal
        The drive.
    separations : ndarray, shape (pairs,)
        Half the squared whitened distance of each pair of candidates: the expected difference of log-likelihoods, less
        where that is smaller than what separates either from a law that nobody thought of.
    from_none : ndarray, shape (candidates,)
        The same between each candidate and a law that nobody thought of.
    differences : tuple of float
        Largest difference of each pair's signals, in the channel's unit.
    at_head : tuple of float
        The same of the voltages at the head, if they are recorded too.
    """

    proposal: Proposal
    separations: Real
    from_none: Real
    differences: tuple[float, ...]
    at_head: tuple[float, ...] = ()


class Predictions:
    """Predictions of the candidates, and how far the campaign's information lets each adapt.

    Parameters
    ----------
    fits : sequence of FitResult
        The candidates.
    noise : Noise
        Noise of the channels, expected in further recordings too.
    observed : sequence of ObservedRecording
        The campaign's recordings.
    settings : DesignSettings
        Settings of the design.

    Attributes
    ----------
    pairs : tuple of tuple of int
        Pairs of candidates.
    of_the_drive : ndarray of bool, shape (pairs,)
        Whether two candidates differ in what they do to the drive.
    """

    def __init__(
        self,
        fits: Sequence[FitResult],
        noise: Noise,
        observed: Sequence[ObservedRecording],
        settings: DesignSettings,
    ) -> None:
        self.fits, self.noise, self.observed, self.settings = tuple(fits), noise, tuple(observed), settings
        self.pairs = tuple(itertools.combinations(range(len(fits)), 2))
        acting = [{e.id for e in fit.active.effects if e.acts_in("drive")} for fit in fits]
        self.of_the_drive = np.array([acting[i] != acting[j] for i, j in self.pairs])
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

    def judged(self, proposal: Proposal) -> Judged | None:
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
        if not self._within(self.settings.plausible_signal, signals, excitation.channel):
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
        without = self.fits[0].head.plant(()).signal(excitation)
        from_none = self._from_none([self.noise.whitened(o, signal - without) for signal in signals])
        if not (np.isfinite(separations).all() and np.isfinite(from_none).all()):
            return None
        return Judged(proposal, self._trusted(np.array(separations), from_none), from_none, tuple(differences))

    def _from_none(self, contributions: Sequence[Real]) -> Real:
        """Separation of each candidate from a law that nobody thought of, by its whitened contribution to a signal."""
        share = self.settings.law_unknown
        return np.array([0.5 * share**2 * float(d @ d) for d in contributions])

    def _trusted(self, separations: Real, from_none: Real) -> Real:
        """Separations of pairs, less where two predictions differ by less than the law of either may be wrong by."""
        doubt = np.array([max(from_none[i], from_none[j]) for i, j in self.pairs])
        return np.asarray(separations * np.minimum(separations / np.maximum(doubt, 1e-300), 1.0))

    def _within(self, factor: float, signals: Sequence[Real], channel: str) -> bool:
        """Whether signals are within so many times the largest one that a channel has recorded."""
        largest = max(float(np.abs(o.measured).max()) for o in self.observed if o.channel == channel)
        return all(float(np.abs(signal).max()) <= factor * largest for signal in signals)

    def unjudged(self, proposal: Proposal) -> Judged | None:
        """A proposal of which only what a probe at the head shows counts: noise at its sampling step is unknown."""
        excitation = proposal.excitation
        try:
            signals = [fit.head.plant(fit.active.pairs).signal(excitation) for fit in self.fits]
        except NUMERICAL:
            return None
        if not self._within(self.settings.probe_signal, signals, excitation.channel):
            return None
        nothing = np.zeros(len(self.pairs))
        return Judged(proposal, nothing, np.zeros(len(self.fits)), tuple(nothing.tolist()))

    def with_probe(self, tried: Sequence[Judged]) -> list[Judged]:
        """Proposals with the voltage at the head recorded too, where the sensor is fast; others as they are.

        Of two candidates that differ in what they do to the drive, only that voltage counts: a sensor shows it through
        all other stages, whose laws may be wrong by more.
        """
        found = []
        for judged in tried:
            excitation = judged.proposal.excitation
            if not excitation.fast:
                found.append(judged)
                continue
            try:
                voltages = [
                    excitation.sampled(fit.head.plant(fit.active.pairs).at_ceramic_V(excitation)) for fit in self.fits
                ]
            except NUMERICAL:
                continue
            apart_V = [voltages[i] - voltages[j] for i, j in self.pairs]
            from_none = self._from_none([(v - excitation.drive_V) / self.probe_noise_V for v in voltages])
            more = np.array([0.5 * float(d @ d) for d in apart_V]) / self.probe_noise_V**2
            found.append(
                replace(
                    judged,
                    separations=np.where(self.of_the_drive, 0.0, judged.separations) + self._trusted(more, from_none),
                    from_none=judged.from_none + from_none,
                    at_head=tuple(float(np.abs(d).max()) for d in apart_V),
                )
            )
        return found

    def probe_known(self, excitation: Excitation) -> bool:
        """Whether the campaign has recordings with a probe at a sampling step, which show its noise."""
        return ("drive_monitor", self.recording(excitation).noise_key[1]) in self.noise.models

    @property
    def probe_noise_V(self) -> float:
        """Noise RMS of a voltage measured at the head, in volts: the campaign's, or a usual probe's."""
        known = [model.rms for (channel, _), model in self.noise.models.items() if channel == "drive_monitor"]
        if known:
            return max(known)
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
