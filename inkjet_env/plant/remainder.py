"""The remainder: a small discrepancy model beside the named effects, which corrects without explaining.

A remainder is linear in its weights. Its features are functions of what the head with its effects does in a free-run
simulation, never of a measured signal or of the order of the recordings. They act in two places. A *push* is added to
the hysteretic drive and the head is simulated once more with it, which is as stable as the head itself,

    y = g · M[v + Σ_i p_i φ_i(M[v])] + o + Σ_j s_j ψ_j(M[v]),                                                  (12)

with the motion M of the head with its effects under the hysteretic drive v, and the channel's gain g and offset o (its
sensor's effects are left out here). The base parameters of the outer M, g and o are fitted together with the weights:
without a remainder they have absorbed a part of what it explains. Extrapolation is bounded three times: signals,
features and the two sums are each limited to what the fitted recordings contain. Under a larger drive the remainder no
longer grows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from inkjet_env.plant.head_motion import SIGNALS, HeadMotion
from inkjet_env.plant.remainder_features import TIMES, feature, push_names, shown_names
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

FORMAT = "remainder/1"
"""Format of the key "remainder" of a ``printhead/1``."""
CHANNELS = ("self_sensing", "displacement", "strain_gauge")
"""Channels that may have a remainder."""
MOST_TIMES = 100
"""Largest length of a list of times or thresholds."""


@dataclass(frozen=True)
class Term:
    """One feature with its weight.

    Parameters
    ----------
    weight : float
        Its largest contribution in the fitted recordings, in the unit of the sum.
    largest : float
        Its largest magnitude there, above 0: it is divided by this and limited to the range from -1 to 1.
    """

    weight: float
    largest: float


@dataclass(frozen=True)
class RefittedBase:
    """Parameters of the base model as they are beside a remainder, fitted together with it.

    Parameters
    ----------
    a0, a1, b1 : float
        The resonator, in 1/s² and 1/s, and the gain of self-sensing, in 1/s.
    coefficients : tuple of float
        Coefficients of the branch law, highest power first.
    gain : float
        Gain of the channel, in its unit per hysteretic volt (self-sensing: ``b1``).
    offset_change : float
        Change of the channel's offset, in its unit.
    """

    a0: float
    a1: float
    b1: float
    coefficients: tuple[float, ...]
    gain: float
    offset_change: float

    def of(self, head: Printhead) -> Printhead:
        """A head with these parameters instead of its own; one without dynamics keeps having none."""
        dynamics = {"a0": self.a0, "a1": self.a1, "b1": self.b1} if head.has_dynamics else {}
        return replace(head, coefficients=self.coefficients, **dynamics)


@dataclass(frozen=True, eq=False)
class ChannelRemainder:
    """The remainder of one channel.

    Parameters
    ----------
    scales_V : mapping of str to float
        Largest magnitude in the fitted recordings of each of the head's `SIGNALS` that the channel has, in volts.
    push : mapping of str to Term
        Features that are added to the hysteretic drive, weights in hysteretic volts; fast channels only.
    shown : mapping of str to Term
        Features that are added to the channel's signal, weights in its unit.
    times : mapping of str to tuple of float
        Lists of `TIMES`: delays of the copies of the drive and of the motion and time constants of lags, in seconds;
        thresholds of plays, dimensionless shares of the largest drive.
    most_push_V, most_shown : float
        Limits of the magnitude of the two sums, in hysteretic volts and in the channel's unit; null in a file if
        infinite.
    base : RefittedBase, optional
        Base parameters with which the channel is simulated; those of the head unless given. What a head does, of which
        the features are functions, is always simulated with the head's own.
    """

    scales_V: Mapping[str, float]
    push: Mapping[str, Term]
    shown: Mapping[str, Term]
    times: Mapping[str, tuple[float, ...]]
    most_push_V: float = math.inf
    most_shown: float = math.inf
    base: RefittedBase | None = None

    @cached_property
    def is_zero(self) -> bool:
        """Whether no weight differs from 0."""
        return not any(term.weight for term in (*self.push.values(), *self.shown.values()))

    def pushes_V(self, motion: HeadMotion) -> Real | None:
        """Addition to the hysteretic drive at the nodes, shape (nodes,), in volts; None if there is none."""
        return self._sum(self.push, self.most_push_V, motion)

    def shown_at_samples(self, motion: HeadMotion) -> Real | None:
        """Addition to the sensor's signal at the samples, shape (n,), in the channel's unit; None if there is none."""
        total = self._sum(self.shown, self.most_shown, motion)
        return None if total is None else motion.excitation.sampled(total)

    def _sum(self, terms: Mapping[str, Term], most: float, motion: HeadMotion) -> Real | None:
        used = {name: term for name, term in terms.items() if term.weight}
        if not used:
            return None
        scaled = motion.scaled(self.scales_V)
        total = np.zeros(motion.excitation.nodes)
        for name, term in used.items():
            total += term.weight * np.clip(feature(name, scaled, self.times) / term.largest, -1.0, 1.0)
        return np.clip(total, -most, most)


@dataclass(frozen=True, eq=False)
class Remainder:
    """The remainder of a head, by channel.

    Parameters
    ----------
    channels : mapping of str to ChannelRemainder
        Channels without one are simulated as without a remainder.
    """

    channels: Mapping[str, ChannelRemainder] = field(default_factory=dict)

    def of(self, channel: str) -> ChannelRemainder | None:
        """The remainder of a channel; None if it has none, or nothing but zeros."""
        found = self.channels.get(channel)
        return None if found is None or found.is_zero else found

    @property
    def size(self) -> int:
        """Number of features of all channels."""
        return sum(len(own.push) + len(own.shown) for own in self.channels.values())

    @property
    def largest_drive_V(self) -> dict[str, float]:
        """Largest drive of the fitted recordings of each channel, in volts; beyond it the remainder no longer grows."""
        return {channel: own.scales_V["drive"] for channel, own in self.channels.items()}

    def as_json(self) -> dict[str, Any]:
        """The remainder as ``remainder/1``: plain numbers."""
        channels = {}
        for channel, own in self.channels.items():
            channels[channel] = {
                "scales_V": dict(own.scales_V),
                **{name: list(own.times[name]) for name in TIMES},
                "push": {name: asdict(term) for name, term in own.push.items()},
                "shown": {name: asdict(term) for name, term in own.shown.items()},
                "most_push_V": own.most_push_V if math.isfinite(own.most_push_V) else None,  # JSON has no infinity
                **(
                    {}
                    if own.base is None
                    else {"base": asdict(own.base) | {"coefficients": list(own.base.coefficients)}}
                ),
                "most_shown": own.most_shown if math.isfinite(own.most_shown) else None,
            }
        return {"format": FORMAT, "channels": channels}


def remainder_of(data: Any) -> Remainder:
    """The remainder described by a ``remainder/1``.

    Raises
    ------
    ValueError
        It is malformed; the message names the broken rule.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        got = data.get("format") if isinstance(data, dict) else data
        raise ValueError(f'remainder: its "format" must be "{FORMAT}"; got {str(got)[:40]!r}. Diagnose again.')
    channels = data.get("channels")
    if not isinstance(channels, dict):
        raise ValueError('remainder: must have "channels", an object with one entry per channel.')
    found = {}
    for channel, entry in channels.items():
        if channel not in CHANNELS:
            raise ValueError(f"remainder: {channel[:40]!r} is not a channel; it must be one of {', '.join(CHANNELS)}.")
        found[channel] = _channel(f"remainder of {channel}", entry)
    return Remainder(found)


