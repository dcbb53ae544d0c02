"""The steps of a fit: noise, a start, the degree, all parameters together, intervals that follow a loud residual."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.identification.basis import drive_basis
from inkjet_env.identification.constrained import density_constraints
from inkjet_env.identification.covariance import Solution
from inkjet_env.identification.degree import F_QUANTILE_999, HIGHEST_DEGREE, DegreeChoice, choose_degree
from inkjet_env.identification.errors import UnidentifiableError
from inkjet_env.identification.linearised import linearised_blocks
from inkjet_env.identification.measurements import RepeatedMeasurement, least_noise, measurements, noise_of
from inkjet_env.identification.model import Fitted, Model
from inkjet_env.identification.noise import NoiseModel
from inkjet_env.identification.separable import fit_everything
from inkjet_env.identification.starting_point import best_start
from inkjet_env.identification.work_done import WorkDone
from inkjet_env.recordings import Campaign

STARTING_DEGREE = 5
"""Degree of the branch law at the start of the search for the resonator."""
DEGREES_UNSEEN = 2
"""Number of powers beyond the degree of the law that dynamics and gains allow for."""
MOST_DEGREE_ROUNDS = 4
"""Largest number of rounds of choosing the degree and refitting."""
MOST_NOISE_ROUNDS = 5
"""Largest number of rounds of estimating noise from the residual and refitting."""
SMALLEST_CHANGE_V, LARGEST_CHANGE_V = 1e-3, 1e6
"""Full scales, in volts, that a branch law may have."""
SHARES = {"start": 0.03, "degree": 0.05, "fit": 0.2, "check": 0.9}
"""Share of the work that is left which a stage takes, as in campaigns of millions of rows."""
RESIDUAL = "the residual of the fit"
"""Source of a noise that can be estimated from nothing else."""
NOISE_TOLERANCE = 1.05
"""Ratio of residual to noise up to which a channel is explained; beyond it, the channel's weight and all intervals
follow the residual."""


class CampaignFit:
    """Fit of a campaign with a branch law of one full scale; parameters as in `identify`.

    Attributes
    ----------
    all, train, gauge, fast : sequence of RepeatedMeasurement
        Every recording; those with fitted samples; of the latter, those with a moving drive, of the static channel that
        shows the hysteresis most directly (the strain gauge, or a displacement if nothing is fast) and of the channels
        that show the resonator.
    orders : dict of str to int
        Position of each recording within the session, by its name.
    full_scale_V, reached_V : float
        Change of drive at ``x = 1``, and the largest change that was fitted, in volts.
    noise : dict
        Noise models by channel and sampling step in seconds.
    solution : Solution
        The fit with its covariance, as `solve` leaves it.
    joint, alone : DegreeChoice
        Error against degree on all recordings, and on the strain gauge alone (on all recordings if there is none).
    misfit : dict of str to float
        Root mean square of the whitened residual of each channel; 1 is the noise.
    notes : list of str
        Sentences for the reader, gathered during the fit.

    Raises
    ------
    UnidentifiableError
        No recording can be fitted, or a channel is constant throughout.
    """

    def __init__(
        self,
        campaign: Campaign,
        degree: int | None,
        degree_rule: str,
        valid_density: bool,
        full_scale_V: float | None,
        held_out: Sequence[str] | None,
        work: WorkDone,
        quasi_static: bool = False,
    ) -> None:
        self.degree_given, self.degree_rule, self.valid_density = degree, degree_rule, valid_density
        self.all = measurements(campaign, held_out, quasi_static)
        self.orders = {recording.name: recording.order for recording in campaign.recordings}
        self.notes: list[str] = []
        self.noise = noise_of(self.all)
        lost = {key: noise.lost for key, noise in self.noise.items()}
        self.train = [m for m in self.all if m.fitted >= 2 + lost.get(m.noise_key, 0)]
        short = [name for m in self.all if m.fitted and m not in self.train for name in m.names]
        if short:
            self.notes.append(f"{', '.join(short)}: shorter than the memory of the noise, and therefore not fitted.")
        moving = [m for m in self.train if not m.still]
        # A channel whose drive never moved shows noise but no gain.
        self.train = [m for m in self.train if m.channel in {mine.channel for mine in moving}]
        self.fast = [m for m in moving if m.fast]
        static = [m for m in moving if not m.fast]
        of_gauge = [m for m in static if m.channel == "strain_gauge"]
        self.gauge = of_gauge or static
        if not self.fast and (not self.gauge or any(m.fast for m in self.all)):
            raise UnidentifiableError(
                f"campaign {campaign.name!r} has no recording to identify a0, a1 and b1 from: they need a self_sensing "
                "or displacement recording whose drive moves and that is not held out. Take pulses and a multisine; "
                "`inkjet record --plan FOLDER` writes such drives for a generator."
            )
        for channel in sorted({m.channel for m in moving}):
            if all(np.ptp(m.mean) == 0 for m in moving if m.channel == channel):
                raise UnidentifiableError(
                    f"channel {channel} is constant while the drive changes; is its sensor connected?"
                )
        self.full_scale_V = full_scale_V or _largest_change_V(self.gauge or self.fast)
        self.reached_V = _largest_change_V(moving)
        if not SMALLEST_CHANGE_V <= self.full_scale_V <= LARGEST_CHANGE_V:
            raise UnidentifiableError(
                f"the drive of campaign {campaign.name!r} changes by {self.full_scale_V:g} V; a head can be identified "
                f"from changes of {SMALLEST_CHANGE_V:g} to {LARGEST_CHANGE_V:g} V. Check the unit of drive_V, volts."
            )
        self.least = least_noise(self.all)
        self.work = work
        self.loudness: dict[str, float] = {}
        self.coloured: set[str] = set()  # channels whose whitened residual is not white
        self.correlation: dict[str, float] = {}

    def solve(self, start: Model | None = None) -> None:
        """Fit all parameters, starting from the resonator of ``start``; residuals may exceed the noise."""
        unseen = {m.noise_key for m in self.train} - set(self.noise)
        for key in sorted(unseen):
            level = 0.01 * max(float(np.std(m.mean)) for m in self.train if m.noise_key == key)
            level = max(level, self.least[key[0]])
            self.noise[key] = NoiseModel(np.ones(1), level, level, "a first guess")
        model = Model(start.a0, start.a1, np.ones(1), {}, {}) if start else self._start()
        if unseen:
            model = self._noise_from_residuals(model, unseen)
        self.solution, alone, self.joint = self._with_degree(model)
        self.alone, self.misfit = alone or self.joint, self.solution.rms

    @property
    def deviance(self) -> float:
        """Minus twice the log-likelihood, up to a constant, plus a penalty of `F_QUANTILE_999` for each power."""
        fitted = self.fitted(self.train, 1)
        scale = sum(f.samples // len(f.measurement.signals) * math.log(f.noise.innovation) for f in fitted)
        return self.solution.chi_square + 2 * scale + F_QUANTILE_999 * self.solution.model.weights.size

    def widen(self) -> None:
        """Refit with channels whose residual exceeds their noise weighted by the residual, which widens intervals."""
        self.loudness = {channel: rms for channel, rms in self.misfit.items() if rms > self._tolerance(channel)}
        if not self.loudness:
            return
        self.coloured |= set(self.loudness)
        self.solution = self.refined(self.solution.model, self.solution.model.weights.size)
        for channel, rms in self.loudness.items():
            self.notes.append(
                f"{channel}: the residual is {rms:.3g} times the noise, so the model is incomplete; the "
                "channel's weight and the intervals are based on the residual."
            )

    def _tolerance(self, channel: str) -> float:
        """Ratio of residual to noise up to which a channel is explained; it is larger for few samples."""
        samples = sum(m.fitted for m in self.train if m.channel == channel)
        return NOISE_TOLERANCE + 3 / math.sqrt(2 * samples)

    def fitted(self, chosen: Sequence[RepeatedMeasurement], degree: int) -> list[Fitted]:
        """The chosen recordings with their bases of one degree."""
        return [
            Fitted(
                m,
                drive_basis(m.drive_V, m.step_s, self.full_scale_V, degree, m.initial_state),
                self.noise[m.noise_key],
                self.loudness.get(m.channel, 1.0),
            )
            for m in chosen
        ]

    def _start(self) -> Model:
        """Start of the fit: a resonator, and a branch law if a strain gauge shows it."""
        self.work.begin("looking for the resonance" if self.fast else "fitting the hysteresis", SHARES["start"])
        degree = self.degree_given or STARTING_DEGREE
        if not self.gauge:
            a0, a1 = best_start(self.fitted(self.fast, degree), None, self.work.passed)
            return Model(a0, a1, np.ones(1), {}, {})
        still = self._still(degree)
        law = fit_everything(self.fitted(self.gauge, degree), still).model.weights
        if not self.fast:
            return replace(still, weights=law, ratios={}, offsets={})
        a0, a1 = best_start(self.fitted(self.fast, degree), law, self.work.passed)
        return Model(a0, a1, law, {}, {})

    def _with_degree(self, model: Model) -> tuple[Solution, DegreeChoice | None, DegreeChoice]:
        """Fit at the degree of the rule; error against degree on the strain gauge, and on all recordings."""
        alone = None
        if self.gauge:
            alone = self._choice(self.fitted(self.gauge, HIGHEST_DEGREE), self._still(HIGHEST_DEGREE), leave_out=True)
        degree = self.degree_given or (self._by_rule(alone) if alone else STARTING_DEGREE)
        solution = self.refined(model, degree)
        everything = self.fitted(self.train, HIGHEST_DEGREE)
        for _ in range(MOST_DEGREE_ROUNDS):
            joint = self._choice(everything, solution.model, leave_out=not self.gauge)
            if self.degree_given is not None:
                break
            degree = joint.by_flattening if self.degree_rule == "flattening" else self._by_rule(alone or joint)
            if degree == solution.model.weights.size:
                break
            solution = self.refined(solution.model, degree)
        return solution, alone, joint

    def _by_rule(self, choice: DegreeChoice) -> int:
        """Degree according to the rule on one channel."""
        if self.degree_rule == "held_out" and choice.by_held_out is not None:
            return choice.by_held_out
        return choice.by_flattening

    def _choice(self, fitted: Sequence[Fitted], model: Model, leave_out: bool) -> DegreeChoice:
        """Error against degree, with everything else linearised about a model."""
        self.work.begin("choosing the degree", SHARES["degree"])
        correlation = max((self.correlation.get(f.measurement.channel, 1.0) for f in fitted), default=1.0)
        samples = [f.samples // len(f.measurement.signals) for f in fitted]
        blocks = linearised_blocks(fitted, model, self.work.passed)
        return choose_degree(blocks, samples, correlation, blocks[0].shape[1] - HIGHEST_DEGREE - 1, leave_out)

    def refined(self, start: Model, degree: int) -> Solution:
        """Fit all parameters from a start whose weights may have another degree."""
        self.work.begin(f"fitting all recordings, degree {degree}", SHARES["fit"])
        fitted = self.fitted(self.train, degree)
        weights = np.zeros(degree)
        weights[: min(degree, start.weights.size)] = start.weights[:degree]
        ratios = dict(start.ratios)
        missing = {m.channel for m in self.train} - set(ratios)
        if missing:  # the start's law may lack the reference's gain
            reference = self._gain(self.reference, start)
            for channel in sorted(missing):
                ratios[channel] = 1.0 if channel == self.reference else self._gain(channel, start) / reference
        offsets = {channel: start.offsets.get(channel, 0.0) for channel in ratios}
        constraints = density_constraints(degree) if self.valid_density else None
        begin = replace(start, weights=weights, ratios=ratios, offsets=offsets)
        return fit_everything(fitted, begin, constraints, self.coloured, self.work.passed)

    @property
    def reference(self) -> str:
        """Reference channel, whose gain is a factor of the weights."""
        if self.gauge:
            return self.gauge[0].channel
        return "self_sensing" if any(m.channel == "self_sensing" for m in self.fast) else "displacement"

    def _gain(self, channel: str, start: Model) -> float:
        """Gain of a single channel on the branch law of the start."""
        psi, y = [], []
        for f in self.fitted([m for m in self.train if m.channel == channel], start.weights.size):
            n = f.measurement.fitted
            psi.append(f.measurement.response(f.basis, start.a0, start.a1)[:n] @ start.weights)
            y.append(f.measurement.mean[:n])
        x, target = np.concatenate(psi), np.concatenate(y)
        x = x - x.mean()
        power = float(x @ x)
        return float(x @ (target - target.mean())) / power if power > 0 else 1.0

    def _noise_from_residuals(self, model: Model, unseen: Collection[tuple[str, float]]) -> Model:
        """Estimate white noise from the RMS of a high-degree residual where nothing else shows it; returns that model.

        Since such a residual is hardly white, its channel counts as coloured and random gains are taken as larger.
        """
        channels = sorted({channel for channel, _ in unseen})
        self.coloured |= set(channels)
        for _ in range(MOST_NOISE_ROUNDS):
            model = self.refined(model, self.degree_given or HIGHEST_DEGREE).model
            changed = 1.0
            correlation: dict[str, float] = {}
            for key in sorted(unseen):
                keyed = self.fitted([m for m in self.train if m.noise_key == key], model.weights.size)
                rms = max(_residual_rms(keyed, model), self.least[key[0]])
                before = self.noise[key].rms
                correlation[key[0]] = max((_band_rms(keyed, model) * before / rms) ** 2, correlation.get(key[0], 1.0))
                self.noise[key] = NoiseModel(np.ones(1), rms, rms, RESIDUAL)
                changed = max(changed, rms / before, before / rms)
            self.correlation.update(correlation)
            if changed < 1.02:
                break
        self.notes.append(
            f"The noise of {' and '.join(channels)} is unknown without exact repeats and recordings at rest; it was "
            "estimated from the fit's residual, so any error of the model counts as noise there."
        )
        return model

    def richer(self) -> Solution:
        """Fit with a law of more powers than these recordings resolve, from which dynamics and gains are taken.

        A power that is left out because it is too small to be seen may still exist and would bias everything else.
        """
        degree = self.solution.model.weights.size
        richer = min(HIGHEST_DEGREE, degree + DEGREES_UNSEEN)
        if self.degree_given is not None or richer == degree:
            return self.solution
        return self.refined(self.solution.model, richer)

    def _still(self, degree: int) -> Model:
        """Model for the static channel `gauge` alone, with a law yet to be fitted; the resonator is a placeholder."""
        return Model(1.0, 0.5, np.zeros(degree), {self.reference: 1.0}, {self.reference: 0.0})


def _residual_rms(fitted: Sequence[Fitted], model: Model) -> float:
    """RMS residual of the model over the fitted samples, in the channel's unit."""
    residuals = [(f.measurement.mean - model.predicted(f.measurement, f.basis))[: f.measurement.fitted] for f in fitted]
    return math.sqrt(float(np.mean(np.concatenate(residuals) ** 2)))


