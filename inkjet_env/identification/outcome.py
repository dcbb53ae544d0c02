"""From a fit to its result: the printhead, its intervals, recordings beside the model, and caveats for the reader."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from inkjet_env.estimate import Estimate
from inkjet_env.identification.basis import drive_basis
from inkjet_env.identification.convention import conventional_swing
from inkjet_env.identification.covariance import Solution
from inkjet_env.identification.degree import F_QUANTILE_999
from inkjet_env.identification.errors import NothingRingsError, UnidentifiableError
from inkjet_env.identification.fit import SHARES, CampaignFit
from inkjet_env.identification.identification import Identification
from inkjet_env.identification.model import Model
from inkjet_env.identification.modelled_recording import ModelledRecording
from inkjet_env.identification.resonance import doubt_of_resonance
from inkjet_env.printhead import Printhead, QuasiStaticPrinthead
from inkjet_env.printhead.printhead import UNKNOWN_INTERVALS
from inkjet_env.typing import Real

QUANTILE_90 = 1.6448536269514722
"""Number of standard deviations about the mean that hold 90 % of a normal distribution."""
LARGEST_UNCERTAINTY = math.log(10)
"""Half width of the interval of ``ln a0`` or ``ln a1`` above which the resonator counts as not identified."""
SILENT = 33.0
"""Wald statistic of a law below which it may be zero: beyond the 99.9 % point of χ² for the highest degree, 12."""
NOTHING_RINGS = (
    "these recordings show no ringing. Record pulses with short edges, or a multisine about the resonance, sampled at "
    "ten times its frequency; `inkjet record --plan FOLDER` writes such drives."
)
"""End of the error sentence if no resonance is found."""
NO_DYNAMICS = (
    "a0, a1 and b1 cannot be known from these recordings: none shows the resonance. The hysteresis does not depend on "
    "them. To identify them, record pulses with short edges, or a multisine about the resonance, with self_sensing or "
    "a fast displacement sensor; `inkjet record --plan FOLDER` writes such drives."
)
"""Note of an identification from slow recordings alone."""


def outcome_of(fit: CampaignFit) -> Identification:
    """Identification from a solved fit.

    Raises
    ------
    UnidentifiableError
        A channel does not follow the drive, nothing rings though it could (then it is a `NothingRingsError`),
        or ``a0`` or ``a1`` is practically unknown.
    """
    law, d = fit.solution.model.weights, fit.solution.model.weights.size
    swing = _gain_of_reference(fit, fit.solution.model)
    coefficients = law / swing
    richer = fit.richer()
    gain = _gain_of_reference(fit, richer.model)
    model = replace(richer.model, weights=coefficients * gain)
    if _chi_square(fit, model) > fit.solution.chi_square + 2 * F_QUANTILE_999:
        # These recordings do not determine the swing of the law, only the product of law and gains.
        model, gain = fit.solution.model, swing
    gains = _gains(fit, model, richer, gain)
    descending = (*(float(c) for c in coefficients[::-1]), 0.0)
    printhead: Printhead
    if fit.fast:
        held_out = [m for m in fit.all if m.fast and not m.fitted and not m.still and m.noise_key in fit.noise]
        degree = model.weights.size
        fit.work.begin("checking the resonance", SHARES["check"])
        fast, unseen = fit.fitted(fit.fast, degree), fit.fitted(held_out, degree)
        if doubt := doubt_of_resonance(fast, unseen, model, fit.work.passed):
            raise NothingRingsError(f"{doubt}: {NOTHING_RINGS}")
    _check_gains(richer, fit.reference)
    if fit.fast:
        dynamics = _resonator(model, richer)
        a0 = dynamics["a0"]
        by_convention = Estimate(math.sqrt(a0.value), math.sqrt(a0.low), math.sqrt(a0.high))
        dynamics["b1"] = gains.get("self_sensing", by_convention)
        try:
            printhead = Printhead(model.a0, model.a1, dynamics["b1"].value, descending, fit.full_scale_V)
        except ValueError as error:
            raise NothingRingsError(f"the head that fits these recordings best is impossible: {error}") from None
    else:
        dynamics = {name: Estimate(math.nan, low, high) for name, (low, high) in UNKNOWN_INTERVALS.items()}
        printhead = QuasiStaticPrinthead(descending, fit.full_scale_V)
    shape = (np.eye(d) - np.outer(law, np.ones(d)) / law.sum()) / swing
    found = Identification(
        printhead,
        dynamics,
        gains,
        dict(model.offsets),
        shape @ fit.solution.covariance[:d, :d] @ shape.T,
        fit.alone,
        fit.joint,
        fit.noise,
        _modelled_recordings(fit, model),
        fit.misfit,
        (*fit.notes, *_notes(fit, printhead, gains)),
    )
    return replace(found, notes=(found.warning, *found.notes)) if found.warning else found


def _gain_of_reference(fit: CampaignFit, model: Model) -> float:
    """Ratio of the law's swing to that of the convention."""
    swing = float(model.weights.sum())
    if not math.isfinite(swing) or abs(swing) < 1e-12 * float(np.abs(model.weights).sum()):
        raise UnidentifiableError(f"channel {fit.reference} does not follow the drive at all; is its sensor connected?")
    return swing / conventional_swing(fit.full_scale_V)


