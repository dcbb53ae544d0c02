"""The printhead with the effects that a diagnosis found: its response to a waveform or any drive, and its file."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.plant.effect import Effect, Values, complete
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.extrema import extrema
from inkjet_env.plant.head_motion import head_motion
from inkjet_env.plant.registry import own_class
from inkjet_env.plant.remainder import ChannelRemainder, Remainder
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.stages import Plant
from inkjet_env.printhead import PeakCost, Printhead, SampledResponse, Waveform, as_waveform_array, check_name
from inkjet_env.printhead.hysteresis import periods_before_recording
from inkjet_env.printhead.sampled import check_samples, one_period, shortest_period_s
from inkjet_env.printhead.window import DEFAULT_WINDOW_S, check_period, check_window
from inkjet_env.storage import write_json
from inkjet_env.typing import Real

STEPS_A_PERIOD = 200
"""Grid steps per period of the head's resonance."""

STEPS_A_WINDOW = 1000
"""Smallest number of grid steps in a window."""

MOST_STEPS = 2_000_000
"""Largest number of grid steps that is simulated."""

SUBSTEPS = 2
"""Nodes per grid step."""


@dataclass(frozen=True, eq=False)
class AugmentedPrinthead:
    """A printhead with effects that its base model leaves out.

    It responds as `Printhead` does, on a grid of 200 steps per period. The corners of a waveform fall between the nodes
    of the grid: peaks are accurate to 3e-4 of the largest if edges last a twentieth of the period, and to 2e-2 if they
    are jumps. A pulse shorter than the distance of two nodes, a 400th of the period, may be missed.
    Random effects (hum, baseline drift) and crosstalk contribute nothing: there is no recording and no neighbour.

    Parameters
    ----------
    printhead : Printhead
        Base model of the head.
    effects : tuple of (Effect, values)
        Effects with values of their parameters, in their units. Values that are not given are those of the simplest
        law; see `complete`.
    gains : mapping of str to float
        Gain of each channel, in its unit per hysteretic volt.
    order : int
        Order of the recording at which effects that change within the session are evaluated.
    remainder : Remainder, optional
        Discrepancy model that corrects the signals of some channels; see `without_remainder`.
    """

    printhead: Printhead
    effects: tuple[tuple[Effect, Values], ...]
    gains: Mapping[str, float] = field(default_factory=dict)
    order: int = 1
    remainder: Remainder | None = None

    def __post_init__(self) -> None:
        whole = tuple((effect, complete(effect, **values)) for effect, values in self.effects)
        object.__setattr__(self, "effects", whole)

    @property
    def frequency_Hz(self) -> float:
        """Undamped natural frequency of the base model, in hertz."""
        return self.printhead.frequency_Hz

    @property
    def damping_ratio(self) -> float:
        """Damping ratio of the base model, dimensionless."""
        return self.printhead.damping_ratio

    @property
    def has_dynamics(self) -> bool:
        """Whether the dynamics of the base model are known."""
        return self.printhead.has_dynamics

    @property
    def plant(self) -> Plant:
        """Head, sensors, effects and remainder as a plant for recordings."""
        return Plant(self.printhead, self.gains, effects=self.effects, remainder=self.remainder)

    def without_remainder(self) -> AugmentedPrinthead:
        """The same head with its named effects alone."""
        return replace(self, remainder=None)

    def respond(
        self,
        waveform: Waveform,
        initial_state: str = "periodic",
        window_s: float = DEFAULT_WINDOW_S,
        hysteresis: str = "full_memory",
        period_s: float = math.inf,
    ) -> AugmentedResponse:
        """Response to one waveform; the resonator is at rest at its start unless a period is given.

        Parameters
        ----------
        waveform : Waveform
            The drive.
        initial_state : {"periodic", "demagnetised"}
            State of everything with memory except the resonator: the waveform has been repeated, once per window, or it
            is the first.
        window_s : float
            Peaks later than this after the waveform's start do not count, in seconds; finite.
        hysteresis : {"full_memory"}
            Memory of the branch law; with effects, only this one.
        period_s : float
            Firing period in seconds: the waveform has been repeated for ever and starts in the residual vibration of
            all those before it; peaks count within one period. Infinite, the default: the head is at rest.

        Returns
        -------
        AugmentedResponse
            Peaks, and the signals at any time in the window.

        Raises
        ------
        ValueError
            An option that is not available with effects, or a motion that grows without bound.
        """
        check_name("hysteresis of a printhead with effects", hysteresis, ("full_memory",))
        window_s = _finite_window(window_s)
        knots_s, knots_V = waveform.knots()
        period_s = check_period(period_s, waveform.duration_s, initial_state)
        if not math.isinf(period_s):
            return self._respond_in_train(waveform, min(window_s, period_s), period_s)
        step_s = self._step_s(window_s)
        steps = _steps(max(window_s, waveform.duration_s), step_s)
        times_s = np.arange(steps * SUBSTEPS) * (step_s / SUBSTEPS)
        at_nodes_V = waveform.drive_V(times_s)
        at_nodes_V[0] = 0.0  # a jump at the start begins at 0 V
        hysteretic_V, sensor_V = self._answer(at_nodes_V, step_s, initial_state)
        peak_times_s, peaks_V = extrema(sensor_V, step_s)
        counts = peak_times_s <= window_s
        return AugmentedResponse(
            self, knots_s, knots_V, window_s, step_s, hysteretic_V, sensor_V, peak_times_s[counts], peaks_V[counts]
        )

    def _respond_in_train(self, waveform: Waveform, window_s: float, period_s: float) -> AugmentedResponse:
        """`respond` once a train of waveforms has settled: that of a recording of one period of the repeated drive."""
        step_s, hysteretic_V, sensor_V, peak_times_s, peaks_V = self._settled(waveform.drive_V, period_s, window_s)
        return AugmentedResponse(
            self, *waveform.knots(), window_s, step_s, hysteretic_V, sensor_V, peak_times_s, peaks_V
        )

    def _settled(
        self, drive_at: Callable[[ArrayLike], Real], period_s: float, window_s: float
    ) -> tuple[float, Real, Real, Real, Real]:
        """One period of a repeated drive in the steady state: that of a recording of one of its repetitions.

        Grid step in seconds; hysteretic drive and self-sensed signal at the steps, from the start to that of the next
        period; times and heights of the peaks within the window.
        """
        steps = _steps(period_s, self._step_s(period_s))
        step_s = period_s / steps
        at_nodes_V = drive_at(np.arange(steps * SUBSTEPS) * (step_s / SUBSTEPS))
        hysteretic_V, sensor_V = self._answer(at_nodes_V, step_s, "periodic", settled=True)
        beyond = np.arange(-3, steps + 2) % steps
        times_s, peaks_V = extrema(sensor_V[beyond], step_s)
        times_s = times_s - 3 * step_s
        times_s[np.abs(times_s) < step_s] = 0.0  # at the corner where the waveform starts
        counts = (times_s >= 0) & (times_s <= min(period_s - step_s, window_s))
        hysteretic_V, sensor_V = (np.append(signal_V, signal_V[0]) for signal_V in (hysteretic_V, sensor_V))
        return step_s, hysteretic_V, sensor_V, times_s[counts], peaks_V[counts]

    def respond_sampled(
        self,
        time_s: ArrayLike,
        drive_V: ArrayLike,
        initial_state: str = "periodic",
        hysteresis: str = "full_memory",
        window_s: float | None = None,
        period_s: float = math.inf,
    ) -> SampledResponse:
        """Response to a sampled drive, as in `inkjet_env.printhead.respond_sampled` with the resonator at rest.

        With a firing period, it is that of one period in the steady state of the repeated drive.
        """
        check_name("hysteresis of a printhead with effects", hysteresis, ("full_memory",))
        time, drive = check_samples(time_s, drive_V)
        if not math.isinf(period_s):
            period_s = check_period(period_s, shortest_period_s(time, drive), initial_state)
            knots_s, knots_V = one_period(time, drive, period_s)
            counted_s = period_s if window_s is None else min(_finite_window(window_s), period_s)
            step_s, _, sensor_V, peak_times_s, peaks_V = self._settled(
                lambda times_s: np.interp(np.asarray(times_s, dtype=np.float64), knots_s, knots_V), period_s, counted_s
            )
            shown_V = np.interp(knots_s[:-1], np.arange(sensor_V.size) * step_s, sensor_V)
            return SampledResponse(knots_s[:-1] + time[0], knots_V[:-1], shown_V, peak_times_s + time[0], peaks_V)
        since = time - time[0]
        end_s = float(since[-1]) if window_s is None else max(_finite_window(window_s), float(since[-1]))
        sampling_s = float(since[-1]) / (since.size - 1)
        step_s = sampling_s / math.ceil(sampling_s / self._step_s(end_s))  # so that uniform samples are on the grid
        back_s = since[-1] - since[-2]
        steps = _steps(end_s + back_s, step_s)
        times_s = np.arange(steps * SUBSTEPS) * (step_s / SUBSTEPS)
        last_s = max(end_s, float(times_s[-1]) - back_s)
        at_nodes_V = np.interp(times_s, [*since, last_s, last_s + back_s], [*drive, drive[-1], drive[0]])
        _, sensor_V = self._answer(at_nodes_V, step_s, initial_state)
        peak_times_s, peaks_V = extrema(sensor_V, step_s)
        counts = peak_times_s <= end_s
        shown_V = np.interp(since, np.arange(steps) * step_s, sensor_V)
        return SampledResponse(time, drive, shown_V, peak_times_s[counts] + time[0], peaks_V[counts])

    def costs(
        self,
        waveforms: ArrayLike,
        cost: PeakCost | None = None,
        initial_state: str = "periodic",
        window_s: float = DEFAULT_WINDOW_S,
        period_s: float = math.inf,
    ) -> Real:
        """Peak costs in volts, shape (n,), of waveforms (n, 7); some hundred times slower than with the base model."""
        rows = as_waveform_array(waveforms)
        found = (
            self.respond(Waveform.from_array(row), initial_state, window_s, period_s=period_s).cost(cost)
            for row in rows
        )
        return np.fromiter(found, dtype=np.float64, count=len(rows))

    def _step_s(self, window_s: float) -> float:
        return min(1 / (STEPS_A_PERIOD * self.frequency_Hz), window_s / STEPS_A_WINDOW)

    def _answer(self, at_nodes_V: Real, step_s: float, initial_state: str, settled: bool = False) -> tuple[Real, Real]:
        """Hysteretic drive since the start, and the self-sensed signal, both shape (steps,).

        ``settled``: the resonator is in the steady state of the repeated drive, not at rest.
        """
        if settled:
            return self._followed(at_nodes_V, step_s, initial_state, True)
        # An effect that acts before the drive begins is followed from then on.
        early = math.ceil(sum(effect.advance_s(values) for effect, values in self.effects) / step_s)
        from_then_V = np.concatenate([np.full(early * SUBSTEPS, at_nodes_V[0]), at_nodes_V])
        hysteretic_V, signal = self._followed(from_then_V, step_s, initial_state, False)
        return hysteretic_V[early:], signal[early:]

    def _followed(self, at_nodes_V: Real, step_s: float, initial_state: str, settled: bool) -> tuple[Real, Real]:
        """`_answer` from the first node on."""
        plant, head = self.plant, self.printhead
        own = None if self.remainder is None else self.remainder.of("self_sensing")
        first = Excitation(
            "self_sensing", "demagnetised", step_s, at_nodes_V[::SUBSTEPS], self.order, substeps=SUBSTEPS
        )
        first.cache["drive"] = at_nodes_V[: first.nodes]
        before = first
        if periods_before_recording(initial_state) > 0:
            before = replace(first, initial_state="periodic", cache={"drive": at_nodes_V})
        first = before if settled else first
        try:
            drive_V = plant.at_ceramic_V(before)
            # A copy, since for the commanded drive itself the powers of the law would be cached: slower, for fits only.
            repeated_V = plant.hysteretic_V(drive_V.copy(), before)
            repeated_V = repeated_V - repeated_V[0]  # zero where the head rests
            hysteretic_V = repeated_V[: first.nodes]
            resonance = _resonance(plant, repeated_V, before, first)
            if own is not None:
                return self._corrected(own, plant, resonance, drive_V, hysteretic_V, first, before)
            signal = head.b1 * resonance.motion(hysteretic_V, first)
            for effect, values in plant.of("sensing"):
                signal = effect.sensing(values, signal, drive_V[: first.nodes], head, first)
        except FloatingPointError as error:
            raise self._too_far(at_nodes_V, error) from None
        return first.sampled(hysteretic_V), signal

    @staticmethod
    def _too_far(drive_V: Real, error: FloatingPointError) -> ValueError:
        return ValueError(
            f"the printhead with its effects cannot be simulated under a drive of up to {np.abs(drive_V).max():.3g} V: "
            f"{str(error).rstrip('.')}. The effects were fitted to other drives; stay within those."
        )

    def _corrected(
        self,
        own: ChannelRemainder,
        plant: Plant,
        resonance: Resonance,
        drive_V: Real,
        hysteretic_V: Real,
        first: Excitation,
        before: Excitation,
    ) -> tuple[Real, Real]:
        """`_answer` with the pushes of a remainder, Eq. (12); both signals are zero where the head rests."""
        motion = head_motion(resonance, drive_V[: first.nodes], hysteretic_V, first)
        push_V, more = own.pushes_V(motion), own.shown_at_samples(motion)
        refitted = plant.refitted(own, "self_sensing")
        repeated_V = refitted.hysteretic_V(drive_V.copy(), before)
        repeated_V = repeated_V - repeated_V[0]
        pushed_V = repeated_V[: first.nodes] if push_V is None else repeated_V[: first.nodes] + push_V - push_V[0]
        head = refitted.printhead
        signal = head.b1 * _resonance(refitted, repeated_V, before, first).motion(pushed_V, first)
        for effect, values in refitted.of("sensing"):
            signal = effect.sensing(values, signal, drive_V[: first.nodes], head, first)
        return first.sampled(pushed_V), signal if more is None else signal + more - more[0]

    def to_json(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Write a ``printhead/1`` file atomically; options as in `as_json`."""
        write_json(path, self.as_json(**options))

    def as_json(
        self,
        intervals: Mapping[str, tuple[float, float]] | None = None,
        fit: Mapping[str, Any] | None = None,
        effect_intervals: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
    ) -> dict[str, Any]:
        """A ``printhead/1`` with the keys "effects", "order" and, if there is one, "remainder".

        A user's own effect has a "class" beside its id.

        Parameters
        ----------
        intervals, fit
            As in `Printhead.as_json`.
        effect_intervals : mapping, optional
            Interval (low, high) of each parameter in its unit, by effect and parameter; a point if not given. Infinite
            numbers are written as null.
        """
        channels = {channel: {"gain": {"value": gain}} for channel, gain in self.gains.items()}
        effects = []
        for effect, values in self.effects:
            parameters = {}
            for p in effect.parameters:
                if p.later and values[p.name] == p.plain:
                    continue
                low, high = (effect_intervals or {}).get(effect.id, {}).get(p.name, (values[p.name], values[p.name]))
                numbers = {"value": values[p.name], "low": low, "high": high}
                finite = {name: v if math.isfinite(v) else None for name, v in numbers.items()}
                parameters[p.name] = finite | {"unit": p.unit}
            named = own_class(effect)
            of_the_user = {} if named is None else {"class": named}
            effects.append({"id": effect.id, **of_the_user, "parameters": parameters})
        base = self.printhead.as_json(intervals, {"channels": channels} | dict(fit or {}))
        remainder = {} if self.remainder is None else {"remainder": self.remainder.as_json()}
        return base | {"effects": effects, "order": self.order} | remainder


@dataclass(frozen=True, eq=False)
class AugmentedResponse:
    """Response of a head with effects to a waveform; made by `AugmentedPrinthead.respond`.

    Attributes
    ----------
    printhead : AugmentedPrinthead
        The head with its effects.
    knot_times_s, knot_drive_V : ndarray, shape (6,)
        Times in seconds and commanded drive in volts at the corners of the waveform.
    window_s : float
        Window of the peaks after the waveform's start, in seconds.
    step_s : float
        Step of the grid, in seconds.
    hysteretic_at_steps_V, sensor_at_steps_V : ndarray, shape (steps,)
        Hysteretic drive and self-sensed signal at the steps of the grid, in volts.
    peak_times_s, peaks_V : ndarray, shape (k,)
        Times in seconds and signed values in volts of every local extremum of the self-sensed signal within the window,
        in time order.
    tail_V : float
        Always 0 V, since the window is finite.
    """

    printhead: AugmentedPrinthead
    knot_times_s: Real
    knot_drive_V: Real
    window_s: float
    step_s: float
    hysteretic_at_steps_V: Real
    sensor_at_steps_V: Real
    peak_times_s: Real
    peaks_V: Real
    tail_V: float = 0.0

    def drive_V(self, time_s: ArrayLike) -> Real:
        """Commanded drive in volts at times in seconds, same shape."""
        return np.interp(np.asarray(time_s, dtype=np.float64), self.knot_times_s, self.knot_drive_V, left=0.0)

    def hysteretic_V(self, time_s: ArrayLike) -> Real:
        """Hysteretic drive in volts at times in seconds, same shape; zero at the start, linear between steps."""
        return self._between(time_s, self.hysteretic_at_steps_V)

    def sensor_V(self, time_s: ArrayLike) -> Real:
        """Self-sensed signal in volts at times in seconds, same shape; linear between steps."""
        return self._between(time_s, self.sensor_at_steps_V)

    def _between(self, time_s: ArrayLike, at_steps: Real) -> Real:
        steps_s = np.arange(at_steps.size) * self.step_s
        return np.interp(np.asarray(time_s, dtype=np.float64), steps_s, at_steps, left=0.0)

    def cost(self, peak_cost: PeakCost | None = None) -> float:
        """Peak cost in volts; the default is `PeakCost()`."""
        return (peak_cost or PeakCost())(self.peaks_V)


def _resonance(plant: Plant, repeated_V: Real, before: Excitation, first: Excitation) -> Resonance:
    """Resonance after the repeated hysteretic drive, its changes of stiffness at the nodes of ``first``."""
    resonance = plant.resonance(before).refilled(repeated_V, before)
    if resonance.softening is None:
        return resonance
    return replace(resonance, softening=resonance.softening[: first.nodes])


def _finite_window(window_s: float) -> float:
    window_s = check_window(window_s)
    if math.isinf(window_s):
        raise ValueError("an infinite window needs a printhead without effects; give a time, such as 350e-6.")
    return window_s


def _steps(duration_s: float, step_s: float) -> int:
    """Number of grid steps: a few more than the duration, so that an extremum at its end is found."""
    steps = math.ceil(duration_s / step_s) + 3
    if steps > MOST_STEPS:
        raise ValueError(
            f"{duration_s:g} s are {steps} steps of {step_s:.3g} s, which a head of this frequency with effects needs; "
            f"at most {MOST_STEPS} are followed. Shorten the drive or the window."
        )
    return steps
