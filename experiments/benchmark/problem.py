"""A problem: a printhead, a cost, a search box and, optionally, measurement noise; and its best known waveform."""

from __future__ import annotations

import functools
import json
import math
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.experiments.benchmark.data import data_file
from inkjet_env.experiments.benchmark.grey_level import grey_level
from inkjet_env.naming import check_name
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import RISKS, HeadEnsemble, ensemble_of
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.printhead import Bounds, DriverLimits, PeakCost, Printhead, Waveform
from inkjet_env.printhead.window import DEFAULT_WINDOW_S
from inkjet_env.typing import Real

BEST_KNOWN_FILE = "best_known.json"
STORED_NAMES = {"enough_V": "target_height_V"}
"""Keys of stored files by which parameters of a cost are still written."""
MAX_BUDGET = 10_000_000


@dataclass(frozen=True)
class BestKnown:
    """The best waveform that a long search found for a problem.

    Parameters
    ----------
    cost : float
        Its cost in volts.
    waveform : tuple of 7 floats
        ``U1 U2`` in volts, ``t1 … t5`` in seconds.
    found_by : str
        Method of the search, in words.
    runs, runs_near : int
        Number of complete optimiser runs in the search, and of those that ended near this cost: a measure of certainty.
    """

    cost: float
    waveform: tuple[float, ...]
    found_by: str
    runs: int
    runs_near: int


