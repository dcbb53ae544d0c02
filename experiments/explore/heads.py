"""The heads that can be chosen: published, and read from printhead files, with their intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from inkjet_env.experiments.explore.curves import Head
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.printhead_json import printhead_data

PUBLISHED = "published"
MOST_HEADS = 8
"""Largest number of heads side by side."""


@dataclass(frozen=True, eq=False)
class NamedHead:
    """A head by its name.

    Attributes
    ----------
    name : str
        Name in lists and legends; text, never markup.
    head : Printhead or AugmentedPrinthead
        The head.
    path : Path or None
        The file from which it was read; None for the published head.
    data : mapping
        Content of that file.
    """

    name: str
    head: Head
    path: Path | None = None
    data: Mapping[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """What the head is: published, identified (base model) or corrected (with effects)."""
        if self.path is None:
            return "published"
        return "corrected" if isinstance(self.head, AugmentedPrinthead) else "identified"

    def rows(self) -> list[tuple[str, float, float | None, float | None, str]]:
        """Parameters with value, ends of their 90 % interval where it is known, and unit."""
        found = []
        dynamics = self.data.get("dynamics") or {}
        base = self.head.printhead if isinstance(self.head, AugmentedPrinthead) else self.head
        for name, value, unit in (("a0", base.a0, "1/s²"), ("a1", base.a1, "1/s"), ("b1", base.b1, "1/s")):
            found.append((name, value, *_interval(dynamics.get(name), value), unit))
        for entry in self.data.get("effects") or []:
            for name, told in entry["parameters"].items():
                value = told["value"]
                unit = str(told.get("unit", ""))
                label = f"{entry['id']}: {name.removesuffix(f'_{unit}')}".replace("_", " ")
                if value is not None:
                    found.append((label, float(value), *_interval(told, value), "" if unit == "1" else unit))
        return found


def _interval(told: Any, value: float) -> tuple[float | None, float | None]:
    """Ends of an interval; None where there is none, or only the value itself."""
    low, high = (told.get("low"), told.get("high")) if isinstance(told, dict) else (None, None)
    return (None, None) if low == high == value else (low, high)


class HeadShelf:
    """The heads, and the one that is used.

    Attributes
    ----------
    heads : dict of str to NamedHead
        By name; the published one first.
    chosen : str
        Name of the one that is used.
    """

    def __init__(self) -> None:
        self.heads = {PUBLISHED: NamedHead(PUBLISHED, Printhead.published())}
        self.chosen = PUBLISHED

    @property
    def head(self) -> NamedHead:
        """The head that is used."""
        return self.heads[self.chosen]

    def add(self, path: Path, name: str | None = None) -> NamedHead:
        """Add the head of a printhead file; a file that is there already is read again.

        Raises
        ------
        ValueError
            The file is no printhead, its resonance is unknown, or there are too many heads.
        """
        head = read_printhead(path)
        if not head.has_dynamics:
            raise ValueError(
                f"{path}: nothing is known of this head's resonance, so no response can be simulated. Record pulses "
                "with a fast sensor and identify it again."
            )
        path = path.resolve()
        same = next((one.name for one in self.heads.values() if one.path == path), None)
        if same is None and len(self.heads) >= MOST_HEADS:
            raise ValueError(f"{path}: there are {MOST_HEADS} heads already. Start again without one of them.")
        label = same or self._unused(name or path.stem)
        self.heads[label] = NamedHead(label, head, path, printhead_data(path))
        return self.heads[label]

    def choose(self, name: str) -> None:
        """Use a head."""
        if name not in self.heads:
            raise ValueError(f"there is no head {name[:40]!r}; there are {', '.join(self.heads)}.")
        self.chosen = name

    def _unused(self, name: str) -> str:
        number, label = 1, name
        while label in self.heads:
            number += 1
            label = f"{name} {number}"
        return label
