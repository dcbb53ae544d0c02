"""Interference at a fixed frequency that is not locked to the trigger."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.wording import SENSOR_UNIT, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

MAINS_HZ = (50.0, 60.0, 100.0, 120.0, 150.0)
"""Mains frequencies and their multiples at which a search starts, in hertz."""
MOST_STARTS = 12
"""Largest number of starting frequencies, for a pure tone and for one with multiples."""
MULTIPLES = 5
"""Number of multiples in the starts with multiples, the tone included."""
FASTEST = 2.0
"""Periods per sample of the fastest tone that a recording may show; a slow instrument does not follow faster ones."""
MOST_IMAGES = 3
"""Largest number of lines for which a search starts at their images as well."""
LEAST_OWN = 1e-3
"""Smallest share of a wave that is independent of the waves before it, relative to its size."""


class MainsHum(Effect):
    """A tone, and multiples of it, whose amplitudes and phases differ from recording to recording.

    It explains recordings, but no simulation predicts it. A recording with fewer than two samples per period shows it
    at another frequency, one that is sampled far more slowly shows nothing of it.
    """

    id = "mains_hum"
    stage = "sensing"
    sentence = "The recordings contain interference at a fixed frequency that is not locked to the trigger."
    equation = "y = y₀ + Σₖ aₖ cos 2πkft + bₖ sin 2πkft, with separate a and b for each recording"
    source = "Ott, Electromagnetic Compatibility Engineering, Wiley, 2009: pick-up of the mains and its harmonics"
    parameters = (
        Parameter("frequency_Hz", "Hz", 0.01, 1e8, "log", "frequency of the tone"),
        Parameter("multiples", "1", 1.0, 20.0, "linear", "number of multiples; 1 is the tone alone", True),
        Parameter("amplitude", SENSOR_UNIT, 0.0, 1e6, "linear", "amplitude of the tone; 0 is none"),
    )
    strengths = ("amplitude",)
    signature = "present with zero drive; its phase differs between recordings, so repeats differ by it"
    confusable_with = ("baseline_drift",)
    shown_by = "zero drive over several periods of the mains"
    random = True

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        seen = [line for excitation in excitations for line in excitation.residual_lines_Hz]
        usual = [f for f in MAINS_HZ if any(_shows(excitation, f) for excitation in excitations)]
        longest_s = max((excitation.samples * excitation.step_s for excitation in excitations), default=1.0)
        guesses: list[float] = []
        for frequency in (*seen, *usual, *(periods / longest_s for periods in (3, 10))):
            if all(abs(frequency - other) * longest_s > 0.5 for other in guesses):
                guesses.append(frequency)
        found = [
            {"frequency_Hz": f, "multiples": float(multiples), "amplitude": 1.0}
            for multiples in (1, MULTIPLES)
            for f in guesses[:MOST_STARTS]
        ]
        images = _images_Hz(seen[:MOST_IMAGES], excitations)
        return [*found, *({"frequency_Hz": f, "multiples": 1.0, "amplitude": 1.0} for f in images)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"frequency_Hz": 0.9 * printhead.frequency_Hz, "multiples": 1.0, "amplitude": 2.0 * noise_rms}

    def description(self, values: Values, unit: str = "V") -> str:
        return (
            f"The recordings contain interference at {with_prefix(values['frequency_Hz'], 'Hz', 3)}"
            f"{' and its multiples' if values['multiples'] > 1 else ''} that is not locked to the trigger; it amounts "
            f"to about {with_prefix(values['amplitude'], unit)}."
        )

    def random_effect_basis(self, values: Values, excitation: Excitation) -> Real | None:
        frequency = values["frequency_Hz"]
        heard = range(1, min(round(values["multiples"]), int(FASTEST / (frequency * excitation.step_s))) + 1)
        if values["amplitude"] == 0 or excitation.channel == "drive_monitor" or not heard:
            return None
        angle = 2 * np.pi * frequency * excitation.step_s * np.arange(excitation.samples)
        waves = np.column_stack([wave(k * angle) for k in heard for wave in (np.cos, np.sin)])
        # With fewer than two samples per period, one wave may look like another, or like none.
        own = np.zeros(waves.shape[1])
        own[: excitation.samples] = np.abs(np.diag(np.linalg.qr(waves, mode="r")))
        return waves[:, own > LEAST_OWN * np.sqrt(excitation.samples)]

    def random_amplitudes(self, count: int, rng: np.random.Generator) -> Real:
        """Random amplitudes, shape (count,), a vector of length 1: equally loud in every recording, in any phase."""
        drawn: Real = rng.standard_normal(count)
        return drawn / np.float64(np.linalg.norm(drawn))


def _shows(excitation: Excitation, frequency_Hz: float) -> bool:
    """Whether a recording has more than two samples per period and lasts at least half a period."""
    return frequency_Hz * excitation.step_s < 0.5 <= frequency_Hz * excitation.step_s * excitation.samples


def _images_Hz(lines_Hz: Sequence[float], excitations: Sequence[Excitation]) -> list[float]:
    """Faster tones that look like these lines at one of the sampling rates, if others tell them apart, in hertz."""
    rates_Hz = sorted({1 / excitation.step_s for excitation in excitations})
    if len(rates_Hz) < 2:
        return []
    found: list[float] = []
    for line in lines_Hz:
        for rate in (rates_Hz[0], rates_Hz[-1]):
            images = [image for image in (rate - line, rate + line, 2 * rate - line) if image > rate / 2]
            found += [image for image in images if all(abs(image - other) > 1e-9 * image for other in found)]
    return found
