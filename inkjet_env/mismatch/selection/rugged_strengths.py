"""Strengths on which a signal depends in jumps: fits end at the nearest of many minima, so their values are scanned."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.plant import Effect
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.typing import Real


def rugged_starts(joint: OutputErrorFit, active: ActiveEffects) -> list[dict[str, float]]:
    """Values of the last effect with a strength switched on that is off and on which the signal depends in jumps.

    Such a strength is not found from where it is off: a little of it changes nothing.
    """
    effect, values = active.pairs[-1]
    off = [name for name in effect.rugged if values[name] == 0]
    if not off:
        return []
    excitations = [o.excitation for o in joint.seen if o.channel != "drive_monitor"]
    starts = effect.starts(joint.base.head.printhead, excitations)
    return [{**values, name: start[name]} for name in off for start in starts if start[name]]


def scanned(joint: OutputErrorFit, fit: FitResult) -> FitResult:
    """A fit, moved to the best of many values around it of every strength on which the signal depends in jumps.

    Around the best of these, closer ones are tried, and so on until jumps at the end of a recording coincide as well.
    """
    settings = joint.settings.selection
    for name in fit.active.last.rugged:
        tried, width = fit.active, settings.scan_width
        if not _around(joint, tried, name, width):
            continue
        few = _few(joint, _unit(fit.active.last, name) == "V")
        few = few.near(fit)
        while True:
            closer = _around(joint, tried, name, width)
            tried = closer[int(np.argmin([few.adapted_nll(fit, active) for active in closer]))]
            width *= 2 / settings.scan_values  # the distance of two values
            if width * _intervals(joint, tried, name) < settings.scan_precision:
                break
        moved = tried_from(joint.near(fit), tried, fit, settings.first_steps)
        if moved is not None and moved.nll < fit.nll:
            fit = moved
    return fit


def widely_scanned(joint: OutputErrorFit, effect: Effect, best: FitResult) -> FitResult | None:
    """A few steps from the best of many values over the whole range of the strengths on which signals depend in jumps.

    The values are tried with the base parameters of the best fit so far, of other effects: those of the base model are
    far off where the mismatch is large. They are tried where values that hardly differ look alike: an interval on the
    first few of its length in the recordings with the largest mismatch, a voltage on the recordings with the smallest
    drives. Those around the best one are tried on all recordings. None if the effect has no such strength or none of
    its values helps.
    """
    if not effect.rugged:
        return None
    settings, near = joint.settings.selection, joint.near(best)
    volts = {name: _unit(effect, name) == "V" for name in effect.rugged}
    few = {kind: _few(joint, kind).near(best) for kind in sorted(set(volts.values()))}
    excitations = [o.excitation for o in joint.seen if o.channel != "drive_monitor"]
    most: dict[str, tuple[float, ActiveEffects]] = {}
    for start, name in product(effect.starts(joint.base.head.printhead, excitations), effect.rugged):
        tried = few[volts[name]]
        for active in _around(joint, ActiveEffects.of([(effect, start)]), name, settings.wide_scan_width):
            explained = tried.explained_first(best, active, _first_rows(tried, active, name))
            if explained > most.get(name, (0.0,))[0]:
                most[name] = explained, active
    closer = [one for name, (_, found) in most.items() for one in _around(joint, found, name, settings.scan_width)]
    if not closer:
        return None
    losses = [near.adapted_nll(best, active) for active in closer]
    begun = tried_from(near, closer[int(np.argmin(losses))], best, settings.first_steps)
    return begun if begun is not None and begun.nll < joint.base.nll else None


def _few(joint: OutputErrorFit, volts: bool) -> OutputErrorFit:
    """The recordings on which an interval, or a voltage, is tried in its whole range."""
    chosen = sorted(joint.seen, key=lambda o: -float(np.sum(joint.base.residuals[o.name][: o.fitted] ** 2)))
    if volts:
        moving = [o for o in chosen if not o.still]
        chosen = sorted(moving, key=lambda o: float(np.abs(o.excitation.drive_V).max())) or chosen
    return joint.anew(observed=chosen[: joint.settings.selection.scan_recordings], head=joint.base.head)


def _unit(effect: Effect, name: str) -> str:
    return next(p.unit for p in effect.parameters if p.name == name)


def _samples(o: ObservedRecording, active: ActiveEffects, name: str) -> float:
    """Samples between jumps of a recording: those of an interval in seconds, or of a share of the recording."""
    value = active.pairs[-1][1][name]
    known = {"s": value / o.excitation.step_s, "1": value * o.excitation.samples}
    return known.get(_unit(active.last, name), math.inf)


def _first_rows(joint: OutputErrorFit, active: ActiveEffects, name: str) -> list[int]:
    """Numbers of fitted samples of each recording on which to try a strength: the first few of its intervals."""
    most = joint.settings.selection.scan_intervals
    return [min(o.fitted, math.ceil(min(most * _samples(o, active, name), 1e9))) for o in joint.seen]


def _intervals(joint: OutputErrorFit, active: ActiveEffects, name: str) -> float:
    """Largest number of intervals in a recording; 1 for a voltage."""
    return max([1.0, *(o.excitation.samples / max(_samples(o, active, name), 1e-9) for o in joint.seen)])


def _around(joint: OutputErrorFit, active: ActiveEffects, name: str, width: float) -> list[ActiveEffects]:
    """The same effects with many values of a strength of the last one around the given one; empty if it is off."""
    effect = active.last
    place = active.slices[effect.id].start + [p.name for p in effect.parameters].index(name)
    if active.theta[place] == 0:
        return []
    low, high = (end[place] for end in joint.limits(active.effects))
    values = active.theta[place] * np.exp(np.linspace(-width, width, joint.settings.selection.scan_values))
    return [
        active.at(np.where(np.arange(active.theta.size) == place, np.clip(v, low, high), active.theta)) for v in values
    ]


def tried_from(
    joint: OutputErrorFit,
    active: ActiveEffects,
    begin: FitResult,
    steps: int | None = None,
    whole: bool = False,
    known: Real | None = None,
) -> FitResult | None:
    """A fit that starts from another's base parameters; None if the start cannot be simulated."""
    try:
        return joint.fit(active, begin.head, most_steps=steps, whole=whole, known=known)
    except NUMERICAL:
        return None
