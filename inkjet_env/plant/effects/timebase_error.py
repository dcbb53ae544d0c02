"""A recorder whose sample clock runs fast or slow: the time axis of every recording is stretched."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.wording import percent
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

SIZES = (1e-4, 1e-3, 5e-3)
"""Relative errors of the starts, of either sign."""
MEMORY = 8.0
"""Recordings in which a clock warms up, in the starts."""


class TimebaseError(Effect):
    """Samples that are taken later and later, or earlier and earlier, than recorded, from the trigger on.

    The signal between samples is that of cubics through four of them. After the end of a drive that does not repeat it
    holds its last value.
    """

    id = "timebase_error"
    stage = "sensing"
    sentence = "The recorder's clock runs at another rate than the generator's, so recordings are stretched in time."
    equation = "y(t) = y₀((1 + skew + cold exp(-(order - 1) / memory_orders)) t), t since the trigger"
    source = "IEEE Standard 1057-2017 for Digitizing Waveform Recorders: time base errors"
    parameters = (
        Parameter(
            "skew", "1", -0.02, 0.02, meaning="relative excess of the true time between samples over the recorded"
        ),
        Parameter("cold", "1", -0.02, 0.02, meaning="further excess at the first recording, while the clock is cold"),
        Parameter(
            "memory_orders",
            "1",
            0.3,
            1e4,
            "log",
            "recordings in which the clock warms up",
            open_ended=True,
            plain=MEMORY,
        ),
    )
    strengths = ("skew", "cold")
    depends_on_order = True
    signature = (
        "responses come later, or earlier, in proportion to the time since the trigger, with the drive's edges too"
    )
    confusable_with = ("trigger_delay", "slew_limit")
    shown_by = "the same pulse early and late in one long recording"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        off = {"skew": 0.0, "cold": 0.0, "memory_orders": MEMORY}
        warms = len({s.order for s in excitations if s.channel != "drive_monitor"}) > 1
        names = ("skew", "cold") if warms else ("skew",)
        return [off | {name: sign * size} for name in names for size in SIZES for sign in (1, -1)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"skew": 2e-3, "cold": 5e-4, "memory_orders": MEMORY}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        moves = any(np.ptp(s.drive_V) > 0 and s.channel != "drive_monitor" for s in excitations)
        return None if moves else "no recording has a drive that changes"

    def description(self, values: Values, unit: str = "V") -> str:
        skew, first = values["skew"], values["skew"] + values["cold"]
        if not values["cold"]:
            return f"The recorder's clock runs {_rate(skew)} against the generator's."
        return (
            f"Against the generator's the recorder's clock runs {_rate(first)} at first, and {_rate(skew)} once it is "
            f"warm, after {values['memory_orders']:.2g} recordings or so."
        )

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        skew = values["skew"] + values["cold"] * math.exp(-(excitation.order - 1) / values["memory_orders"])
        if skew == 0:
            return signal
        places: Real = np.float64(1 + skew) * np.arange(signal.size, dtype=np.float64)
        return resampled(signal, places, excitation.periodic)


def _rate(skew: float) -> str:
    return f"{percent(abs(skew), 3)} {'slow' if skew > 0 else 'fast'}" if skew else "right"


def resampled(signal: Real, places: Real, periodic: bool) -> Real:
    """The signal between its samples, by Lagrange's cubics through four of them, shape of ``places``.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Signal at the samples.
    places : ndarray
        Where it is wanted, in samples from the first.
    periodic : bool
        Whether the sample after the last is the first; otherwise the signal is held at its ends.
    """
    whole = np.floor(places).astype(np.int64)
    t = places - whole
    index = whole[:, None] + np.arange(-1, 3)
    around = signal[index % signal.size if periodic else np.clip(index, 0, signal.size - 1)]
    weights = np.stack(
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ],
        axis=1,
    )
    result: Real = np.sum(weights * around, axis=1)
    return result