def _chi_square(fit: CampaignFit, model: Model) -> float:
    """χ² of the whitened residuals of the fitted samples."""
    total = 0.0
    for f in fit.fitted(fit.train, model.weights.size):
        residuals = f.measurement.mean - model.predicted(f.measurement, f.basis, f.noise)
        total += float(np.sum(f.whitened(residuals[:, None]) ** 2))
    return total


def _gains(fit: CampaignFit, model: Model, richer: Solution, gain_of_reference: float) -> dict[str, Estimate]:
    """Gain of each channel in its unit, with the errors of the richer fit."""
    swings = np.array([float(name.startswith("w")) for name in richer.names])
    gains = {}
    for channel, ratio in model.ratios.items():
        gradient = ratio * swings / conventional_swing(fit.full_scale_V)
        if channel != fit.reference:
            gradient[richer.names.index(f"ratio {channel}")] = gain_of_reference
        value = ratio * gain_of_reference
        error = QUANTILE_90 * richer.error_of(gradient)
        gains[channel] = Estimate(value, value - error, value + error)
    return gains


def _check_gains(richer: Solution, reference: str) -> None:
    """Raise an error if a channel may as well not follow the drive: its gain, or the law times it, may be zero."""
    law = richer.model.weights
    silent = [reference] if _squared_distance_from_zero(law, richer.covariance[: law.size, : law.size]) < SILENT else []
    for channel, ratio in richer.model.ratios.items():
        if channel == reference:
            continue
        error = richer.error_of(np.eye(len(richer.names))[richer.names.index(f"ratio {channel}")])
        if abs(ratio) < QUANTILE_90 * error:
            silent.append(channel)
    if silent:
        raise UnidentifiableError(
            f"the gain of {' and '.join(silent)} cannot be told from zero. Check sensor and columns, or leave its "
            "recordings out."
        )


def _squared_distance_from_zero(values: Real, covariance: Real) -> float:
    """Wald's statistic ``θᵀ C⁻¹ θ`` of estimates that may be strongly correlated."""
    error = np.sqrt(np.diag(covariance))
    moved = error > 0
    if not moved.any():
        return math.inf if values.any() else 0.0
    variances, axes = np.linalg.eigh(covariance[np.ix_(moved, moved)] / np.outer(error[moved], error[moved]))
    along = axes.T @ (values[moved] / error[moved])
    return float(np.sum(along**2 / np.maximum(variances, 1e-12 * variances[-1])))


