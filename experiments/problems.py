"""The problems that optimisers are compared on, each with the best waveform known."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import printhead_of, read_printhead
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform
from inkjet_env.printhead.naming import check_name

BEST_KNOWN_FILE = "best_known.json"


@dataclass(frozen=True)
class BestKnown:
    """The best waveform that a long search found for a problem.

    Parameters
    ----------
    cost : float
        In volts.
    waveform : tuple of 7 floats
        ``U1 U2`` in volts, ``t1 … t5`` in seconds.
    found_by : str
        How the search was made, in words.
    """

    cost: float
    waveform: tuple[float, ...]
    found_by: str


@dataclass(frozen=True)
class Problem:
    """One minimisation over ``[-1, 1]⁷``: a printhead, a cost and a search box.

    Parameters
    ----------
    name : str
        Its name in tables and on the command line.
    printhead : Printhead or AugmentedPrinthead
        One with effects is simulated on a grid, some hundred times slower, and has no gradients.
    cost : PeakCost
    bounds : Bounds
        The box in volts and seconds that ``[-1, 1]⁷`` maps to.
    initial_state : {"periodic", "demagnetised"}
    window_s : float
        Peaks count within this time of the waveform's start, in seconds; ``inf`` for the whole tail.
    """

    name: str
    printhead: Printhead | AugmentedPrinthead = field(default_factory=Printhead.published)
    cost: PeakCost = field(default_factory=PeakCost)
    bounds: Bounds = field(default_factory=Bounds)
    initial_state: str = "periodic"
    window_s: float = 350e-6

    @functools.cached_property
    def _head(self) -> NDArray[np.float64]:
        from inkjet_env.printhead import batch

        if isinstance(self.printhead, AugmentedPrinthead):
            raise ValueError("a printhead with effects has no gradients. Take an optimiser that needs none, as pso.")
        return batch.head_table(self.printhead)

    def evaluate(self, points: ArrayLike) -> NDArray[np.float64]:
        """Costs in volts, shape (n,), of points in ``[-1, 1]``, shape (n, 7)."""
        from inkjet_env.printhead import batch

        waveforms = self.bounds.from_unit(np.atleast_2d(points))
        if isinstance(self.printhead, AugmentedPrinthead):
            return self.printhead.costs(waveforms, self.cost, self.initial_state, self.window_s)
        return batch.costs(waveforms, self._head, self.cost, self.initial_state, self.window_s)

    def evaluate_with_gradient(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Costs in volts, shape (n,), and their exact gradients in volts per unit of the box, shape (n, 7)."""
        from inkjet_env.printhead import batch

        waveforms = self.bounds.from_unit(np.atleast_2d(points))
        costs, gradients = batch.costs_and_gradients(
            waveforms, self._head, self.cost, self.initial_state, self.window_s
        )
        return costs, gradients * self.bounds.half_width

    def respond(self, point: ArrayLike) -> Any:
        """Response of the printhead to the waveform of one point in ``[-1, 1]``, shape (7,).

        A `Response`, or an `AugmentedResponse`, which has what pictures and costs need of one.
        """
        waveform = Waveform.from_array(self.bounds.from_unit(point))
        return self.printhead.respond(waveform, self.initial_state, self.window_s)

    @property
    def best_known(self) -> BestKnown | None:
        """The best waveform known (see `experiments.best_known`), or None outside the suite."""
        entry = _best_known_entries().get(self.name)
        if entry is None or entry["problem"] != self.settings():
            return None
        return BestKnown(entry["cost_V"], tuple(entry["waveform"]), entry["found_by"])

    @classmethod
    def from_settings(cls, name: str, settings: dict[str, Any]) -> Problem:
        """The problem that `settings` describes."""
        head = settings["printhead"] | {"coefficients": tuple(settings["printhead"]["coefficients"])}
        return cls(
            name,
            printhead_of(settings["augmented"]) if "augmented" in settings else Printhead(**head),
            PeakCost(**settings["cost"]),
            Bounds(**settings["bounds"]),
            settings["initial_state"],
            float(settings["window_s"]),
        )

    def settings(self) -> dict[str, Any]:
        """Everything that decides the numbers, as plain JSON values."""
        head = self.printhead
        augmented = {}
        if isinstance(head, AugmentedPrinthead):
            augmented, head = {"augmented": head.as_json()}, head.printhead
        settings = {
            "printhead": {
                "a0": head.a0,
                "a1": head.a1,
                "b1": head.b1,
                "coefficients": list(head.coefficients),
                "full_scale_V": head.full_scale_V,
            },
            "cost": {"A": self.cost.A, "B": self.cost.B, "effective": self.cost.effective},
            "bounds": {"lower": list(self.bounds.lower), "upper": list(self.bounds.upper)},
            "initial_state": self.initial_state,
            "window_s": self.window_s if np.isfinite(self.window_s) else "inf",
        }
        return settings | augmented


def chosen_head(path: Path | None) -> Printhead | AugmentedPrinthead:
    """The head of a printhead.json, with its effects where it has such; or the published one."""
    return Printhead.published() if path is None else read_printhead(path)


@functools.cache
def _best_known_entries() -> dict[str, Any]:
    file = resources.files("experiments") / BEST_KNOWN_FILE
    if not file.is_file():
        return {}
    return json.loads(file.read_text(encoding="utf-8"))["problems"]


@functools.cache
def suite() -> dict[str, Problem]:
    """The five problems of the comparison, by name.

    ``nominal`` is the default problem on the published printhead. The two ``literal`` problems use the cost as the
    paper prints it ("first" peak), with weights at which doing nothing is not the answer. The two other heads are
    the published one with another resonance, damping, gain and hysteresis, at the default cost.
    """
    published = Printhead.published()
    problems = (
        Problem("nominal"),
        Problem("literal-5-1", cost=PeakCost(-5.0, 1.0, "first")),
        Problem("literal-10-5", cost=PeakCost(-10.0, 5.0, "first")),
        Problem(
            "stiff-head",
            published.varied(frequency_Hz=65e3, damping_ratio=0.035, gain=1.2, hysteresis_strength=0.7),
        ),
        Problem(
            "soft-head",
            published.varied(frequency_Hz=38e3, damping_ratio=0.07, gain=0.8, hysteresis_strength=1.3),
        ),
    )
    return {problem.name: problem for problem in problems}


def problem(name: str) -> Problem:
    """The problem of that name; an unknown name is a ``ValueError`` that suggests the nearest."""
    check_name("problem", name, suite())
    return suite()[name]