@dataclass(frozen=True)
class Spread:
    """Heads around a nominal one, as in a production lot; a waveform is judged on all of them.

    Parameters
    ----------
    relative : float
        Relative half width of the ranges of resonance, damping ratio, gain and hysteresis strength; above 0, below 1.
    heads : int
        Number of heads, at least 2: the first points of a Sobol sequence over these ranges; the second of them is the
        nominal head.
    judged : {"worst", "mean"}
        Whether the cost is that of the worst head or the mean over all heads.
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
        """The heads around a nominal one."""
        from scipy.stats import qmc

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # about a number that is not a power of 2
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
        Name in tables and on the command line.
    printhead : Printhead or AugmentedPrinthead
        The head. A head with effects is simulated on a time grid, about a hundred times slower, and has no gradients.
    cost : PeakCost
        The cost of a response, in volts.
    bounds : Bounds
        The box in volts and seconds to which ``[-1, 1]⁷`` is mapped.
    initial_state : {"periodic", "demagnetised"}
        Initial state of the hysteresis: the waveform has been repeating, or the ceramic is demagnetised.
    window_s : float
        Time in seconds after the waveform's start within which peaks count; ``inf`` for the whole tail.
    jetting_Hz : float
        Repetition rate of the waveform in hertz: it starts in the ringing of all waveforms before it, and peaks count
        within one period. 0: drops are far apart.
    spread : Spread, optional
        Heads around this one on which the waveform is judged.
    measurement_noise_V : float
        Standard deviation in volts of the error of each peak height that an optimiser receives; see `read`. `evaluate`
        is free of it.
    pulses : int
        Number of waveforms fired at `jetting_Hz` from rest, whose drops merge to one dot; the cost is that of a
        `grey_level`. 0: for ever, or a single one if drops are far apart.
    ensemble : HeadEnsemble, optional
        Heads that recordings leave possible in place of ``printhead``, which stays the one that `respond` shows.
    risk : {"mean", "cvar", "worst"}
        How their costs are judged; see `inkjet_env.plant.head_ensemble.RISKS`.
    known : BestKnown, optional
        The best known waveform of a problem that is not of the suite, from which a comparison counts regrets.
    instruments : int
        Number of instruments that read costs beside each other in a comparison, whose readings come late, in another
        order or never; see `inkjet_env.experiments.benchmark.late_benches`. 0: one waveform after another.
    """

    name: str
    printhead: Printhead | AugmentedPrinthead = field(default_factory=Printhead.published)
    cost: PeakCost = field(default_factory=PeakCost)
    bounds: Bounds = field(default_factory=Bounds)
    initial_state: str = "periodic"
    window_s: float = DEFAULT_WINDOW_S
    jetting_Hz: float = 0.0
    spread: Spread | None = None
    measurement_noise_V: float = 0.0
    pulses: int = 0
    ensemble: HeadEnsemble | None = None
    risk: str = "mean"
    known: BestKnown | None = field(default=None, compare=False)
    instruments: int = 0

    def __post_init__(self) -> None:
        if isinstance(self.printhead, AugmentedPrinthead) and (self.spread or self.measurement_noise_V):
            raise ValueError("a printhead with effects cannot be combined with spread or measurement_noise_V.")
        longest_s = self.bounds.longest_s
        if longest_s * self.jetting_Hz > 1 + 1e-9:
            raise ValueError(
                f"at {self.jetting_Hz:g} Hz the longest waveform, {longest_s:g} s, does not fit into a period. "
                "Narrow the bounds of the durations."
            )
        if sum(map(bool, (self.jetting_Hz, self.spread, self.measurement_noise_V))) > 1:
            raise ValueError("jetting_Hz, spread and measurement_noise_V cannot be combined; give one of them.")
        if self.pulses and not (self.pulses >= 2 and self.jetting_Hz):
            raise ValueError(
                f"pulses must be at least 2, at a rate jetting_Hz; got {self.pulses} at {self.jetting_Hz:g} Hz."
            )
        check_name("risk", self.risk, RISKS)
        if self.ensemble is not None and (self.jetting_Hz or self.spread or self.measurement_noise_V):
            raise ValueError("an ensemble cannot be combined with jetting_Hz, spread or measurement_noise_V.")
        if self.pulses and isinstance(self.printhead, AugmentedPrinthead):
            raise ValueError("a printhead with effects cannot be combined with pulses.")
        if self.instruments < 0 or (self.instruments and self.measurement_noise_V):
            raise ValueError(
                f"instruments must be 0 or more, and not with measurement_noise_V; got {self.instruments}."
            )

    @property
    def has_gradient(self) -> bool:
        """Whether gradients are available: only for heads without effects, exact costs and drivers without limits."""
        effects = isinstance(self.printhead, AugmentedPrinthead) or self.ensemble is not None
        return not (effects or self.measurement_noise_V or self.bounds.limits or self.instruments)

    @functools.cached_property
    def _heads(self) -> Real:
        """The heads on which a waveform is tried, one row per head, for the compiled simulator."""
        from inkjet_env.printhead import batch

        if isinstance(self.printhead, AugmentedPrinthead):
            raise ValueError(
                "a printhead with effects has no gradients. Use an optimiser that needs none, such as pso."
            )
        heads = self.spread.around(self.printhead) if self.spread else (self.printhead,)
        return batch.head_table(heads)

    @property
    def _period_s(self) -> float:
        return 1 / self.jetting_Hz if self.jetting_Hz else math.inf

    def _fired(self, waveforms: Real) -> dict[str, Any]:
        """Keyword arguments of the simulator for every waveform on every head, head by head."""
        count, heads = len(waveforms), self._heads
        if len(heads) > 1:  # in one call, whose overhead dominates a search that asks for one waveform at a time
            waveforms, heads = np.tile(waveforms, (len(heads), 1)), np.repeat(heads, count, axis=0)
        fired = {"initial_state": self.initial_state, "window_s": self.window_s, "period_s": self._period_s}
        return fired | {"waveforms": waveforms, "heads": heads, "cost": self.cost}

    def _drop_by_drop(self, waveforms: Real, simulated: Callable[..., Real]) -> Real:
        """`grey_level` of waveforms, whose costs ``simulated`` gives in the first of several columns."""
        found: list[list[Real]] = []
        for weight in (1.0, 0.0):
            fired = self._fired(waveforms) | {"cost": replace(self.cost, A=weight)}
            found.append([])
            for earlier in range(self.pulses):
                until_next_s = self.window_s if earlier == self.pulses - 1 else min(self.window_s, self._period_s)
                found[-1].append(simulated(**fired | {"earlier_drops": earlier, "window_s": until_next_s}))
        return grey_level(np.array(found[0]), np.array(found[1]), self.cost.A)

    def evaluate(self, points: ArrayLike) -> Real:
        """Costs in volts, shape (n,), of points in ``[-1, 1]``, shape (n, 7); a point outside is clipped to the box."""
        from inkjet_env.printhead import batch

        waveforms = self.bounds.from_unit(np.atleast_2d(points))
        if self.ensemble is not None:
            every = self.ensemble.costs(waveforms, self.cost, self.initial_state, self.window_s)
            return self.ensemble.risk(every, self.risk)
        if isinstance(self.printhead, AugmentedPrinthead):
            return self.printhead.costs(waveforms, self.cost, self.initial_state, self.window_s, self._period_s)
        if self.pulses:
            return self._drop_by_drop(waveforms, lambda **fired: batch.costs(**fired)[:, None])[:, 0]
        costs = batch.costs(**self._fired(waveforms)).reshape(-1, len(waveforms))
        judged: Real = _mean(costs) if self._by_mean else costs.max(axis=0)
        return judged

    def evaluate_with_gradient(self, points: ArrayLike) -> tuple[Real, Real]:
        """Costs in volts, shape (n,), and their exact gradients in volts per unit of the box, shape (n, 7).

        A point outside the box is clipped to it, as in `evaluate`, and the gradient is that of the clipped function:
        zero in a clipped coordinate, on which the cost does not depend. On a face of the box it is that of the inside.
        If the worst of several heads counts, the gradient is that head's; if two are equally bad, the first one's.
        """
        from inkjet_env.printhead import batch

        if self.measurement_noise_V:
            raise ValueError("noisy peak readings have no gradients. Use an optimiser that needs none, such as pso.")
        if self.instruments:
            raise ValueError("instruments read no gradients. Use an optimiser that needs none, such as pso.")
        if self.bounds.limits is not None:
            raise ValueError(
                "waveforms within a driver's limits have no gradients. Use an optimiser that needs none, such as pso."
            )
        if self.ensemble is not None:
            raise ValueError("an ensemble of heads has no gradients. Use an optimiser that needs none, such as pso.")
        waveforms = self.bounds.from_unit(np.atleast_2d(points))
        slope = self.bounds.slope(np.atleast_2d(points))
        if self.pulses:
            columns = self._drop_by_drop(waveforms, lambda **fired: np.column_stack(batch.costs_and_gradients(**fired)))
            return columns[:, 0], columns[:, 1:] * slope
        costs, gradients = batch.costs_and_gradients(**self._fired(waveforms))
        costs, gradients = costs.reshape(-1, len(waveforms)), gradients.reshape(-1, *waveforms.shape)
        if self._by_mean:
            return _mean(costs), _mean(gradients) * slope
        worst, each = costs.argmax(axis=0), np.arange(len(waveforms))
        return costs[worst, each], gradients[worst, each] * slope

    @property
    def _by_mean(self) -> bool:
        return self.spread is not None and self.spread.judged == "mean"

    def read(self, points: ArrayLike, seed: int, first: int = 0) -> Real:
        """Measured costs in volts, shape (n,): the cost of peak heights with measurement errors.

        Parameters
        ----------
        points : array_like, shape (n, 7)
            Points in ``[-1, 1]``.
        seed, first : int
            Seed of the run, and the number of the first point in it, from 0: an evaluation's error depends on these
            alone.
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
        """The objective of a run with that seed: this problem, or a rig that measures with errors.

        ``first`` is the number of evaluations that the run has already made.
        """
        return _Rig(self, seed, first) if self.measurement_noise_V else self

    def respond(self, point: ArrayLike) -> Any:
        """Response of the nominal printhead, initially at rest, to the waveform at a point in ``[-1, 1]``, shape (7,).

        It is a `Response`, or an `AugmentedResponse`, which has the same interface for figures and costs.
        """
        waveform = Waveform.from_array(self.bounds.from_unit(point))
        return self.printhead.respond(waveform, self.initial_state, self.window_s)

    @property
    def best_known(self) -> BestKnown | None:
        """The best known waveform: `known`, or that of the suite (see `studies.search_best_known`); None if unknown."""
        if self.known is not None:
            return self.known
        entry = _best_known_entries().get(self.name)
        if entry is None or entry["problem"] != self.settings():
            return None
        return BestKnown(
            entry["cost_V"], tuple(entry["waveform"]), entry["found_by"], entry["runs"], entry["runs_near"]
        )

    @classmethod
    def from_settings(cls, name: str, settings: dict[str, Any]) -> Problem:
        """The problem that `settings` describes."""
        cost = {STORED_NAMES.get(key, key): value for key, value in settings["cost"].items()}
        limits = DriverLimits.from_values(settings["limits"]) if "limits" in settings else None
        head = settings["printhead"] | {"coefficients": tuple(settings["printhead"]["coefficients"])}
        return cls(
            name,
            printhead_of(settings["augmented"]) if "augmented" in settings else Printhead(**head),
            PeakCost(**cost),
            Bounds(settings["bounds"]["lower"], settings["bounds"]["upper"], limits),
            settings["initial_state"],
            float(settings["window_s"]),
            settings.get("jetting_Hz", 0.0),
            Spread(**settings["spread"]) if "spread" in settings else None,
            settings.get("reading_V", 0.0),
            settings.get("pulses", 0),
            ensemble_of(settings),
            settings.get("risk", "mean"),
            instruments=settings.get("instruments", 0),
        )

    def settings(self) -> dict[str, Any]:
        """Everything that determines the numbers, as plain JSON values."""
        head = self.printhead
        augmented = {}
        if isinstance(head, AugmentedPrinthead):
            augmented, head = {"augmented": head.as_json()}, head.printhead
        cost: dict[str, Any] = {"A": self.cost.A, "B": self.cost.B, "effective": self.cost.effective}
        if math.isfinite(self.cost.target_height_V):
            cost["enough_V"] = self.cost.target_height_V
        more: dict[str, Any] = {}
        if self.jetting_Hz:
            more["jetting_Hz"] = self.jetting_Hz
        if self.ensemble is not None:
            more |= {"ensemble": self.ensemble.as_json(), "risk": self.risk}
        if self.pulses:
            more["pulses"] = self.pulses
        if self.measurement_noise_V:
            more["reading_V"] = self.measurement_noise_V  # the key in stored files
        if self.spread:
            more["spread"] = asdict(self.spread)
        if self.instruments:
            more["instruments"] = self.instruments
        if self.bounds.limits is not None:
            more["limits"] = self.bounds.limits.as_json()
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


def _mean(values: Real) -> Real:
    """Mean over the first axis, summed in the same order however many columns there are."""
    mean: Real = np.cumsum(values, axis=0)[-1] / len(values)
    return mean


@dataclass
class _Rig:
    """A problem as measured in a run with one seed: consecutive readings with errors, without gradients."""

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
