"""What a problem is: a printhead, a cost, a search box, and what an optimiser is told; with the best waveform known."""

from __future__ import annotations

import functools
import json
import math
import warnings
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from experiments.benchmark.data import data_file
from inkjet_env.naming import check_name
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform
from inkjet_env.typing import Real

BEST_KNOWN_FILE = "best_known.json"
MAX_BUDGET = 10_000_000


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
    runs, runs_near : int
        Whole runs of an optimiser that were part of it, and how many of them came near: how certain it is.
    """

    cost: float
    waveform: tuple[float, ...]
    found_by: str
    runs: int
    runs_near: int


@dataclass(frozen=True)
class Spread:
    """Heads around a nominal one, as a lot of them comes from the factory; a waveform is judged by all.

    Parameters
    ----------
    relative : float
        Half the width of the range of resonance, damping ratio, gain and hysteresis strength, relative; below 1.
    heads : int
        How many: the first points of Sobol's sequence over these ranges, of which the second is the nominal head.
    judged : {"worst", "mean"}
        By the worst head, or by the mean over all.
    """

    relative: float = 0.05
    heads: int = 16
    judged: str = "worst"

    def __post_init__(self) -> None:
        check_name("judged", self.judged, ("worst", "mean"))
        if not 0 < self.relative < 1:
            raise ValueError(f"relative must be above 0 and below 1; got {self.relative!r}.")
        if self.heads < 2:
            raise ValueError(f"heads must be at least 2; got {self.heads!r}.")

    def around(self, head: Printhead) -> tuple[Printhead, ...]:
        """The heads."""
        from scipy.stats import qmc

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a number that is no power of 2
            points = qmc.Sobol(4, scramble=False).random(self.heads)
        factors = 1 + self.relative * (2 * points - 1)
        return tuple(
            head.varied(head.frequency_Hz * f, head.damping_ratio * d, gain=g, hysteresis_strength=s)
            for f, d, g, s in factors
        )


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
    jetting_Hz : float
        The waveform is repeated so often a second that it starts in what all before it left ringing; peaks count
        within one period. 0: drops are far apart.
    spread : Spread, optional
        The waveform is judged on many heads about this one.
    measurement_noise_V : float
        Standard deviation of the error with which an optimiser is told each peak's height; see `read`. `evaluate` is
        free of it.
    """

    name: str
    printhead: Printhead | AugmentedPrinthead = field(default_factory=Printhead.published)
    cost: PeakCost = field(default_factory=PeakCost)
    bounds: Bounds = field(default_factory=Bounds)
    initial_state: str = "periodic"
    window_s: float = 350e-6
    jetting_Hz: float = 0.0
    spread: Spread | None = None
    measurement_noise_V: float = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.printhead, AugmentedPrinthead) and (
            self.jetting_Hz or self.spread or self.measurement_noise_V
        ):
            raise ValueError(
                "a printhead with effects is offered without jetting_Hz, spread and measurement_noise_V only."
            )
        longest_s = sum(self.bounds.upper[2:])
        if longest_s * self.jetting_Hz > 1 + 1e-9:
            raise ValueError(
                f"at {self.jetting_Hz:g} Hz the longest waveform, {longest_s:g} s, does not fit into a period. "
                "Narrow the bounds of the durations."
            )
        if sum(map(bool, (self.jetting_Hz, self.spread, self.measurement_noise_V))) > 1:
            raise ValueError("jetting_Hz, spread and measurement_noise_V are not offered together; give one of them.")

    @property
    def has_gradient(self) -> bool:
        """Whether an optimiser may have gradients: not of heads with effects, nor of readings."""
        return not (isinstance(self.printhead, AugmentedPrinthead) or self.measurement_noise_V)

    @functools.cached_property
    def _heads(self) -> Real:
        """What a waveform is tried on, a row a head, for the compiled simulator."""
        from inkjet_env.printhead import batch

        if isinstance(self.printhead, AugmentedPrinthead):
            raise ValueError("a printhead with effects has no gradients. Take an optimiser that needs none, as pso.")
        heads = self.spread.around(self.printhead) if self.spread else (self.printhead,)
        return batch.head_table(heads)

    def _fired(self, waveforms: Real) -> dict[str, Any]:
        """Every waveform on every head, head by head, and how they are fired and looked at."""
        count, heads = len(waveforms), self._heads
        if len(heads) > 1:  # in one call: a search that asks for one waveform at a time waits for calls mostly
            waveforms, heads = np.tile(waveforms, (len(heads), 1)), np.repeat(heads, count, axis=0)
        period_s = 1 / self.jetting_Hz if self.jetting_Hz else math.inf
        fired = {"initial_state": self.initial_state, "window_s": self.window_s, "period_s": period_s}
        return fired | {"waveforms": waveforms, "heads": heads, "cost": self.cost}

    def evaluate(self, points: ArrayLike) -> Real:
        """Costs in volts, shape (n,), of points in ``[-1, 1]``, shape (n, 7)."""
        from inkjet_env.printhead import batch

        waveforms = self.bounds.from_unit(np.atleast_2d(points))
        if isinstance(self.printhead, AugmentedPrinthead):
            return self.printhead.costs(waveforms, self.cost, self.initial_state, self.window_s)
        costs = batch.costs(**self._fired(waveforms)).reshape(-1, len(waveforms))
        judged: Real = costs.mean(axis=0) if self._by_mean else costs.max(axis=0)
        return judged

    def evaluate_with_gradient(self, points: ArrayLike) -> tuple[Real, Real]:
        """Costs in volts, shape (n,), and their exact gradients in volts per unit of the box, shape (n, 7).

        Where the worst of several counts, its gradient; where two are equally bad, that of the first.
        """
        from inkjet_env.printhead import batch

        if self.measurement_noise_V:
            raise ValueError("readings of peaks have no gradients. Take an optimiser that needs none, as pso.")
        waveforms = self.bounds.from_unit(np.atleast_2d(points))
        costs, gradients = batch.costs_and_gradients(**self._fired(waveforms))
        costs, gradients = costs.reshape(-1, len(waveforms)), gradients.reshape(-1, *waveforms.shape)
        if self._by_mean:
            return costs.mean(axis=0), gradients.mean(axis=0) * self.bounds.half_width
        worst, each = costs.argmax(axis=0), np.arange(len(waveforms))
        return costs[worst, each], gradients[worst, each] * self.bounds.half_width

    @property
    def _by_mean(self) -> bool:
        return self.spread is not None and self.spread.judged == "mean"

    def read(self, points: ArrayLike, seed: int, first: int = 0) -> Real:
        """What a measurement of points (n, 7) tells, in volts, shape (n,): the cost of peaks read with an error.

        Parameters
        ----------
        points : array_like
            In ``[-1, 1]``.
        seed, first : int
            Of the run, and the number of the first point in it: an evaluation's error hangs on these alone.
        """
        from inkjet_env.envs.task import make_task

        if not self.measurement_noise_V:
            return self.evaluate(points)
        waveforms = self.bounds.from_unit(np.atleast_2d(points))
        task = make_task(
            self.printhead,
            self.cost,
            noise=self.measurement_noise_V,
            initial_state=self.initial_state,
            window_s=self.window_s,
        )
        numbers = range(first, first + len(waveforms))
        return task.measure(waveforms, task.heads([]), [np.random.default_rng([seed, k, 1]) for k in numbers])[0]

    def as_measured(self, seed: int, first: int = 0) -> Any:
        """What an optimiser is given in a run of that seed: this problem, or a rig that reads with errors.

        ``first``: how many evaluations the run has had before.
        """
        return _Rig(self, seed, first) if self.measurement_noise_V else self

    def respond(self, point: ArrayLike) -> Any:
        """Response of the nominal printhead, at rest before, to the waveform of one point in ``[-1, 1]``, shape (7,).

        A `Response`, or an `AugmentedResponse`, which has what pictures and costs need of one.
        """
        waveform = Waveform.from_array(self.bounds.from_unit(point))
        return self.printhead.respond(waveform, self.initial_state, self.window_s)

    @property
    def best_known(self) -> BestKnown | None:
        """The best waveform known (see `studies.search_best_known`), or None outside the suite."""
        entry = _best_known_entries().get(self.name)
        if entry is None or entry["problem"] != self.settings():
            return None
        return BestKnown(
            entry["cost_V"], tuple(entry["waveform"]), entry["found_by"], entry["runs"], entry["runs_near"]
        )

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
            settings.get("jetting_Hz", 0.0),
            Spread(**settings["spread"]) if "spread" in settings else None,
            settings.get("reading_V", 0.0),
        )

    def settings(self) -> dict[str, Any]:
        """Everything that decides the numbers, as plain JSON values."""
        head = self.printhead
        augmented = {}
        if isinstance(head, AugmentedPrinthead):
            augmented, head = {"augmented": head.as_json()}, head.printhead
        cost: dict[str, Any] = {"A": self.cost.A, "B": self.cost.B, "effective": self.cost.effective}
        if math.isfinite(self.cost.enough_V):
            cost["enough_V"] = self.cost.enough_V
        more: dict[str, Any] = {}
        if self.jetting_Hz:
            more["jetting_Hz"] = self.jetting_Hz
        if self.measurement_noise_V:
            more["reading_V"] = self.measurement_noise_V  # the key of files that are kept
        if self.spread:
            more["spread"] = asdict(self.spread)
        settings = {
            "printhead": {
                "a0": head.a0,
                "a1": head.a1,
                "b1": head.b1,
                "coefficients": list(head.coefficients),
                "full_scale_V": head.full_scale_V,
            },
            "cost": cost,
            "bounds": {"lower": list(self.bounds.lower), "upper": list(self.bounds.upper)},
            "initial_state": self.initial_state,
            "window_s": self.window_s if np.isfinite(self.window_s) else "inf",
        }
        return settings | more | augmented


@dataclass
class _Rig:
    """A problem as a run of one seed is told it: readings, one after another, and no gradients."""

    problem: Problem
    seed: int
    read: int = 0

    def evaluate(self, points: Real) -> Real:
        """Readings in volts, shape (n,), of the next n evaluations."""
        costs = self.problem.read(points, self.seed, self.read)
        self.read += len(points)
        return costs


@functools.cache
def _best_known_entries() -> dict[str, Any]:
    file = data_file(BEST_KNOWN_FILE)
    if not file.is_file():
        return {}
    return json.loads(file.read_text(encoding="utf-8"))["problems"]
