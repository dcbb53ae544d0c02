"""State of *Waveform*: the drive, its history, the pinned ones, how it is fired and judged, and the driver's limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from inkjet_env.experiments.explore.curves import Conditions
from inkjet_env.experiments.explore.drives import (
    PUBLISHED_BEST,
    Corners,
    Drive,
    drive_json,
    drive_of,
    moved_corner,
)
from inkjet_env.jetting.scans import Curve
from inkjet_env.printhead import Bounds, DriverLimits, PeakCost, Waveform

MOST_UNDONE = 100
"""Largest number of changes that can be undone."""
MOST_PINNED = 5
"""Largest number of pinned waveforms: one colour each."""


@dataclass(frozen=True)
class Pinned:
    """A waveform kept for comparison.

    Attributes
    ----------
    name : str
        Its name in the legend.
    drive : Waveform or Corners
        The drive.
    """

    name: str
    drive: Drive


class WaveformState:
    """The drive that is edited, and what belongs to it.

    A gesture, such as dragging a slider, makes many changes and is undone as one: it lasts until `settle`.

    Attributes
    ----------
    drive : Waveform or Corners
        The drive.
    conditions : Conditions
        Cost, window and drop frequency.
    limits : DriverLimits
        What the driver can do.
    pinned : list of Pinned
        Waveforms that are compared.
    scanned : tuple of (object, Curve) or None
        The last scan of the first dwell: what it was made for, and what it found.
    settled : bool
        Whether no gesture is going on.
    """

    def __init__(self) -> None:
        self.drive: Drive = Waveform.from_array(PUBLISHED_BEST)
        self.conditions = Conditions()
        self.limits = DriverLimits()
        self.pinned: list[Pinned] = []
        self.scanned: tuple[Any, Curve] | None = None
        self._earlier: list[Drive] = []
        self.settled = True
        self._named = 0

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to undo."""
        return bool(self._earlier)

    def change(self, drive: Drive, settled: bool = True) -> None:
        """Replace the drive; ``settled`` ends the gesture.

        Raises
        ------
        ValueError
            The drive does not fit into the period between drops.
        """
        if drive.duration_s * self.conditions.drop_frequency_Hz > 1 + 1e-9:
            raise ValueError(
                f"a drive of {1e6 * drive.duration_s:.4g} µs does not fit into the "
                f"{1e6 * self.conditions.period_s:.4g} µs between drops. Lower the drop frequency first."
            )
        if drive != self.drive:
            if self.settled:
                self._earlier = [*self._earlier[1 - MOST_UNDONE :], self.drive]
                self.settled = False
            self.drive = drive
        if settled:
            self.settle()

    def change_parameter(self, k: int, value: float, settled: bool = True) -> None:
        """Change one of ``U1 U2 t1 t2 t3 t4 t5``, in volts or seconds."""
        if isinstance(self.drive, Corners):
            raise ValueError("a drive of segments has no seven parameters; drag its corners.")
        values = self.drive.to_array()
        values[k] = value
        self.change(Waveform.from_array(values), settled)

    def drag(self, corner: int, time_s: float, drive_V: float) -> None:
        """Move a corner; `settle` ends the gesture."""
        moved = moved_corner(self.drive, corner, time_s, drive_V)
        if moved.duration_s * self.conditions.drop_frequency_Hz <= 1 + 1e-9:  # otherwise the corner stops there
            self.change(moved, settled=False)

    def settle(self) -> None:
        """End a gesture: the next change is undone on its own."""
        self.settled = True

    def undo(self) -> None:
        """Go back to the drive before the last gesture."""
        if self._earlier:
            self.drive = self._earlier.pop()
            limit_Hz = 1 / self.drive.duration_s if self.drive.duration_s else math.inf
            if self.conditions.drop_frequency_Hz > limit_Hz * (1 + 1e-9):
                self.conditions = replace(self.conditions, drop_frequency_Hz=0.0)
        self.settle()

    def set_drop_frequency(self, frequency_Hz: float) -> None:
        """Fire at a rate, at most as fast as the drive allows; 0: drops are far apart."""
        if not (math.isfinite(frequency_Hz) and frequency_Hz >= 0):
            raise ValueError(f"the drop frequency must be at least 0 Hz; got {frequency_Hz:g}.")
        highest_Hz = 1 / self.drive.duration_s if self.drive.duration_s else math.inf
        self.conditions = replace(self.conditions, drop_frequency_Hz=min(frequency_Hz, highest_Hz))

    def set_cost(self, cost: PeakCost) -> None:
        """Judge by another cost."""
        self.conditions = replace(self.conditions, cost=cost)

    def make_legal(self) -> None:
        """Replace the waveform by the one that the driver can do."""
        if isinstance(self.drive, Corners):
            raise ValueError("only a waveform of seven parameters can be made legal; drag the corners of this drive.")
        longest_s = max(40e-6, *self.drive.to_array()[2:])
        largest_V = max(150.0, self.drive.U1, -self.drive.U2)
        box = Bounds((0.0, -largest_V, *[0.0] * 5), (largest_V, 0.0, *[longest_s] * 5), self.limits)
        self.change(Waveform.from_array(box.legal(self.drive.to_array())))

    def excesses(self) -> list[str]:
        """Where the drive asks for more than the driver can, in sentences without a subject."""
        return self.limits.excesses(*self.drive.knots())

    def pin(self) -> None:
        """Keep the drive for comparison; the oldest makes room."""
        self._named += 1
        self.pinned = [*self.pinned[1 - MOST_PINNED :], Pinned(f"pin {self._named}", self.drive)]

    def unpin(self, name: str) -> None:
        """Drop a pinned waveform."""
        self.pinned = [one for one in self.pinned if one.name != name]

    def take(self, name: str) -> None:
        """Edit a pinned waveform."""
        for one in self.pinned:
            if one.name == name:
                self.change(one.drive)

    def as_json(self) -> dict[str, Any]:
        """The state as plain JSON values."""
        cost = self.conditions.cost
        return {
            "drive": drive_json(self.drive),
            "history": [drive_json(one) for one in self._earlier],
            "pinned": [{"name": one.name} | drive_json(one.drive) | {"name": one.name} for one in self.pinned],
            "drop_frequency_Hz": self.conditions.drop_frequency_Hz,
            "window_s": self.conditions.window_s,
            "cost": {
                "A": cost.A,
                "B": cost.B,
                "effective": cost.effective,
                "target_height_V": None if math.isinf(cost.target_height_V) else cost.target_height_V,
            },
            "limits": self.limits.as_json(),
            "named": self._named,
        }

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> WaveformState:
        """The state that `as_json` wrote; ``ValueError``, ``KeyError`` or ``TypeError`` if it did not."""
        found, cost = cls(), stored["cost"]
        target_V = math.inf if cost["target_height_V"] is None else cost["target_height_V"]
        judged = PeakCost(cost["A"], cost["B"], cost["effective"], target_V)
        found.conditions = Conditions(judged, float(stored["window_s"]), float(stored["drop_frequency_Hz"]))
        found.drive = drive_of(stored["drive"])
        found._earlier = [drive_of(one) for one in stored["history"]][-MOST_UNDONE:]
        found.pinned = [Pinned(str(one["name"]), drive_of(one)) for one in stored["pinned"]][-MOST_PINNED:]
        found.limits = DriverLimits.from_values(stored["limits"])
        found._named = int(stored["named"])
        return found