def _band_rms(fitted: Sequence[Fitted], model: Model) -> float:
    """RMS of white noise that is as strong in the signal's own band as the whitened residual; 1 is the noise.

    A residual due to errors of the model has its power where the signal has, and biases the parameters by more than
    white noise of its RMS would.
    """
    power = shared = 0.0
    for f in fitted:
        modelled = model.predicted(f.measurement, f.basis)
        pair = np.column_stack([f.measurement.mean - modelled, modelled - modelled.mean()])
        residuals, signal = np.abs(np.fft.rfft(f.whitened(pair), axis=0).T) ** 2
        shared += float(np.mean(residuals * signal))
        power += float(np.mean(signal)) * f.measurement.fitted
    return math.sqrt(shared / power) if power > 0 else 1.0


def _largest_change_V(measured: Sequence[RepeatedMeasurement]) -> float:
    """Largest argument of the branch law, in volts, rounded to three digits: a sampled sine slightly misses its top.

    On the virgin curve it is twice the drive. For a periodic drive that shows only in a level, which self-sensing
    lacks.
    """
    changes = []
    for m in measured:
        changes.append(float(np.ptp(m.drive_V)))
        if m.initial_state != "periodic" or m.channel != "self_sensing":
            changes.append(2 * float(np.abs(m.drive_V).max()))
    return float(f"{max(changes):.3g}")
