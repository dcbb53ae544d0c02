"""From a campaign to a printhead: the whole of sections 3.1 and 3.2 of Zhu et al. 2024, for any head."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification.basis import drive_basis
from inkjet_env.identification.constrained import density_constraints
from inkjet_env.identification.convention import conventional_swing
from inkjet_env.identification.degree import HIGHEST_DEGREE, DegreeChoice, choose_degree
from inkjet_env.identification.measurements import Measurement, least_noise, measurements, noise_of
from inkjet_env.identification.noise import NoiseModel
from inkjet_env.identification.separable import Fitted, Model, Solution, fit_everything, triangle
from inkjet_env.identification.starting_point import best_start, ringing_gain
from inkjet_env.printhead import Printhead, check_name
from inkjet_env.recordings import Campaign

Real = NDArray[np.float64]

DEGREE_RULES = ("flattening", "held_out")
STARTING_DEGREE = 5
"""Of the branch law while the search for the resonator begins, where no strain gauge tells it."""
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


@dataclass(frozen=True)
class Estimate:
    """A value and its 90 % confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Residual:
    """What a recording shows beyond the model: arrays of shape (n,), in the channel's unit."""

    name: str
    channel: str
    unit: str
    step_s: float
    drive_V: Real
    measured: Real
    modelled: Real
    fitted: int
    noise_rms: float

    @property
    def time_s(self) -> Real:
        """From the first sample on."""
        return np.arange(self.measured.size, dtype=np.float64) * np.float64(self.step_s)

    @property
    def difference(self) -> Real:
        """Measured minus modelled."""
        left: Real = self.measured - self.modelled
        return left

    @property
    def held_out(self) -> bool:
        """Whether any of it was kept from the fit."""
        return self.fitted < self.measured.size

    @property
    def rms(self) -> float:
        """Of the difference over what was held out, or over all of a recording that was fitted whole."""
        return self.rms_of(self.held_out)

    def rms_of(self, held_out: bool) -> float:
        """Of the difference over what was held out, or over what was fitted; NaN where there is no such part."""
        part = self.difference[self.fitted :] if held_out else self.difference[: self.fitted]
        return float(np.sqrt(np.mean(part**2))) if part.size else math.nan


@dataclass(frozen=True, eq=False)
class Identification:
    """A printhead identified from a campaign; made by `identify`.

    Attributes
    ----------
    printhead : Printhead
    dynamics : dict of str to Estimate
        ``a0, a1, b1``.
    gains : dict of str to Estimate
        Of each channel: ``b1`` of self-sensing; units per hysteretic volt of strain gauge and displacement (``b0/a0``).
    offsets : dict of str to float
        In the channel's unit.
    coefficient_covariance : ndarray, shape (degree, degree)
        Of the branch law's coefficients, lowest power first.
    degree : DegreeChoice
    degree_channel : str
        The channel whose recordings chose the degree.
    noise : dict
        Noise models by channel and sampling step.
    residuals : tuple of Residual
        One a recording.
    misfit : dict of str to float
        Of each channel: root mean square of the whitened residual of the fit; 1 is the noise.
    notes : tuple of str
        What a reader must know, in sentences.
    """

    printhead: Printhead
    dynamics: Mapping[str, Estimate]
    gains: Mapping[str, Estimate]
    offsets: Mapping[str, float]
    coefficient_covariance: Real
    degree: DegreeChoice
    degree_channel: str
    noise: Mapping[tuple[str, float], NoiseModel]
    residuals: tuple[Residual, ...]
    misfit: Mapping[str, float]
    notes: tuple[str, ...]

    @property
    def heldout(self) -> tuple[Residual, ...]:
        """Recordings, or ends of recordings, that no fit has seen."""
        return tuple(r for r in self.residuals if r.held_out)

    def unit(self, channel: str) -> str:
        """Unit of a channel's signal: V or um."""
        return next(r.unit for r in self.residuals if r.channel == channel)

    def rms(self, channel: str, held_out: bool) -> tuple[float, float]:
        """Root mean square of a channel's residual, and of its noise, over held-out or fitted recordings."""
        mine = [r for r in self.residuals if r.channel == channel and not math.isnan(r.rms_of(held_out))]
        return _pooled(r.rms_of(held_out) for r in mine), _pooled(r.noise_rms for r in mine)

    def fit_json(self) -> dict[str, Any]:
        """The entry "fit" of ``printhead.json``: how well the model fits, in volts where the channel has volts."""
        main = "self_sensing" if "self_sensing" in self.gains else "displacement"
        unit = self.unit(main)
        heldout, noise = self.rms(main, held_out=True)
        train, noise_train = self.rms(main, held_out=False)
        channels = {
            channel: {
                "unit": self.unit(channel),
                "gain": vars(gain),
                "offset": self.offsets[channel],
                "residual_over_noise": self.misfit[channel],
            }
            for channel, gain in self.gains.items()
        }
        return {
            f"noise_rms_{unit}": noise if math.isfinite(noise) else noise_train,
            f"heldout_rms_{unit}": heldout if math.isfinite(heldout) else None,
            f"train_rms_{unit}": train,
            "heldout": [r.name for r in self.heldout],
            "degree_by_flattening": self.degree.by_flattening,
            "degree_by_held_out": self.degree.by_held_out,
            "channels": channels,
            "notes": list(self.notes),
        }

    def as_json(self) -> dict[str, Any]:
        """What ``printhead.json`` holds."""
        intervals = {name: (estimate.low, estimate.high) for name, estimate in self.dynamics.items()}
        return self.printhead.as_json(intervals, self.fit_json())


