"""The plant: drive → hysteresis → resonator → sensing, with whatever is concealed in each stage."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from experiments.concealed_rig.effects.effect import Effect, PlaySettings
from experiments.concealed_rig.grid import Grid, grid_of
from experiments.concealed_rig.head import Head
from experiments.concealed_rig.linear import linear_motion
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.other_hysteresis import (
    bouc_wen,
    bouc_wen_opening,
    plays_opening_V,
    preisach_opening,
    product_preisach,
)
from experiments.concealed_rig.play import changing_play_sum_V, play_sum_V, smooth_play_sum_V
from experiments.concealed_rig.resonator import Motion, Resonator, motion

# A drive that rings takes this share of the resonator's steps a period, 16 half steps: plays hear its peaks to 5e-4.
RINGING_SHARE = 0.05
SMOOTH_POINTS = 10  # half steps in a period of the ringing with which a parabola goes through its peaks


@dataclass(frozen=True)
class Hysteresis:
    """Which law stands in the place of the head's plays.

    Parameters
    ----------
    law : str
        "plays", "bouc_wen" or "preisach".
    share : float
        Of the other law; the rest are the plays.
    scale_V : float
        Voltage over which the other law saturates.
    order, beta : float
        Of Bouc–Wen.
    """

    law: str = "plays"
    share: float = 1.0
    scale_V: float = 60.0
    order: float = 1.5
    beta: float = 0.6


@dataclass(frozen=True)
class Plant:
    """A printhead with effects.

    Parameters
    ----------
    head : Head
    effects : tuple of Effect
        Empty: the base plant.
    hysteresis : Hysteresis
    steps_per_period : int
        Steps of the integrator in a period of the fastest motion.
    """

    head: Head
    effects: tuple[Effect, ...] = ()
    hysteresis: Hysteresis = Hysteresis()
    steps_per_period: int = 160


@dataclass(frozen=True)
class Trace:
    """What went on in one recording: the voltage at the head, the hysteretic drive (samples) and the clean signal.

    Parameters
    ----------
    signal, applied_V, slope : ndarray, shape (n,)
        Noise-free sensor signal, applied voltage, and the signal's slope a second.
    largest_deflection_V, largest_speed_V, mean_square_speed_V2 : float
    """

    signal: np.ndarray
    applied_V: np.ndarray
    slope: np.ndarray
    largest_deflection_V: float
    largest_speed_V: float
    mean_square_speed_V2: float = 0.0


def _measure_of_rate(drive_V: np.ndarray, grid: Grid, settings: PlaySettings) -> np.ndarray:
    """lg(1 + |dU/dt|/rate), or a power of it, after a relaxation, at the half steps; constant between them."""
    rate = np.abs(np.diff(drive_V)) / grid.half_s / settings.rate_V_per_s
    rate = rate**settings.rate_power if settings.rate_power else np.log10(1 + rate)
    keep = np.exp(-grid.half_s / settings.rate_time_s)
    laps = 2 if grid.periodic else 1
    relaxed = lfilter([1 - keep], [1, -keep], np.tile(rate, laps))[-rate.size :]
    return np.concatenate(([relaxed[-1] if grid.periodic else 0.0], relaxed))


def _plays_V(head: Head, drive_V: np.ndarray, grid: Grid, settings: PlaySettings, smooth: bool) -> np.ndarray:
    threshold, weight = head.plays()
    if settings == PlaySettings():
        summed = smooth_play_sum_V if smooth else play_sum_V
        return summed(drive_V, threshold, weight, grid.periodic)
    rate = None
    if settings.threshold_growth_V or settings.weight_growth:
        rate = _measure_of_rate(drive_V, grid, settings)
    return changing_play_sum_V(
        drive_V,
        threshold,
        weight,
        grid.periodic,
        rate=rate,
        threshold_growth_V=settings.threshold_growth_V,
        weight_growth=settings.weight_growth,
        skew=settings.skew,
        relaxation_points=settings.relaxation_s / grid.half_s,
    )


def _other_law_V(head: Head, drive_V: np.ndarray, grid: Grid, hysteresis: Hysteresis) -> np.ndarray:
    opening = plays_opening_V(head)
    if hysteresis.law == "bouc_wen":
        scale, order, beta = hysteresis.scale_V, hysteresis.order, hysteresis.beta
        amplitude = opening / bouc_wen_opening(scale, order, beta)
        return amplitude * (drive_V / scale - bouc_wen(drive_V, grid.periodic, scale, order, beta))
    if hysteresis.law == "preisach":
        warped = hysteresis.scale_V * np.tanh(drive_V / hysteresis.scale_V)
        return opening / preisach_opening(hysteresis.scale_V) * product_preisach(warped, grid.periodic)
    raise ValueError(f'law must be "plays", "bouc_wen" or "preisach"; got {hysteresis.law!r}.')


def fastest_drive_Hz(plant: Plant) -> float:
    """The highest frequency at which the drive rings, or bends, between the samples; 0: it does not."""
    return max((effect.fastest_Hz for effect in plant.effects), default=0.0)


def hysteretic_V(plant: Plant, applied_V: np.ndarray, grid: Grid, order: int = 1) -> np.ndarray:
    """Hysteretic drive at the half steps, shape (2·steps + 1,), of the voltage at the head."""
    seen, settings = applied_V, PlaySettings()
    for effect in plant.effects:
        seen, settings = effect.on_hysteresis_input(seen, grid), effect.on_plays(settings)
    law = plant.hysteresis
    smooth = 0 < fastest_drive_Hz(plant) * grid.half_s <= 1 / SMOOTH_POINTS
    plays = 0.0 if law.law != "plays" and law.share == 1.0 else _plays_V(plant.head, seen, grid, settings, smooth)
    if law.law != "plays":
        plays = (1 - law.share) * plays + law.share * _other_law_V(plant.head, seen, grid, law)
    hysteretic = plant.head.reversible * seen + plays
    for effect in plant.effects:
        hysteretic = effect.on_poled(effect.on_hysteretic(hysteretic, grid), applied_V, grid, order)
    return hysteretic


def resonator_of(plant: Plant, order: int) -> Resonator:
    """Equation of motion at this point of the campaign."""
    resonator = Resonator(plant.head.angular_rad_per_s, plant.head.damping_ratio)
    for effect in plant.effects:
        resonator = effect.on_resonator(resonator, order)
    return resonator


def _motion(plant: Plant, hysteretic: np.ndarray, applied: np.ndarray, grid: Grid, order: int) -> Motion:
    resonator = resonator_of(plant, order)
    if resonator == Resonator(resonator.angular_rad_per_s, resonator.damping_ratio):
        moved = Motion(*linear_motion(resonator.angular_rad_per_s, resonator.damping_ratio, hysteretic, grid))
    else:
        moved = motion(resonator, hysteretic, applied, grid)
    for effect in plant.effects:
        moved = effect.on_motion(moved, hysteretic, resonator, grid, order)
    return moved


def trace(plant: Plant, measurement: Measurement) -> Trace:
    """Noise-free signal of one recording, with what led to it.

    Parameters
    ----------
    plant : Plant
    measurement : Measurement

    Raises
    ------
    FloatingPointError
        Where the motion diverges or does not settle.
    """
    head = plant.head
    resonator = resonator_of(plant, measurement.order)
    slow = measurement.channel == "strain_gauge"
    grid = grid_of(
        measurement.drive_V.size,
        measurement.step_s,
        measurement.periodic,
        0.0 if slow else max(resonator.fastest_Hz, RINGING_SHARE * fastest_drive_Hz(plant)),
        plant.steps_per_period,
    )
    applied = grid.halves(measurement.drive_V)
    for effect in plant.effects:
        applied = effect.on_drive(applied, grid)
    hysteretic = hysteretic_V(plant, applied, grid, measurement.order)
    deflection = speed = power = 0.0
    if slow:
        signal = head.gauge_gain_V_per_V * hysteretic[::2] + head.gauge_offset_V
    else:
        moved = _motion(plant, hysteretic, applied, grid, measurement.order)
        deflection, speed = float(np.max(np.abs(moved.deflection_V))), float(np.max(np.abs(moved.speed_V)))
        power = float(np.mean(moved.speed_V**2))
        if measurement.channel == "self_sensing":
            signal = head.b1_per_s / head.angular_rad_per_s * moved.speed_V + head.self_sensing_offset_V
        else:
            signal = head.displacement_nm_per_V * moved.deflection_V + head.displacement_offset_nm
    for effect in plant.effects:
        signal = effect.on_sensor(signal, applied, measurement, grid)
    return Trace(
        signal=grid.at_samples(signal),
        applied_V=grid.at_samples(applied[::2]),
        slope=grid.at_samples(np.gradient(signal, grid.step_s)),
        largest_deflection_V=deflection,
        largest_speed_V=speed,
        mean_square_speed_V2=power,
    )


def noise_free(plant: Plant, measurement: Measurement) -> np.ndarray:
    """Noise-free sensor signal at the samples, shape (n,)."""
    return trace(plant, measurement).signal
