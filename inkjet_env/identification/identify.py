"""From a campaign to a printhead: the whole of sections 3.1 and 3.2 of Zhu et al. 2024, for any head."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification.basis import drive_basis
from inkjet_env.identification.constrained import density_constraints
from inkjet_env.identification.convention import conventional_swing
from inkjet_env.identification.degree import CHANCE_F, HIGHEST_DEGREE, DegreeChoice, choose_degree
from inkjet_env.identification.identification import Estimate, Identification, Residual
from inkjet_env.identification.measurements import Measurement, least_noise, measurements, noise_of
from inkjet_env.identification.noise import NoiseModel
from inkjet_env.identification.separable import Fitted, Model, Solution, fit_everything, linearised_blocks
from inkjet_env.identification.starting_point import best_start, ringing_gain
from inkjet_env.printhead import Printhead, check_name
from inkjet_env.recordings import Campaign

Real = NDArray[np.float64]

DEGREE_RULES = ("flattening", "strain_gauge", "held_out")
STARTING_DEGREE = 5
"""Of the branch law while the search for the resonator begins."""
DEGREES_UNSEEN = 2
"""Dynamics and gains allow for so many more powers than the law has."""
MOST_DEGREE_ROUNDS = 4
MOST_NOISE_ROUNDS = 5
RESIDUAL = "the residual of the fit"
"""Source of a noise that nothing else tells."""
QUANTILE_90 = 1.6448536269514722
"""Of the normal distribution: 90 % of it lie within so many standard deviations."""
LARGEST_UNCERTAINTY = math.log(10)
"""Half width of the interval of ``ln a0`` or ``ln a1`` from which on the resonator counts as not identified."""
LEAST_RINGING_GAIN = 50.0
"""By how much a resonance must lower χ² against a head without one, the search having tried many."""
NOTHING_RINGS = (
    "nothing in them rings. Take pulses with short edges, or a multisine about the resonance, sampled at ten times its "
    "frequency; `inkjet record --plan FOLDER` writes such drives."
)
NOISE_TOLERANCE = 1.05
"""A channel whose residual exceeds its noise by less is explained; beyond, its weight and all intervals follow the
residual."""


def identify(
    campaign: Campaign,
    *,
    degree: int | None = None,
    degree_rule: str = "flattening",
    valid_density: bool = False,
    full_scale_V: float | None = None,
    held_out: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Identification:
    """Identify hysteresis and resonator from all recordings of a campaign together.

    Branch law from the strain gauge (from the fast channels where there is none), ``a0, a1, b1`` by free-run output
    error on every fast recording, then everything together, weighed by the noise; one offset a channel, and the
    resonator's initial state where it is ``free``, are fitted along and nothing else.

    The scale of the branch law cannot be observed beside the gains: it is the published head's, see `convention`.

    Parameters
    ----------
    campaign : Campaign
    degree : int, optional
        Of the branch law, 1 … 12; chosen by ``degree_rule`` unless given.
    degree_rule : {"flattening", "strain_gauge", "held_out"}
        The last degree that lowers the error of all recordings together by more than chance; of the strain gauge's
        loops alone, as in the paper; the least degree that foretells loops held out one after another as well as any.
    valid_density : bool
        Whether to enforce ``p(r) ≥ 0``.
    full_scale_V : float, optional
        Change of drive at ``x = 1``, beyond which the law goes on along its tangent. Unless given, the largest that the
        strain gauge has seen (a virgin curve counts twice its drive), or any recording where that fits better.
    held_out : sequence of str, optional
        Recordings that no fit sees; see `measurements`.
    progress : callable, optional
        Told what is being done, in words, whenever that changes.

    Raises
    ------
    ValueError
        Nothing that a parameter could be identified from; the message says which recording is needed.
    """
    check_name("degree_rule", degree_rule, DEGREE_RULES)
    if degree is not None and not 1 <= degree <= HIGHEST_DEGREE:
        raise ValueError(f"degree must be 1 to {HIGHEST_DEGREE}; got {degree}.")
    if full_scale_V is not None and not 1e-3 <= full_scale_V <= 1e6:
        raise ValueError(f"full_scale_V must be a voltage of 1e-3 to 1e6 V; got {full_scale_V!r}.")

    def identifier(swing_V: float | None) -> _Identifier:
        return _Identifier(
            campaign, degree, degree_rule, valid_density, swing_V, held_out, progress or (lambda _: None)
        )

    first = identifier(full_scale_V)
    first.solve()
    if full_scale_V is None and first.reached_V > 1.01 * first.full_scale_V:
        # The fast drives go beyond the gauge's: does the law go straight on there, or does it bend on?
        wider = identifier(first.reached_V)
        wider.solve(first.solution.model)
        if wider.deviance < first.deviance - CHANCE_F:
            wider.notes.append(
                f"The law bends on beyond the strain gauge's {first.full_scale_V:g} V, as the fast recordings tell; "
                f"full scale is {wider.full_scale_V:g} V."
            )
            return wider.finished()
    return first.finished()


class _Identifier:
    """The steps of one identification."""

    def __init__(
        self,
        campaign: Campaign,
        degree: int | None,
        degree_rule: str,
        valid_density: bool,
        full_scale_V: float | None,
        held_out: Sequence[str] | None,
        progress: Callable[[str], None],
    ) -> None:
        self.degree_given, self.degree_rule, self.valid_density = degree, degree_rule, valid_density
        self.all = measurements(campaign, held_out)
        self.notes: list[str] = []
        self.noise = noise_of(self.all)
        lost = {key: noise.lost for key, noise in self.noise.items()}
        self.train = [m for m in self.all if m.fitted >= 2 + lost.get(m.noise_key, 0)]
        short = [name for m in self.all if m.fitted and m not in self.train for name in m.names]
        if short:
            self.notes.append(f"{', '.join(short)}: too short beside how long the noise remembers; not fitted.")
        moving = [m for m in self.train if not m.still]
        # What only rested tells noise and no gain.
        self.train = [m for m in self.train if m.channel in {mine.channel for mine in moving}]
        self.gauge = [m for m in moving if m.channel == "strain_gauge"]
        self.fast = [m for m in moving if m.channel != "strain_gauge"]
        if not self.fast:
            raise ValueError(
                f"campaign {campaign.name!r} has no recording to identify a0, a1 and b1 from: they need a self_sensing "
                "or displacement recording whose drive moves and that is not held out. Take pulses and a multisine; "
                "`inkjet record --plan FOLDER` writes such drives for a generator."
            )
        for channel in {m.channel for m in moving}:
            if all(np.ptp(m.mean) == 0 for m in moving if m.channel == channel):
                raise ValueError(
                    f"channel {channel} shows one value throughout while the drive moves; is its sensor connected?"
                )
        self.full_scale_V = full_scale_V or _largest_change_V(self.gauge or self.fast)
        self.reached_V = _largest_change_V(moving)
        self.least = least_noise(self.all)
        self.progress = progress
        self.loudness: dict[str, float] = {}
        self.coloured: set[str] = set()  # channels whose residual is no white noise once it is whitened
        self.correlation: dict[str, float] = {}

    def solve(self, start: Model | None = None) -> None:
        """The fit of everything, its resonator begun with that of ``start``; residuals may exceed the noise."""
        unseen = {m.noise_key for m in self.train} - set(self.noise)
        for key in unseen:
            level = 0.01 * max(float(np.std(m.mean)) for m in self.train if m.noise_key == key)
            level = max(level, self.least[key[0]])
            self.noise[key] = NoiseModel(np.ones(1), level, level, "a first guess")
        model = Model(start.a0, start.a1, np.ones(1), {}, {}) if start else self._start()
        if unseen:
            model = self._noise_from_residuals(model, unseen)
        self.solution, alone, self.joint = self._with_degree(model)
        self.alone = alone or self.joint

    @property
    def deviance(self) -> float:
        """Minus twice the logarithm of the likelihood, but for a constant; and what chance would gain by each power."""
        fitted = self.fitted(self.train, 1)
        scale = sum(f.samples // len(f.measurement.signals) * math.log(f.noise.innovation) for f in fitted)
        return self.solution.chi_square + 2 * scale + CHANCE_F * self.solution.model.weights.size

    def finished(self) -> Identification:
        """What was identified, intervals widened where residuals exceed the noise."""
        misfit = dict(self.solution.rms)
        self.loudness = {channel: rms for channel, rms in misfit.items() if rms > self._tolerance(channel)}
        if self.loudness:
            self.coloured |= set(self.loudness)
            self.solution = self.refined(self.solution.model, self.solution.model.weights.size)
            for channel, rms in self.loudness.items():
                self.notes.append(
                    f"{channel}: the residual is {rms:.3g} times the noise, so the model leaves something out; the "
                    "channel's weight and the intervals follow the residual."
                )
        return self.result(self.solution, self.alone, self.joint, misfit)

    def _tolerance(self, channel: str) -> float:
        """Residual over noise up to which a channel is explained; few samples scatter more."""
        samples = sum(m.fitted for m in self.train if m.channel == channel)
        return NOISE_TOLERANCE + 3 / math.sqrt(2 * samples)

    def fitted(self, chosen: Sequence[Measurement], degree: int) -> list[Fitted]:
        """Recordings with their bases of one degree."""
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
        """A resonator, and a branch law where a strain gauge shows it."""
        self.progress("looking for the resonance")
        degree = self.degree_given or STARTING_DEGREE
        if not self.gauge:
            a0, a1 = best_start(self.fitted(self.fast, degree), None)
            return Model(a0, a1, np.ones(1), {}, {})
        gauge = self.fitted(self.gauge, degree)
        law = fit_everything(gauge, Model(1.0, 0.5, np.zeros(degree), {"strain_gauge": 1.0}, {"strain_gauge": 0.0}))
        a0, a1 = best_start(self.fitted(self.fast, degree), law.model.weights)
        return Model(a0, a1, law.model.weights, {}, {})

    def _with_degree(self, model: Model) -> tuple[Solution, DegreeChoice | None, DegreeChoice]:
        """The fit at the degree of the rule; error against degree on the strain gauge, and on everything."""
        alone = None
        if self.gauge:
            gauge = self.fitted(self.gauge, HIGHEST_DEGREE)
            still = Model(1.0, 0.5, np.zeros(HIGHEST_DEGREE), {"strain_gauge": 1.0}, {"strain_gauge": 0.0})
            alone = self._choice(gauge, still, leave_out=True)
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
        """The degree of the rule on one channel."""
        if self.degree_rule == "held_out" and choice.by_held_out is not None:
            return choice.by_held_out
        return choice.by_flattening

    def _choice(self, fitted: Sequence[Fitted], model: Model, leave_out: bool) -> DegreeChoice:
        """Error against degree, everything else linearised about a model."""
        self.progress("error against degree")
        correlation = max((self.correlation.get(f.measurement.channel, 1.0) for f in fitted), default=1.0)
        samples = [f.samples // len(f.measurement.signals) for f in fitted]
        blocks = linearised_blocks(fitted, model)
        return choose_degree(blocks, samples, correlation, blocks[0].shape[1] - HIGHEST_DEGREE - 1, leave_out)

    def refined(self, start: Model, degree: int) -> Solution:
        """The fit of everything from a start whose weights may have another degree."""
        self.progress(f"fitting all recordings, degree {degree}")
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
        return fit_everything(fitted, begin, constraints, self.coloured)

    @property
    def reference(self) -> str:
        """The channel whose gain the weights carry."""
        if self.gauge:
            return "strain_gauge"
        return "self_sensing" if any(m.channel == "self_sensing" for m in self.fast) else "displacement"

    def _gain(self, channel: str, start: Model) -> float:
        """Gain of a channel by itself on the start's branch law."""
        psi, y = [], []
        for f in self.fitted([m for m in self.train if m.channel == channel], start.weights.size):
            n = f.measurement.fitted
            psi.append(f.basis.response(channel, start.a0, start.a1)[:n] @ start.weights)
            y.append(f.measurement.mean[:n])
        x, target = np.concatenate(psi), np.concatenate(y)
        x = x - x.mean()
        power = float(x @ x)
        return float(x @ (target - target.mean())) / power if power > 0 else 1.0

    def _noise_from_residuals(self, model: Model, unseen: Collection[tuple[str, float]]) -> Model:
        """White noise of the residual's RMS where nothing else tells it, from a law as rich as may be; the model of it.

        That the residual is hardly white is kept in mind: its channel counts as coloured, and chance as stronger.
        """
        channels = sorted({channel for channel, _ in unseen})
        self.coloured |= set(channels)
        for _ in range(MOST_NOISE_ROUNDS):
            model = self.refined(model, self.degree_given or HIGHEST_DEGREE).model
            changed = 1.0
            for key in unseen:
                keyed = self._keyed(model, key)
                left = np.concatenate([self._left(f, model) for f in keyed])
                rms = max(math.sqrt(float(np.mean(left**2))), self.least[key[0]])
                before = self.noise[key].rms
                self.correlation[key[0]] = max((self._band_rms(model, key) * before / rms) ** 2, 1.0)
                self.noise[key] = NoiseModel(np.ones(1), rms, rms, RESIDUAL)
                changed = max(changed, rms / before, before / rms)
            if changed < 1.02:
                break
        self.notes.append(
            f"No exact repeats and no recording at rest tell the noise of {' and '.join(channels)}; it was taken from "
            "the fit's own residual, so what the model leaves out counts as noise there."
        )
        return model

    @staticmethod
    def _left(f: Fitted, model: Model) -> Real:
        """What the model leaves of the fitted samples."""
        left: Real = (f.measurement.mean - model.predicted(f.measurement, f.basis))[: f.measurement.fitted]
        return left

    def _keyed(self, model: Model, key: tuple[str, float]) -> list[Fitted]:
        return self.fitted([m for m in self.train if m.noise_key == key], model.weights.size)

    def _band_rms(self, model: Model, key: tuple[str, float]) -> float:
        """RMS of the whitened residual as a white one would have it that is as strong in the signal's own band.

        A residual that the model's errors make has its power where the signal has, and misleads the parameters by more
        than white noise of its RMS would.
        """
        power = shared = 0.0
        for f in self._keyed(model, key):
            modelled = model.predicted(f.measurement, f.basis)
            pair = np.column_stack([f.measurement.mean - modelled, modelled - modelled.mean()])
            left, signal = np.abs(np.fft.rfft(f.whitened(pair), axis=0).T) ** 2
            shared += float(np.mean(left * signal))
            power += float(np.mean(signal)) * f.measurement.fitted
        return math.sqrt(shared / power) if power > 0 else 1.0

    def _richer(self, solution: Solution) -> Solution:
        """The fit with a law of more powers than these recordings tell, which dynamics and gains are taken from.

        A power that was left out because it was not seen may still be there, and would pull everything else.
        """
        degree = solution.model.weights.size
        richer = min(HIGHEST_DEGREE, degree + DEGREES_UNSEEN)
        if self.degree_given is not None or richer == degree:
            return solution
        return self.refined(solution.model, richer)

    def _gain_of_reference(self, model: Model) -> float:
        """Of the law's swing over the convention's."""
        swing = float(model.weights.sum())
        if not math.isfinite(swing) or abs(swing) < 1e-12 * float(np.abs(model.weights).sum()):
            raise ValueError(f"channel {self.reference} does not follow the drive at all; is its sensor connected?")
        return swing / conventional_swing(self.full_scale_V)

    def _chi_square(self, model: Model) -> float:
        """Of the whitened residuals of the fitted samples."""
        return sum(
            float(
                np.sum(
                    f.whitened((f.measurement.mean - model.predicted(f.measurement, f.basis, f.noise))[:, None]) ** 2
                )
            )
            for f in self.fitted(self.train, model.weights.size)
        )

    def result(
        self, solution: Solution, choice: DegreeChoice, joint: DegreeChoice, misfit: Mapping[str, float]
    ) -> Identification:
        """The printhead, its intervals, and the residual of every recording."""
        law, d = solution.model.weights, solution.model.weights.size
        coefficients = law / self._gain_of_reference(solution.model)
        richer = self._richer(solution)
        gain_of_reference = self._gain_of_reference(richer.model)
        model = replace(richer.model, weights=coefficients * gain_of_reference)
        if self._chi_square(model) > solution.chi_square + 2 * CHANCE_F:
            # These recordings do not tell how far the law swings: law and gains only go together.
            model, gain_of_reference = solution.model, self._gain_of_reference(solution.model)
        place = {name: i for i, name in enumerate(richer.names)}
        swings = np.array([float(name.startswith("w")) for name in richer.names])
        gains = {}
        for channel, ratio in model.ratios.items():
            gradient = ratio * swings / conventional_swing(self.full_scale_V)
            if channel != self.reference:
                gradient[place[f"ratio {channel}"]] = gain_of_reference
            value = ratio * gain_of_reference
            error = QUANTILE_90 * richer.error_of(gradient)
            gains[channel] = Estimate(value, value - error, value + error)
        fast = self.fitted(self.fast, d)
        if ringing_gain(fast, model.a0, model.a1) < LEAST_RINGING_GAIN:
            raise ValueError(f"a head without any resonance fits these recordings as well: {NOTHING_RINGS}")
        dynamics = {}
        for name, value in (("a0", model.a0), ("a1", model.a1)):
            error = QUANTILE_90 * richer.error_of(np.eye(len(place))[place[f"ln {name}"]])
            if not error < LARGEST_UNCERTAINTY:
                raise ValueError(
                    f"these recordings do not tell {name} to within a factor of {math.exp(LARGEST_UNCERTAINTY):.0f}: "
                    + NOTHING_RINGS
                )
            dynamics[name] = Estimate(value, value * math.exp(-error), value * math.exp(error))
        if "self_sensing" in gains:
            dynamics["b1"] = gains["self_sensing"]
        else:
            a0 = dynamics["a0"]
            dynamics["b1"] = Estimate(math.sqrt(a0.value), math.sqrt(a0.low), math.sqrt(a0.high))
            self.notes.append(
                "b1, the gain of self-sensing, is not observable without a self_sensing recording. It was set to √a0: "
                "the signal then is the deflection's speed over √a0 in hysteretic volts, a convention."
            )
        shape = (np.eye(d) - np.outer(law, np.ones(d)) / law.sum()) / self._gain_of_reference(solution.model)
        printhead = Printhead(
            model.a0,
            model.a1,
            dynamics["b1"].value,
            (*(float(c) for c in coefficients[::-1]), 0.0),
            self.full_scale_V,
        )
        self._say_what_matters(printhead, choice, joint, solution)
        return Identification(
            printhead,
            dynamics,
            gains,
            dict(model.offsets),
            shape @ solution.covariance[:d, :d] @ shape.T,
            choice,
            joint,
            self.noise,
            self._residuals(model),
            misfit,
            tuple(self.notes),
        )

    def _say_what_matters(
        self, printhead: Printhead, choice: DegreeChoice, joint: DegreeChoice, solution: Solution
    ) -> None:
        if not solution.converged:
            self.notes.append("The fit had not settled when it was stopped; its intervals mean little.")
        if not self.gauge:
            self.notes.append(
                "Without a strain-gauge recording the hysteresis was identified from the fast channels themselves."
            )
        told = {"all recordings": joint.by_flattening}
        if self.gauge:
            told["the strain gauge alone"] = choice.by_flattening
        if choice.by_held_out is not None:
            told["drives held out in turn"] = choice.by_held_out
        if self.degree_given is None and len(set(told.values())) > 1:
            words = ", ".join(f"{degree} by {source}" for source, degree in told.items())
            self.notes.append(f"Degree {words}; {len(printhead.coefficients) - 1} is used.")
        if solution.held:
            self.notes.append("p(r) ≥ 0 was asked for and binds: without it the law would have a negative density.")
        x = np.linspace(0.0, 1.0, 2001)
        negative = x[printhead.branch_law.curvature(x) < -1e-9]
        if negative.size:
            self.notes.append(
                f"p(r) is negative for x = |Δu|/{self.full_scale_V:g} V between {negative[0]:.3f} and "
                f"{negative[-1]:.3f}: not quite a valid Prandtl–Ishlinskii density."
            )
        partly = [m for m in self.all if 0 < m.fitted < m.drive_V.size]
        if partly:
            names = " and ".join(partly[0].names)
            self.notes.append(f"Too few recordings to hold one out whole; the last quarter of {names} was held out.")
        elif all(m.fitted for m in self.all if m.channel != "strain_gauge"):
            self.notes.append("No fast recording was held out, so nothing here tells how well others are foretold.")

    def _residuals(self, model: Model) -> tuple[Residual, ...]:
        rows: list[Residual] = []
        for m in self.all:
            basis = drive_basis(m.drive_V, m.step_s, self.full_scale_V, model.weights.size, m.initial_state)
            if m.channel not in model.ratios:
                continue
            modelled = model.predicted(m, basis)
            rms = self.noise[m.noise_key].rms if m.noise_key in self.noise else math.nan
            rows.extend(
                Residual(name, m.channel, m.unit, m.step_s, m.drive_V, signal, modelled, m.fitted, rms)
                for name, signal in zip(m.names, m.signals, strict=True)
            )
        return tuple(sorted(rows, key=lambda r: r.name))


def _largest_change_V(measured: Sequence[Measurement]) -> float:
    """The largest argument of the branch law, in volts, to three digits: a sampled sine misses its top by a hair.

    The virgin curve's is twice the drive; of a periodic drive only a level shows it, and self-sensing has none.
    """
    changes = []
    for m in measured:
        changes.append(float(np.ptp(m.drive_V)))
        if m.initial_state != "periodic" or m.channel != "self_sensing":
            changes.append(2 * float(np.abs(m.drive_V).max()))
    return float(f"{max(changes):.3g}")