def identify(
    campaign: Campaign,
    *,
    degree: int | None = None,
    degree_rule: str = "flattening",
    valid_density: bool = False,
    full_scale_V: float | None = None,
    held_out: Sequence[str] | None = None,
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
    degree_rule : {"flattening", "held_out"}
        The paper's rule, or loops held out one after another.
    valid_density : bool
        Whether to enforce ``p(r) ≥ 0``.
    full_scale_V : float, optional
        Change of drive at ``x = 1``; unless given, the largest change that the hysteresis is identified from
        (the virgin curve after demagnetising counts twice its drive).
    held_out : sequence of str, optional
        Recordings that no fit sees; see `measurements`.

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
    return _Identifier(campaign, degree, degree_rule, valid_density, full_scale_V, held_out).run()


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
        source = self.gauge or self.fast
        # A sampled sine may miss its top by a hair: three digits say what was meant.
        self.full_scale_V = full_scale_V or float(f"{max(map(_largest_change_V, source)):.3g}")
        self.least = least_noise(self.all)
        self.coloured: set[str] = set()  # channels whose residual is no white noise once it is whitened
        self.correlation: dict[str, float] = {}

    def run(self) -> Identification:
        unseen = {m.noise_key for m in self.train} - set(self.noise)
        for key in unseen:
            level = 0.01 * max(float(np.std(m.mean)) for m in self.train if m.noise_key == key)
            level = max(level, self.least[key[0]])
            self.noise[key] = NoiseModel(np.ones(1), level, level, "a first guess")
        solution, choice = self.fit()
        if unseen:
            for key in unseen:
                self.noise[key] = self._noise_from_residuals(solution.model, key)
            channels = sorted({channel for channel, _ in unseen})
            self.notes.append(
                f"No repeats and no recording at rest tell the noise of {' and '.join(channels)}; it was taken from "
                "the fit's own residual, so what the model leaves out counts as noise there."
            )
            solution, choice = self.fit(solution.model)
        misfit = dict(solution.rms)
        loud = {channel: rms for channel, rms in misfit.items() if rms > NOISE_TOLERANCE}
        if loud:
            for key in [key for key in self.noise if key[0] in loud]:
                self.noise[key] = replace(self.noise[key], innovation=self.noise[key].innovation * loud[key[0]])
            self.coloured |= set(loud)
            solution = self.refined(solution.model, choice)
            for channel, rms in loud.items():
                self.notes.append(
                    f"{channel}: the residual is {rms:.3g} times the noise, so the model leaves something out; the "
                    "channel's weight and the intervals follow the residual."
                )
        return self.result(solution, choice, misfit)

    def fitted(self, chosen: Sequence[Measurement], degree: int) -> list[Fitted]:
        """Recordings with their bases of one degree."""
        return [
            Fitted(
                m,
                drive_basis(m.drive_V, m.step_s, self.full_scale_V, degree, m.initial_state),
                self.noise[m.noise_key],
            )
            for m in chosen
        ]

    def fit(self, start: Model | None = None) -> tuple[Solution, DegreeChoice]:
        """Everything, from nothing or from an earlier fit."""
        if self.gauge:
            choice = self._degree_from(self.gauge, None)
            gauge = self.fitted(self.gauge, self.degree_of(choice))
            law = fit_everything(gauge, Model(1.0, 0.5, np.zeros(gauge[0].basis.degree), {"strain_gauge": 1.0}, {}))
            if start is None:
                a0, a1 = best_start(self.fitted(self.fast, gauge[0].basis.degree), law.model.weights)
                start = Model(a0, a1, law.model.weights, {}, {})
            return self.refined(start, choice), choice
        if start is None:
            a0, a1 = best_start(self.fitted(self.fast, STARTING_DEGREE), None)
            start = Model(a0, a1, np.ones(1), {}, {})
        for _ in range(2):
            choice = self._degree_from(self._hysteresis_source(), start)
            solution = self.refined(start, choice)
            start = solution.model
        return solution, choice

    def _hysteresis_source(self) -> list[Measurement]:
        """Recordings that choose the degree."""
        return self.gauge or [m for m in self.fast if m.channel == "displacement"] or self.fast

    def degree_of(self, choice: DegreeChoice) -> int:
        """The degree to use."""
        if self.degree_given is not None:
            return self.degree_given
        if self.degree_rule == "held_out" and choice.by_held_out is not None:
            return choice.by_held_out
        return choice.by_flattening

    def _degree_from(self, source: Sequence[Measurement], model: Model | None) -> DegreeChoice:
        blocks, samples = [], []
        for f in self.fitted(source, HIGHEST_DEGREE):
            n = f.measurement.fitted
            psi = f.basis.response(f.measurement.channel, *((model.a0, model.a1) if model else (1.0, 0.5)))[:n]
            block = f.whitened(np.column_stack([psi, np.ones(n), f.measurement.mean[:n]]))
            if model and f.measurement.initial_state == "free":
                q = np.linalg.qr(f.whitened(f.basis.free_states(model.a0, model.a1)[:n]))[0]
                block = block - q @ (q.T @ block)
            blocks.append(triangle(block))
            samples.append(len(block))
        return choose_degree(blocks, samples, self.correlation.get(source[0].channel, 1.0))

    def refined(self, start: Model, choice: DegreeChoice) -> Solution:
        """The fit of everything from a start whose weights may have another degree."""
        degree = self.degree_of(choice)
        fitted = self.fitted(self.train, degree)
        weights = np.zeros(degree)
        weights[: min(degree, start.weights.size)] = start.weights[:degree]
        ratios = dict(start.ratios)
        missing = {m.channel for m in self.train} - set(ratios)
        if missing:  # the start's law may lack the reference's gain
            reference = self._gain(fitted, self.reference, start)
            for channel in sorted(missing):
                ratios[channel] = 1.0 if channel == self.reference else self._gain(fitted, channel, start) / reference
        offsets = {channel: start.offsets.get(channel, 0.0) for channel in ratios}
        constraints = density_constraints(degree) if self.valid_density else None
        begin = replace(start, weights=weights, ratios=ratios, offsets=offsets)
        return fit_everything(fitted, begin, constraints, self.coloured)

    @property
    def reference(self) -> str:
        """The channel whose gain the weights carry."""
        if self.gauge:
            return "strain_gauge"
        return "self_sensing" if any(m.channel == "self_sensing" for m in self.train) else "displacement"

    def _gain(self, fitted: Sequence[Fitted], channel: str, start: Model) -> float:
        """Gain of a channel by itself on the start's branch law."""
        psi, y = [], []
        for f in fitted:
            if f.measurement.channel == channel:
                n = f.measurement.fitted
                shape = f.basis.response(channel, start.a0, start.a1)[:n, : start.weights.size]
                psi.append(shape @ start.weights)
                y.append(f.measurement.mean[:n])
        x, target = np.concatenate(psi), np.concatenate(y)
        x = x - x.mean()
        power = float(x @ x)
        return float(x @ (target - target.mean())) / power if power > 0 else 1.0

    def _noise_from_residuals(self, model: Model, key: tuple[str, float]) -> NoiseModel:
        """White noise of the residual's RMS; that the residual is hardly white is kept in mind."""
        guess = self.noise[key]
        left = [f.measurement.mean - model.predicted(f.measurement, f.basis) for f in self._keyed(model, key)]
        rms = max(math.sqrt(float(np.mean(np.concatenate(left) ** 2))), self.least[key[0]])
        self.coloured.add(key[0])
        strength = (self._band_rms(model, key) * guess.innovation / rms) ** 2
        self.correlation[key[0]] = max(strength, self.correlation.get(key[0], 1.0))
        return NoiseModel(np.ones(1), rms, rms, "the residual of the fit")

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

    def result(self, solution: Solution, choice: DegreeChoice, misfit: Mapping[str, float]) -> Identification:
        """The printhead, its intervals, and the residual of every recording."""
        model, d = solution.model, solution.model.weights.size
        swing = float(model.weights.sum())
        convention = conventional_swing(self.full_scale_V)
        gain_of_reference = swing / convention
        if not math.isfinite(gain_of_reference) or abs(swing) < 1e-12 * float(np.abs(model.weights).sum()):
            raise ValueError(f"channel {self.reference} does not follow the drive at all; is its sensor connected?")
        coefficients = model.weights / gain_of_reference
        place = {name: i for i, name in enumerate(solution.names)}
        ones = np.zeros(len(place))
        ones[:d] = 1.0
        gains = {}
        for channel, ratio in model.ratios.items():
            gradient = ratio * ones / convention
            if channel != self.reference:
                gradient[place[f"ratio {channel}"]] = gain_of_reference
            value = ratio * gain_of_reference
            error = QUANTILE_90 * math.sqrt(max(float(gradient @ solution.covariance @ gradient), 0.0))
            gains[channel] = Estimate(value, value - error, value + error)
        fast = self.fitted(self.fast, d)
        if ringing_gain(fast, model.a0, model.a1) < LEAST_RINGING_GAIN:
            raise ValueError(f"a head without any resonance fits these recordings as well: {NOTHING_RINGS}")
        dynamics = {}
        for name, value in (("a0", model.a0), ("a1", model.a1)):
            error = QUANTILE_90 * math.sqrt(max(solution.covariance[place[f"ln {name}"], place[f"ln {name}"]], 0.0))
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
        shape = (np.eye(d) - np.outer(model.weights, np.ones(d)) / swing) / gain_of_reference
        printhead = Printhead(
            model.a0,
            model.a1,
            dynamics["b1"].value,
            (*(float(c) for c in coefficients[::-1]), 0.0),
            self.full_scale_V,
        )
        self._say_what_matters(printhead, choice, solution.converged)
        return Identification(
            printhead,
            dynamics,
            gains,
            dict(model.offsets),
            shape @ solution.covariance[:d, :d] @ shape.T,
            choice,
            self._hysteresis_source()[0].channel,
            self.noise,
            self._residuals(model),
            misfit,
            tuple(self.notes),
        )

    def _say_what_matters(self, printhead: Printhead, choice: DegreeChoice, converged: bool) -> None:
        if not converged:
            self.notes.append("The fit had not settled when it was stopped; its intervals mean little.")
        if not self.gauge:
            self.notes.append(
                "Without a strain-gauge recording the hysteresis was identified from the fast channels themselves."
            )
        if self.degree_given is None and choice.by_held_out not in (None, choice.by_flattening):
            self.notes.append(
                f"Degree {choice.by_flattening} by the flattening of the error, {choice.by_held_out} by held-out "
                f"drives; {len(printhead.coefficients) - 1} is used."
            )
        x = np.linspace(0.0, 1.0, 2001)
        negative = x[printhead.branch_law.curvature(x) < -1e-9]
        if negative.size:
            self.notes.append(
                f"p(r) is negative for x = |Δu|/{self.full_scale_V:g} V between {negative[0]:.3f} and "
                f"{negative[-1]:.3f}: not quite a valid Prandtl–Ishlinskii density."
            )
        partly = [m for m in self.all if 0 < m.fitted < m.drive_V.size]
        if partly:
            self.notes.append(
                f"Too few recordings to hold one out whole; the last quarter of {partly[0].names[0]} was held out."
            )

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


def _largest_change_V(measurement: Measurement) -> float:
    """The largest argument of the branch law, in volts; the virgin curve's is twice the drive."""
    swing = float(np.ptp(measurement.drive_V))
    if measurement.initial_state == "periodic":
        return swing
    return max(swing, 2 * float(np.abs(measurement.drive_V).max()))


def _pooled(values: Any) -> float:
    """Root of the mean square; NaN of nothing."""
    squares = [value**2 for value in values]
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan
