"""Task of one episode: the head on the bench, the waveform of an action, and the cost of that waveform.

The single environment, the vector environment and the Stable-Baselines3 one share this file: all of them call these
functions on rows, and the numbers of a row do not depend on the number of rows.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from inkjet_env.envs.parallel import check_simulator, simulated_costs, simulated_peaks
from inkjet_env.plant.augmented import AugmentedPrinthead, AugmentedResponse
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.printhead import Bounds, DriverLimits, PeakCost, Printhead, Response, Waveform, check_name
from inkjet_env.printhead.waveform import as_waveform_array
from inkjet_env.printhead.window import DEFAULT_WINDOW_S
from inkjet_env.typing import Real

CONTEXTS = ("fixed", "random")
CONTEXT_NAMES = ("frequency_Hz", "damping_ratio", "gain", "hysteresis_strength")
"""Parameters of a drawn head; gain and strength are relative to the task's head."""
CONTEXT_LOWER = np.array([35e3, 0.03, 0.7, 0.6])
"""Lower ends of their ranges; the frequency is in hertz, the others are dimensionless."""
CONTEXT_UPPER = np.array([70e3, 0.08, 1.3, 1.4])
"""Upper ends of their ranges."""
_CENTRE, _HALF = (CONTEXT_LOWER + CONTEXT_UPPER) / 2, (CONTEXT_UPPER - CONTEXT_LOWER) / 2

Value = TypeVar("Value", PeakCost, Bounds)


def make_task(
    printhead: Printhead | AugmentedPrinthead | str | os.PathLike[str] | None = None,
    cost: PeakCost | Mapping[str, Any] | None = None,
    bounds: Bounds | Mapping[str, Any] | None = None,
    context: str = "fixed",
    noise: float = 0.0,
    clip_actions: bool = False,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
    limits: DriverLimits | Mapping[str, float] | None = None,
    reference: ArrayLike | None = None,
) -> WaveformTask:
    """Task for the environment's keyword options.

    Parameters
    ----------
    printhead : Printhead, AugmentedPrinthead or path, optional
        The head, or its ``printhead.json``, with or without effects; by default the published one.
    cost : PeakCost or dict, optional
        Peak cost; a dict holds the arguments of `PeakCost`, for example ``{"A": -10, "effective": "first"}``.
    bounds : Bounds or dict, optional
        Search box to which ``[-1, 1]⁷`` maps; a dict holds ``lower`` and ``upper``, 7 values each (V, V, s …).
    context : {"fixed", "random"}
        ``random``: every reset draws a head from uniform ranges: resonance 35…70 kHz, damping ratio 0.03…0.08, gain
        ±30 % and strength of the hysteresis ×0.6…1.4 (both relative to ``printhead``, which must have no effects).
    noise : float
        Standard deviation in volts of an independent Gaussian error on the reading of every peak. The reward is minus
        the cost *of the readings*, with the effective peak chosen among them, as a measurement would give it. A peak
        well above the noise is read without bias; one within it adds about 0.8 ``noise`` to the cost, since the cost
        takes magnitudes. ``info["cost"]`` is free of noise.
    clip_actions : bool
        Whether to replace an action outside the box by the nearest one inside, instead of refusing it.
    initial_state, window_s, hysteresis
        As in `Printhead.respond` (without ``play_operators``).
    limits : DriverLimits or dict, optional
        What the driver can do; a dict holds the arguments of `DriverLimits`, for example ``{"rise_V_per_us": 20}``.
        Every action is then a legal waveform: see `Bounds`.
    reference : array_like, shape (7,), optional
        A waveform in volts and seconds, made for ``printhead``. The reward is then minus the regret: what this waveform
        costs on the head on the bench, without noise, less the cost that is read. On a drawn head its durations are
        stretched in proportion to the period, as somebody would who only knows the period. Rewards of different heads
        can then be compared, and 0 V is not the reward of firing nothing.

    Returns
    -------
    WaveformTask
        The checked task.

    Raises
    ------
    ValueError
        An option has an invalid value; the message suggests the nearest name.
    """
    head: Printhead | AugmentedPrinthead
    if printhead is None:
        head = Printhead.published()
    elif isinstance(printhead, (Printhead, AugmentedPrinthead)):
        head = printhead
    elif isinstance(printhead, (str, os.PathLike)):
        head = read_printhead(printhead)
    else:
        raise ValueError(
            f"printhead must be a Printhead, the path of a printhead.json, or None; got {type(printhead).__name__}."
        )
    check_name("context", context, CONTEXTS)
    if context == "random" and isinstance(head, AugmentedPrinthead):
        raise ValueError(
            'context="random" varies a printhead without effects; this one has '
            f"{', '.join(effect.id for effect, _ in head.effects) or 'a remainder'}, fitted to one head. "
            'Use context="fixed"; to tune it in TuneWaveform, give it as heads.'
        )
    if isinstance(noise, bool) or not (isinstance(noise, (int, float, np.number)) and 0 <= noise <= 1e6):
        raise ValueError(f"noise must be a standard deviation of 0 to 1e6 V; got {noise!r}.")
    if not isinstance(clip_actions, (bool, np.bool_)):
        raise ValueError(f"clip_actions must be True or False; got {clip_actions!r}.")
    box = _value_of("bounds", Bounds, ("lower", "upper"), bounds)
    if limits is not None:
        if not isinstance(limits, (DriverLimits, Mapping)):
            raise ValueError(f"limits must be DriverLimits, a dict or None; got {limits!r}.")
        box = replace(box, limits=limits if isinstance(limits, DriverLimits) else DriverLimits.from_values(limits))
    return WaveformTask(
        head,
        _value_of("cost", PeakCost, ("A", "B", "effective", "target_height_V"), cost),
        box,
        context,
        float(noise),
        bool(clip_actions),
        initial_state,
        window_s,
        hysteresis,
        None if reference is None else _checked_reference(reference),
    )


def _checked_reference(reference: ArrayLike) -> tuple[float, ...]:
    """A waveform, shape (7,), in volts and seconds; a ``ValueError`` names the option."""
    try:
        row = as_waveform_array(reference)
    except ValueError as error:
        raise ValueError(f"reference: {error}") from None
    if len(row) != 1:
        raise ValueError(f"reference must be one waveform, U1 U2 t1 … t5; got {len(row)}.")
    return tuple(row[0].tolist())


def warm_up() -> None:
    """Compile every kernel of the simulator and the environments, or load it from the cache."""
    from inkjet_env.printhead import batch

    batch.warm_up()
    task = make_task(noise=1.0)
    task.measure(task.waveforms(np.zeros(7), (7,)), task.heads([]), [np.random.default_rng(0)])


def _value_of(option: str, kind: type[Value], keys: tuple[str, ...], given: object) -> Value:
    """`PeakCost` or `Bounds` from an instance, from a dict of its arguments, or from None."""
    if isinstance(given, kind):
        return given
    if given is None:
        return kind()
    if isinstance(given, Mapping):
        for key in given:
            check_name(f"a key of {option}", key, keys)
        return kind(**given)
    raise ValueError(f"{option} must be a {kind.__name__}, a dict or None; got {given!r}.")


@dataclass(frozen=True)
class Readings:
    """Readings of n responses.

    Attributes
    ----------
    times_s, heights_V : ndarray, shape (n, capacity)
        Times in seconds and signed heights in volts of the peaks, in time order; entries after the last peak are
        undefined.
    counts : ndarray of int, shape (n,)
        Number of peaks.
    read_V, costs_V : ndarray, shape (n,)
        Costs of the readings, and noise-free costs, in volts.
    """

    times_s: Real
    heights_V: Real
    counts: NDArray[np.int64]
    read_V: Real
    costs_V: Real

    def first(self, count: int) -> tuple[Real, Real]:
        """Heights in volts and times in seconds of the first peaks, shape (n, count) each; zeros if there are fewer."""
        columns = np.arange(count)
        there = columns < self.counts[:, None]
        if not self.heights_V.shape[1]:
            return np.zeros(there.shape), np.zeros(there.shape)
        columns = np.minimum(columns, self.heights_V.shape[1] - 1)
        return np.where(there, self.heights_V[:, columns], 0.0), np.where(there, self.times_s[:, columns], 0.0)