def _channel(label: str, entry: Any) -> ChannelRemainder:
    if not isinstance(entry, dict):
        raise ValueError(f"{label}: must be an object.")
    scales_V = _numbers(f"{label}: scales_V", entry.get("scales_V"), SIGNALS)
    fast = "deflection" in scales_V
    needed = SIGNALS if fast else SIGNALS[:2]
    if set(scales_V) != set(needed):
        raise ValueError(f"{label}: scales_V must give {', '.join(needed)}; got {', '.join(scales_V) or 'none'}.")
    if wrong := [name for name, value in scales_V.items() if value <= 0]:
        raise ValueError(f"{label}: the scale of {wrong[0]} must be above 0 V; got {scales_V[wrong[0]]:g}.")
    times = {name: _list(f"{label}: {name}", entry.get(name)) for name in TIMES}
    for name in ("lags_s", "plays"):
        if any(value < 0 for value in times[name]):
            raise ValueError(f"{label}: {name} must not be negative; got {min(times[name]):g}.")
    push = _terms(f"{label}: push", entry.get("push"), push_names(times) if fast else ())
    shown = _terms(f"{label}: shown", entry.get("shown"), shown_names(times, fast))
    limits = {name: entry.get(name) for name in ("most_push_V", "most_shown")}
    push_V, added = (math.inf if v is None else _number(f"{label}: {name}", v) for name, v in limits.items())
    if min(push_V, added) < 0:
        raise ValueError(f"{label}: most_push_V and most_shown must not be negative; got {min(push_V, added):g}.")
    return ChannelRemainder(scales_V, push, shown, times, push_V, added, _base(f"{label}: base", entry.get("base")))


def _base(label: str, entry: Any) -> RefittedBase | None:
    if entry is None:
        return None
    names = [part.name for part in fields(RefittedBase) if part.name != "coefficients"]
    known = _known(label, entry, [*names, "coefficients"])
    if missing := [name for name in (*names, "coefficients") if name not in known]:
        raise ValueError(f"{label}: {missing[0]} is missing.")
    numbers = {name: _number(f"{label}, {name}", known[name]) for name in names}
    base = RefittedBase(**numbers, coefficients=_list(f"{label}, coefficients", known["coefficients"]))
    try:
        base.of(Printhead.published())
    except ValueError as error:
        raise ValueError(f"{label}: {error}") from None
    return base


def _terms(label: str, data: Any, names: Sequence[str]) -> dict[str, Term]:
    terms = {}
    for name, entry in _known(label, data, names).items():
        numbers = _numbers(f"{label}, {name}", entry, ("weight", "largest"))
        if len(numbers) < 2 or numbers["largest"] <= 0:
            raise ValueError(f'{label}, {name}: needs a "weight", and a "largest" above 0.')
        terms[name] = Term(**numbers)
    return terms


def _numbers(label: str, data: Any, names: Sequence[str]) -> dict[str, float]:
    return {name: _number(f"{label}, {name}", value) for name, value in _known(label, data, names).items()}


def _known(label: str, data: Any, names: Sequence[str]) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise ValueError(f"{label}: must be an object with names; got {str(data)[:40]}.")
    if unknown := [name for name in data if name not in names]:
        raise ValueError(f"{label}: {unknown[0][:40]!r} is not a known name. The file may be of a newer version.")
    return data


def _list(label: str, data: Any) -> tuple[float, ...]:
    if not isinstance(data, list) or len(data) > MOST_TIMES:
        raise ValueError(f"{label}: must be a list of at most {MOST_TIMES} numbers; got {str(data)[:40]}.")
    return tuple(_number(label, value) for value in data)


def _number(label: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{label}: must be a finite number; got {str(value)[:40]}.")
    return float(value)
