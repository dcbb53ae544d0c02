"""The cascade on sampled signals: drive → hysteresis → resonator → sensing, each stage with its effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inkjet_env.plant.effect import Effect, Values
from inkjet_env.plant.errors import EffectError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.head_motion import HeadMotion, head_motion
from inkjet_env.plant.remainder import ChannelRemainder, Remainder
from inkjet_env.plant.resonance import Resonance
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class Plant:
    """A head with its sensors and the effects that are on.

    Parameters
    ----------
    printhead : Printhead
        Base model of the head.
    gains : mapping of str to float
        Gains of strain gauge and displacement, in the channel's unit per hysteretic volt; that of self-sensing is
        ``b1``.
    offsets : mapping of str to float
        Offset of each channel, in its unit.
    effects : tuple of (Effect, values)
        Effects that are on, each with the values of all its parameters in their units.
    remainder : Remainder, optional
        Discrepancy model that corrects the signal of some channels.
    """

    printhead: Printhead
    gains: Mapping[str, float] = field(default_factory=dict)
    offsets: Mapping[str, float] = field(default_factory=dict)
    effects: tuple[tuple[Effect, Values], ...] = ()
    remainder: Remainder | None = None

    def of(self, stage: str) -> Sequence[tuple[Effect, Values]]:
        """The effects of a stage, in the given order."""
        return [(effect, values) for effect, values in self.effects if effect.acts_in(stage)]

    def gain(self, channel: str) -> float:
        """Gain in the channel's unit per hysteretic volt (self-sensing: ``b1``, per V/s; drive monitor: per volt)."""
        if channel == "self_sensing":
            return self.printhead.b1
        return self.gains.get(channel, 1.0)

    def signal(self, excitation: Excitation) -> Real:
        """Noise-free sensor signal at the samples, shape (n,), in the channel's unit.

        Raises
        ------
        SimulationError
            The motion grows without bound, never settles under the repeated drive, or has no rest position under the
            drive at the start.
        """
        drive_V = self.at_ceramic_V(excitation)
        if excitation.channel == "drive_monitor":
            return self.gain(excitation.channel) * excitation.sampled(drive_V) + self.offsets.get(
                excitation.channel, 0.0
            )
        own = None if self.remainder is None else self.remainder.of(excitation.channel)
        if own is None:
            return self.shown(self.motion(drive_V, excitation), drive_V, excitation)
        hysteretic_V = self.hysteretic_V(drive_V, excitation)
        before = self.head_motion(drive_V, hysteretic_V, excitation)
        push_V, more = own.pushes_V(before), own.shown_at_samples(before)
        refitted = self.refitted(own, excitation.channel)
        pushed_V = hysteretic_V if refitted is self else refitted.hysteretic_V(drive_V, excitation)
        pushed_V = pushed_V if push_V is None else pushed_V + push_V
        signal = refitted.shown(refitted.motion_under(pushed_V, excitation), drive_V, excitation)  # Eq. (12)
        return signal if more is None else signal + more

    def refitted(self, own: ChannelRemainder, channel: str) -> Plant:
        """The same plant with the base parameters that belong to a channel's remainder."""
        if own.base is None:
            return self
        gains = self.gains if channel == "self_sensing" else {**self.gains, channel: own.base.gain}
        offsets = {**self.offsets, channel: self.offsets.get(channel, 0.0) + own.base.offset_change}
        return replace(self, printhead=own.base.of(self.printhead), gains=gains, offsets=offsets)

    def shown(self, motion: Real, drive_V: Real, excitation: Excitation) -> Real:
        """Sensor signal of a `motion` at the samples, shape (n,), in the channel's unit."""
        signal = self.gain(excitation.channel) * motion + self.offsets.get(excitation.channel, 0.0)
        for effect, values in self.of("sensing"):
            shown = effect.sensing(values, signal, drive_V, self.printhead, excitation)
            signal = _like(signal, shown, effect, "sensing")
        return signal

    def head_motion(self, drive_V: Real, hysteretic_V: Real, excitation: Excitation) -> HeadMotion:
        """What the head does under this drive at the ceramic, without a remainder."""
        resonance = self.resonance(excitation) if excitation.fast else None
        return head_motion(resonance, drive_V, hysteretic_V, excitation)

    def at_ceramic_V(self, excitation: Excitation) -> Real:
        """Voltage at the ceramic, at the nodes, shape (nodes,)."""
        drive_V = excitation.drive_at_nodes_V
        for effect, values in self.of("drive"):
            drive_V = _like(drive_V, effect.drive(values, drive_V, excitation), effect, "drive")
        return drive_V

    def motion(self, drive_V: Real, excitation: Excitation) -> Real:
        """Motion as a channel shows it for a gain of 1 and no offset, at the samples, shape (n,)."""
        return self.motion_under(self.hysteretic_V(drive_V, excitation), excitation)

    def motion_under(self, hysteretic_V: Real, excitation: Excitation) -> Real:
        """`motion` under a hysteretic drive at the nodes."""
        if not excitation.fast:
            return excitation.sampled(hysteretic_V)
        return self.resonance(excitation).motion(hysteretic_V, excitation)

    def resonance(self, excitation: Excitation) -> Resonance:
        """Resonance of the head in this recording, with its effects."""
        resonance = Resonance(self.printhead.a0, self.printhead.a1, self.printhead.a0)
        for effect, values in self.of("resonator"):
            resonance = effect.resonator(values, resonance, excitation)
            if not isinstance(resonance, Resonance):
                got = type(resonance).__name__
                raise EffectError(
                    f"effect {effect.id!r}: its resonator() must return a Resonance; got {got}. Correct the effect."
                )
        return resonance

    def motion_of_power(self, power: int, excitation: Excitation) -> Real:
        """`motion` of the base model under a single power of the law (0: the first), for a coefficient of 1."""
        levels = np.ascontiguousarray(law_powers(self.printhead, excitation)[:, power])
        if not excitation.fast:
            return excitation.sampled(levels)
        return Resonance(self.printhead.a0, self.printhead.a1, self.printhead.a0).motion(levels, excitation)

    def hysteretic_V(self, drive_V: Real, excitation: Excitation) -> Real:
        """Hysteretic drive in volts at the nodes, shape (nodes,)."""
        return self.after_law_V(law_levels(drive_V, self.printhead, excitation), drive_V, excitation)

    def after_law_V(self, hysteretic_V: Real, drive_V: Real, excitation: Excitation) -> Real:
        """`hysteretic_V` from the output of the branch law alone at the nodes, in volts."""
        for effect, values in self.of("hysteresis"):
            changed_V = effect.hysteresis(values, hysteretic_V, drive_V, self.printhead, excitation)
            hysteretic_V = _like(hysteretic_V, changed_V, effect, "hysteresis")
        return hysteretic_V

    def with_effects(self, effects: Sequence[tuple[Effect, Values]]) -> Plant:
        """The same head with these effects on instead."""
        return replace(self, effects=tuple(effects))


