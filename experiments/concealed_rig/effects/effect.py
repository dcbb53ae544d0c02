"""What an effect is to the plant: one hook a stage, each of which leaves the base plant as it is."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.head import Head
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.resonator import Motion, Resonator


@dataclass(frozen=True)
class PlaySettings:
    """How the play operators of the base hysteresis are changed; see `play.changing_play_sum_V`."""

    threshold_growth_V: float = 0.0
    weight_growth: float = 0.0
    rate_V_per_s: float = 1.0
    rate_time_s: float = 1e-6
    skew: float = 0.0
    relaxation_s: float = 0.0
    rate_power: float = 0.0


@dataclass(frozen=True)
class Situation:
    """What an effect may know of the plant on which it is drawn.

    Parameters
    ----------
    head : Head
    last_order : int
        Number of recordings in the campaign.
    meagre : bool
        Only fast recordings of self-sensing.
    sigma : dict
        Standard deviation of the noise, by channel.
    largest_V : float
        Largest noise-free self-sensing signal of the base plant.
    largest_deflection_V : float
        Largest deflection of the base plant's resonator.
    largest_speed_V : float
        Largest speed of it, over ω₀.
    steepest_V_per_s : float
        Steepest edge of the fast recordings.
    lowest_V, mean_square_speed_V2 : tuple of float
        By order: the lowest voltage of a recording, and the mean square of the resonator's speed (0 where it rests).
    """

    head: Head
    last_order: int
    meagre: bool
    sigma: dict[str, float]
    largest_V: float
    largest_deflection_V: float
    largest_speed_V: float
    steepest_V_per_s: float
    lowest_V: tuple[float, ...] = (0.0,)
    mean_square_speed_V2: tuple[float, ...] = (0.0,)


@dataclass(frozen=True)
class Effect:
    """One concealed effect in one variant.

    Parameters
    ----------
    strength : float
        What is solved for; 0 is the base plant.
    variant : str
    """

    id: ClassVar[str] = ""
    stage: ClassVar[str] = ""
    by_chance: ClassVar[bool] = False  # its strength is the plain RMS of what is added
    weakest: ClassVar[float] = 1e-9
    start: ClassVar[float] = 1e-2
    strongest: ClassVar[float] = 1.0

    strength: float = 0.0
    variant: str = field(default="", kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "Effect":
        """A variant with its shape drawn, of strength 0."""
        raise NotImplementedError(f"{cls.__name__} says no way to draw it")

    @property
    def fastest_Hz(self) -> float:
        """Frequency at which the drive rings, or bends, between the samples; 0: it does not."""
        return 0.0

    def on_drive(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Drive before it reaches the ceramic, at the half steps."""
        return drive_V

    def on_hysteresis_input(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Voltage as the ceramic's domains see it, at the half steps."""
        return drive_V

    def on_plays(self, settings: PlaySettings) -> PlaySettings:
        """How the plays are changed."""
        return settings

    def on_hysteretic(self, hysteretic_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Hysteretic drive at the half steps."""
        return hysteretic_V

    def on_poled(self, hysteretic_V: np.ndarray, applied_V: np.ndarray, grid: Grid, order: int) -> np.ndarray:
        """Hysteretic drive at the half steps, of a ceramic whose poling follows the voltage or the campaign."""
        return hysteretic_V

    def on_resonator(self, resonator: Resonator, order: int) -> Resonator:
        """Parameters of the equation of motion at this point of the campaign."""
        return resonator

    def on_motion(
        self, motion: Motion, hysteretic_V: np.ndarray, resonator: Resonator, grid: Grid, order: int
    ) -> Motion:
        """Motion that the sensor sees, at the steps; `hysteretic_V` at the half steps."""
        return motion

    def on_sensor(self, signal: np.ndarray, applied_V: np.ndarray, measurement: Measurement, grid: Grid) -> np.ndarray:
        """Sensor's signal at the steps, its offset included; `applied_V` at the half steps."""
        return signal

    def added(
        self, signal: np.ndarray, slope: np.ndarray, measurement: Measurement, rng: np.random.Generator
    ) -> np.ndarray:
        """What chance adds at the samples to a noise-free `signal` whose slope a second is `slope`."""
        return np.zeros_like(signal)

    def on_recorded(self, recorded: np.ndarray, measurement: Measurement) -> np.ndarray:
        """Samples as the converter gives them, noise included."""
        return recorded

    def parameters(self) -> dict[str, Any]:
        """Physical parameters by name with unit."""
        return {}