@dataclass(frozen=True)
class WaveformTask:
    """One printhead, cost, search box and way of measuring; made by `make_task`.

    Attributes
    ----------
    printhead : Printhead or AugmentedPrinthead
        The head on the bench or, if ``context`` is ``"random"``, the one that drawn heads are relative to.
    cost : PeakCost
        Peak cost.
    bounds : Bounds
        Search box to which ``[-1, 1]⁷`` maps, in volts and seconds.
    context, noise, clip_actions, initial_state, window_s, hysteresis, reference
        As in `make_task`.
    """

    printhead: Printhead | AugmentedPrinthead
    cost: PeakCost
    bounds: Bounds
    context: str
    noise: float
    clip_actions: bool
    initial_state: str
    window_s: float
    hysteresis: str
    reference: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        _ = self._prepared  # checks the options of the simulator

    @cached_property
    def _prepared(self) -> tuple[tuple, int]:
        """Checked settings of the compiled simulator, and the largest number of extrema that an episode can have."""
        from inkjet_env.printhead import batch

        if isinstance(self.printhead, AugmentedPrinthead):
            self.respond(np.array([0.0, 0.0, *self.bounds.upper[2:]]), self.fixed_context)
        heads = self._fixed_head if self.context == "fixed" else self.heads(np.array([[1.0, -1.0, 0.0, 0.0]]))
        (_, _, *settings), capacity, _ = batch.prepare(
            self.bounds.upper, heads, self.cost, self.initial_state, self.window_s, self.hysteresis
        )
        return tuple(settings), capacity

    @cached_property
    def _box(self) -> tuple[Real, Real]:
        return np.array(self.bounds.lower), np.array(self.bounds.upper)

    @cached_property
    def _fixed_head(self) -> Real:
        from inkjet_env.printhead import batch

        return batch.head_table(self._base)

    @property
    def _base(self) -> Printhead:
        head = self.printhead
        return head.printhead if isinstance(head, AugmentedPrinthead) else head

    def action_space(self) -> spaces.Box:
        """Space of the seven waveform parameters, scaled to [-1, 1]."""
        return spaces.Box(-1.0, 1.0, (7,), np.float32)

    def observation_space(self) -> spaces.Box:
        """Space of the head's four parameters, scaled; wider than [-1, 1] if a fixed head lies outside the ranges."""
        if self.context == "random":
            return spaces.Box(-1.0, 1.0, (4,), np.float32)
        own = self.fixed_context
        return spaces.Box(np.minimum(own, np.float32(-1.0)), np.maximum(own, np.float32(1.0)), dtype=np.float32)

    @cached_property
    def fixed_context(self) -> NDArray[np.float32]:
        """Observation of the task's own head, shape (4,): its parameters on the scale of drawn heads, not clipped."""
        values = np.array([self.printhead.frequency_Hz, self.printhead.damping_ratio, 1.0, 1.0])
        return ((values - _CENTRE) / _HALF).astype(np.float32)

    def contexts(self, generators: Sequence[np.random.Generator]) -> NDArray[np.float32]:
        """One observation per generator, shape (n, 4): `CONTEXT_NAMES` scaled so that ±1 are the ends of the ranges."""
        drawn = np.empty((len(generators), 4))
        for row, generator in zip(drawn, generators, strict=True):
            generator.random(out=row)
        return (2.0 * drawn - 1.0).astype(np.float32)

    def head_values(self, contexts: ArrayLike) -> Real:
        """Physical values of observations of drawn heads, same shape; exact, since heads are made from observations."""
        return _CENTRE + _HALF * np.asarray(contexts, dtype=np.float64)

    def heads(self, contexts: ArrayLike) -> Real:
        """Head table of observations (n, 4) for the compiled simulator; a single row if the context is fixed."""
        if self.context == "fixed":
            return self._fixed_head
        from inkjet_env.printhead import batch

        return batch.varied_head_table(self._base, *self.head_values(contexts).T)

    def head(self, context: ArrayLike) -> Printhead | AugmentedPrinthead:
        """The printhead of one observation, shape (4,)."""
        if self.context == "fixed":
            return self.printhead
        values = self.head_values(context)
        return self._base.varied(**{name: float(v) for name, v in zip(CONTEXT_NAMES, values, strict=True)})

    def references_V(self, contexts: ArrayLike) -> Real:
        """Cost of the reference on the heads of observations (n, 4), in volts, shape (1 or n,)."""
        if self.context == "fixed":
            return self._fixed_reference_V
        stretched = np.tile(np.array(self.reference, dtype=np.float64), (len(np.atleast_2d(contexts)), 1))
        stretched[:, 2:] *= self._base.frequency_Hz / self.head_values(contexts)[:, :1]
        waveforms = self.bounds.legal(np.clip(stretched, *self._box))
        return self._costs(waveforms, self.heads(contexts))

    @cached_property
    def _fixed_reference_V(self) -> Real:
        waveform = self.bounds.legal(np.clip(np.array([self.reference], dtype=np.float64), *self._box))
        return self._costs(waveform, self._fixed_head)

    def _costs(self, waveforms: Real, heads: Real) -> Real:
        """Costs without noise, in volts, shape (n,)."""
        return self._without_noise.measure(waveforms, heads, (), threads=1)[1]

    @cached_property
    def _without_noise(self) -> WaveformTask:
        return replace(self, noise=0.0)

    def respond(self, waveform: Real | None, context: ArrayLike) -> Response | AugmentedResponse | None:
        """Response of the head of one observation to a waveform, shape (7,), in volts and seconds; None for None."""
        if waveform is None:
            return None
        return self.head(context).respond(
            Waveform.from_array(waveform), self.initial_state, self.window_s, self.hysteresis
        )

    def waveforms(self, actions: ArrayLike, shape: tuple[int, ...], rows: NDArray[np.bool_] | None = None) -> Real:
        """Physical parameters (V, V, s …), shape (n, 7), of actions in [-1, 1].

        A value outside by no more than four roundings in single precision, as wrappers that rescale actions make, is
        the bound itself.

        Parameters
        ----------
        actions : array_like, shape ``shape``
            Scaled waveform parameters.
        shape : tuple
            Required shape of the actions: (7,) or (n, 7).
        rows : ndarray of bool, shape (n,), optional
            Which actions count; the others may be anything, and their waveforms are those of zeros.

        Returns
        -------
        ndarray, shape (n, 7)
            Waveforms in volts and seconds, legal for a driver with limits.

        Raises
        ------
        ValueError
            Wrong shape, NaN, or a value outside [-1, 1] without ``clip_actions``.
        """
        from inkjet_env.envs.compiled_episodes import waveforms_of_actions

        try:
            points = np.ascontiguousarray(actions, dtype=np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"action must be numbers of shape {shape}: U1 U2 t1 t2 t3 t4 t5 in [-1, 1].") from None
        if points.shape != shape:
            raise ValueError(f"action must have shape {shape}: U1 U2 t1 t2 t3 t4 t5; got shape {points.shape}.")
        if rows is not None and not rows.all():
            points = np.where(rows[:, None], points, 0.0)
        waveforms = np.empty((points.size // 7, 7))
        if not waveforms_of_actions(points.reshape(-1, 7), *self._box, waveforms):
            waveforms_of_actions(self._clipped(points).reshape(-1, 7), *self._box, waveforms)
        return self.bounds.legal(waveforms)

    def _clipped(self, points: Real) -> Real:
        from inkjet_env.envs.compiled_episodes import EDGE

        for broken, rule, fix in (
            (np.isnan(points), "must be a number", "Look for the policy or optimiser that produced it."),
            (np.abs(points) > EDGE, "must be within [-1, 1]", "Scale it, or pass clip_actions=True."),
        ):
            if broken.any() and not (self.clip_actions and rule.endswith("]")):
                at = tuple(int(i) for i in np.argwhere(broken)[0])
                place = f" in row {at[0]}" if len(at) > 1 else ""
                name = self.bounds.names[at[-1]]
                raise ValueError(f"action {name} {rule}; got {points[at]:.9g}{place}. {fix}")
        return np.clip(points, -1.0, 1.0)

    def check_simulator(self, simulator: str) -> None:
        """Check that one of `inkjet_env.envs.parallel.SIMULATORS` can compute costs of this task; see there."""
        plain = self.noise == 0 and not isinstance(self.printhead, AugmentedPrinthead)
        check_simulator(simulator, self._prepared[0], plain)

    def measure(
        self,
        waveforms: Real,
        heads: Real,
        generators: Sequence[np.random.Generator],
        threads: int | None = None,
        simulator: str = "scalar",
    ) -> tuple[Real, Real]:
        """Fire waveforms (n, 7) on heads (1 or n rows); return costs of the readings and noise-free costs, in volts.

        Without noise both are the same array, and no generator is used. ``threads`` is the largest number of threads,
        by default the number of cores; a printhead with effects is simulated on one. ``simulator`` is a checked one,
        see `check_simulator`.
        """
        settings, capacity = self._prepared
        if self.noise == 0 and not isinstance(self.printhead, AugmentedPrinthead):
            costs = simulated_costs(waveforms, heads, settings, capacity, threads, simulator)
            return costs, costs
        readings = self.read(waveforms, heads, generators, threads)
        return readings.read_V, readings.costs_V

    def read(
        self,
        waveforms: Real,
        heads: Real,
        generators: Sequence[np.random.Generator],
        threads: int | None = None,
    ) -> Readings:
        """Fire waveforms (n, 7) on heads (1 or n rows) and read every peak, each with an error.

        There is one generator per row; without noise none is used. ``threads`` is as in `measure`. If the task's head
        has effects, all are fired on it.
        """
        if isinstance(self.printhead, AugmentedPrinthead):
            return self._read_with_effects(waveforms, generators)
        from inkjet_env.envs.compiled_episodes import costs_of_readings

        (warm_up_periods, one_point, window_s, _, _, *cost), capacity = self._prepared
        settings = warm_up_periods, one_point, window_s
        times, peaks, counts, tails = simulated_peaks(waveforms, heads, settings, capacity, threads)
        costs, read = np.empty(len(waveforms)), np.empty(len(waveforms))
        costs_of_readings(peaks, counts, tails, *cost, costs)
        if self.noise == 0:
            return Readings(times, peaks, counts, costs, costs)
        errors = np.zeros_like(peaks)
        for row, count, generator in zip(errors, counts.tolist(), generators, strict=True):
            generator.standard_normal(out=row[:count])
        heights = peaks + self.noise * errors
        costs_of_readings(heights, counts, tails, *cost, read)
        return Readings(times, heights, counts, read, costs)

    def _read_with_effects(self, waveforms: Real, generators: Sequence[np.random.Generator]) -> Readings:
        """`read` of the task's own head, one waveform at a time."""
        responses = [
            self.printhead.respond(Waveform.from_array(row), self.initial_state, self.window_s, self.hysteresis)
            for row in waveforms
        ]
        costs = np.array([response.cost(self.cost) for response in responses])
        counts = np.array([response.peaks_V.size for response in responses], dtype=np.int64)
        times, heights = np.zeros((2, len(responses), int(counts.max(initial=0))))
        read = costs if self.noise == 0 else np.empty(len(costs))
        for i, response in enumerate(responses):
            peaks = response.peaks_V
            if self.noise:
                peaks = peaks + self.noise * generators[i].standard_normal(peaks.size)
                read[i] = self.cost(peaks)
            times[i, : peaks.size], heights[i, : peaks.size] = response.peak_times_s, peaks
        return Readings(times, heights, counts, read, costs)