def _resonator(model: Model, richer: Solution) -> dict[str, Estimate]:
    """``a0`` in 1/s² and ``a1`` in 1/s, with the errors of the richer fit."""
    estimates = {}
    for name, value in (("a0", model.a0), ("a1", model.a1)):
        error = QUANTILE_90 * richer.error_of(np.eye(len(richer.names))[richer.names.index(f"ln {name}")])
        if not error < LARGEST_UNCERTAINTY:
            raise UnidentifiableError(
                f"{name} is not determined to within a factor of {math.exp(LARGEST_UNCERTAINTY):.0f}: " + NOTHING_RINGS
            )
        estimates[name] = Estimate(value, value * math.exp(-error), value * math.exp(error))
    return estimates


def _notes(fit: CampaignFit, printhead: Printhead, gains: Mapping[str, Estimate]) -> list[str]:
    """Caveats of the result for the reader, in sentences."""
    notes = []
    if not fit.fast:
        notes.append(NO_DYNAMICS)
        if "displacement" in gains:
            notes.append(
                "The displacement recordings show no resonance: displacement was taken as a gain times "
                "the hysteretic drive plus an offset."
            )
    elif "self_sensing" not in gains:
        notes.append(
            "b1, the gain of self-sensing, is not observable without a self_sensing recording. By convention it "
            "was set to √a0: the signal is then the deflection's velocity divided by √a0, in hysteretic volts."
        )
    if not fit.solution.converged:
        notes.append("The fit did not converge; its intervals are unreliable.")
    chosen = {"all recordings": fit.joint.by_flattening}
    if fit.gauge and (fit.fast or len(gains) > 1):
        chosen[f"{'the strain gauge' if fit.reference == 'strain_gauge' else fit.reference} alone"] = (
            fit.alone.by_flattening
        )
    elif fit.fast:
        notes.append(
            "Without a strain-gauge recording the hysteresis was identified from the fast channels themselves."
        )
    if fit.alone.by_held_out is not None:
        chosen["drives left out in turn"] = fit.alone.by_held_out
    if fit.degree_given is None and len(set(chosen.values())) > 1:
        words = ", ".join(f"{degree} from {source}" for source, degree in chosen.items())
        notes.append(f"The estimates of the degree differ: {words}; {len(printhead.coefficients) - 1} is used.")
    if fit.solution.held:
        notes.append("The constraint p(r) ≥ 0 is active: without it the density would be negative in places.")
    x = np.linspace(0.0, 1.0, 2001)
    negative = x[printhead.branch_law.curvature(x) < -1e-9]
    if negative.size:
        notes.append(
            f"p(r) is negative for x = |Δu|/{fit.full_scale_V:g} V between {negative[0]:.3f} and "
            f"{negative[-1]:.3f}; this is not a valid Prandtl–Ishlinskii density."
        )
    partly = [m for m in fit.all if 0 < m.fitted < m.drive_V.size]
    if partly:
        names = " and ".join(partly[0].names)
        notes.append(f"There are too few recordings to hold out a whole one; the last quarter of {names} was held out.")
    elif all(m.fitted for m in fit.all if m.fast or not fit.fast):
        which = "fast recording" if fit.fast else "recording"
        notes.append(f"No {which} was held out, so the prediction of other recordings was not tested.")
    return notes


def _modelled_recordings(fit: CampaignFit, model: Model) -> tuple[ModelledRecording, ...]:
    """Every recording of the modelled channels beside its simulation, sorted by name."""
    rows: list[ModelledRecording] = []
    for m in fit.all:
        if m.channel not in model.ratios:
            continue
        basis = drive_basis(m.drive_V, m.step_s, fit.full_scale_V, model.weights.size, m.initial_state)
        modelled = model.predicted(m, basis)
        rms = fit.noise[m.noise_key].rms if m.noise_key in fit.noise else math.nan
        rows.extend(
            ModelledRecording(
                name=name,
                channel=m.channel,
                unit=m.unit,
                order=fit.orders[name],
                step_s=m.step_s,
                drive_V=m.drive_V,
                measured=signal,
                modelled={"base": modelled},
                fitted=m.fitted,
                noise_rms=rms,
            )
            for name, signal in zip(m.names, m.signals, strict=True)
        )
    return tuple(sorted(rows, key=lambda r: r.name))