def _like(before: Real, after: Real, effect: Effect, stage: str) -> Real:
    """Return the signal ``after`` an effect; `EffectError` unless its shape is that of the one ``before``."""
    if np.shape(after) != before.shape:
        raise EffectError(
            f"effect {effect.id!r}: its {stage}() must return an array of shape {before.shape}, as it is given; "
            f"got {'None' if after is None else f'shape {np.shape(after)}'}. Correct the effect."
        )
    return after


def law_levels(drive_V: Real, printhead: Printhead, excitation: Excitation) -> Real:
    """Hysteretic drive of the branch law for a voltage at the nodes, in volts, shape (nodes,)."""
    law = printhead.branch_law.ascending
    if drive_V is not excitation.drive_at_nodes_V:
        return _levels(drive_V, printhead.full_scale_V, law[None, :], excitation.periodic)[:, 0]
    asked = (printhead.full_scale_V, law.tobytes())
    known, levels = excitation.cache.get("levels", (None, None))
    if known != asked:  # the fits of an effect's parameters leave the law as it is
        levels = law_powers(printhead, excitation) @ law[1:]
        excitation.cache["levels"] = asked, levels
    found: Real = levels
    return found


def law_changes(drive_V: Real, printhead: Printhead, excitation: Excitation, changes: Real) -> Real:
    """Change of `law_levels` with the law, shape (nodes, k), for changes of its coefficients, shape (degree, k)."""
    if drive_V is excitation.drive_at_nodes_V:
        levels: Real = law_powers(printhead, excitation) @ changes
        return levels
    laws = np.column_stack([np.zeros(changes.shape[1]), changes.T])
    return _levels(drive_V, printhead.full_scale_V, laws, excitation.periodic)


def law_powers(printhead: Printhead, excitation: Excitation) -> Real:
    """Hysteretic drive of each power of the law for the commanded drive, shape (nodes, degree); cached with it."""
    degree = len(printhead.coefficients) - 1
    key = ("powers", printhead.full_scale_V, degree)
    if key not in excitation.cache:
        excitation.cache[key] = _levels(
            excitation.drive_at_nodes_V, printhead.full_scale_V, np.eye(degree + 1)[1:], excitation.periodic
        )
    powers: Real = excitation.cache[key]
    return powers


def _levels(drive_V: Real, full_scale_V: float, laws: Real, periodic: bool) -> Real:
    from inkjet_env.plant import compiled

    ends = np.append(drive_V, drive_V[0]) if periodic else np.ascontiguousarray(drive_V)
    memory, pieces = np.empty(2 * ends.size + 4), np.empty((4 * ends.size + 32, 6))
    levels = np.empty((ends.size, len(laws)))
    compiled.hysteretic_levels(ends, full_scale_V, laws, periodic, memory, pieces, levels)
    return levels[: drive_V.size]
