"""Reading of ``printhead/1`` files: with or without a remainder, and effects of the catalogue or of the user's own."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from inkjet_env.naming import check_name
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.effect import Effect, Values
from inkjet_env.plant.effects import catalogue
from inkjet_env.plant.registry import UnregisteredEffectError, known_effects, own_class, registered_effect
from inkjet_env.plant.remainder import remainder_of
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.printhead_json import printhead_data

CLASS = r"\w+(\.\w+)*:\w[\w.<>]*"
"""Pattern of ``module:Class`` of a user's own effect."""
SLACK = 1e-9
"""Relative excess over a bound that is accepted, since a file holds rounded numbers."""


def read_printhead(path: str | os.PathLike[str]) -> Printhead | AugmentedPrinthead:
    """The head of a ``printhead/1`` file: augmented if it has effects or a remainder.

    Raises
    ------
    ValueError
        Anything that `Printhead.from_json` refuses; an effect that is not in the catalogue; a parameter that is missing
        or out of bounds; a malformed remainder. The message names the file.
    UnregisteredEffectError
        A user's own effect whose class is not registered in this process; see `inkjet_env.plant.register`. It is a
        ``ValueError``.
    """
    data = printhead_data(path)
    try:
        return printhead_of(data)
    except UnregisteredEffectError as error:
        raise UnregisteredEffectError(f"{path}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def printhead_of(data: Mapping[str, Any]) -> Printhead | AugmentedPrinthead:
    """The head described by the content of a ``printhead/1`` file; ``ValueError`` names the broken rule."""
    base = Printhead.from_data(data)
    entries = data.get("effects") or []
    remainder = None if data.get("remainder") is None else remainder_of(data["remainder"])
    if not entries and remainder is None:
        return base
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError('effects must be a list of {"id", "parameters"}.')
    found = [_effect(entry) for entry in entries]
    ids = [effect.id for effect in found]
    if len(set(ids)) < len(ids):
        raise ValueError(f"each effect may occur only once; got {', '.join(ids)}.")
    values = [_values(effect, entry.get("parameters")) for effect, entry in zip(found, entries, strict=True)]
    effects = tuple(zip(found, values, strict=True))
    return AugmentedPrinthead(base, effects, _gains(data.get("fit")), _order(data, effects), remainder)


def _effect(entry: Mapping[str, Any]) -> Effect:
    """The effect of the catalogue with an entry's id; if the entry names a class, the registered effect."""
    known = {effect.id: effect for effect in catalogue()}
    effect_id = entry.get("id")
    if "class" not in entry:
        own = next((effect for effect in known_effects() if effect.id == effect_id), None)
        if own is not None and effect_id not in known:
            raise ValueError(f'effect {effect_id!r} is not in the catalogue, so it needs "class": "{own_class(own)}".')
        check_name("the id of an effect", effect_id, known)
        return known[str(effect_id)]
    named = entry["class"]
    if not isinstance(named, str) or not re.fullmatch(CLASS, named):
        raise ValueError(f'the "class" of an effect must read module:Class; got {str(named)[:40]!r}.')
    if not isinstance(effect_id, str):
        raise ValueError(f"the id of an effect must be a string; got {str(effect_id)[:40]!r}.")
    if effect_id in known:
        raise ValueError(
            f"effect {effect_id!r} is in the catalogue, but the class {named} is named. Give that class a unique "
            "id and write the file again."
        )
    return registered_effect(effect_id, named)


def _values(effect: Effect, parameters: Any) -> dict[str, float]:
    values = {}
    for parameter in effect.parameters:
        label = f"effect {effect.id}, parameter {parameter.name}"
        entry = parameters.get(parameter.name) if isinstance(parameters, dict) else None
        if entry is None and isinstance(parameters, dict) and parameter.later and parameter.plain is not None:
            values[parameter.name] = parameter.plain
            continue
        if not isinstance(entry, dict) or "value" not in entry:
            raise ValueError(f'{label}: is missing. It must have a "value" in {parameter.unit}.')
        value = entry["value"]
        if value is None and parameter.scale == "reciprocal":  # JSON has no infinity
            value = math.inf
        too_large = isinstance(value, int) and abs(value) > 10**300
        if isinstance(value, bool) or not isinstance(value, (int, float)) or too_large or math.isnan(value):
            raise ValueError(f"{label}: must be a number; got {str(value)[:40]}.")
        if not parameter.low <= value <= parameter.high:
            nearest = min(max(value, parameter.low), parameter.high)
            if not math.isclose(value, nearest, rel_tol=SLACK):
                raise ValueError(
                    f"{label}: must be {parameter.low:g} to {parameter.high:g} {parameter.unit}; got {value:g}."
                )
            value = nearest
        values[parameter.name] = float(value)
    return values


def _gains(fit: Any) -> dict[str, float]:
    """Gains of the channels from which the head was identified, in their units per hysteretic volt."""
    channels = fit.get("channels") if isinstance(fit, dict) else None
    gains = {}
    for channel, entry in channels.items() if isinstance(channels, dict) else ():
        gain = entry.get("gain") if isinstance(entry, dict) else None
        value = gain.get("value") if isinstance(gain, dict) else None
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise ValueError(f"fit.channels.{channel}.gain.value must be a finite number; got {value!r}.")
        gains[channel] = float(value)
    return gains


def _order(data: Mapping[str, Any], effects: Sequence[tuple[Effect, Values]]) -> int:
    order = data.get("order")
    if order is None and not any(effect.depends_on_order for effect, _ in effects):
        return 1
    if isinstance(order, bool) or not isinstance(order, int) or order < 1:
        raise ValueError(
            f'"order" must be a whole number of at least 1, the order of the recording whose head is described; '
            f"got {order!r}. Give that of the last recording."
        )
    return order


def chosen_head(path: Path | None, remainder: bool = True) -> Printhead | AugmentedPrinthead:
    """The head of a printhead.json, with its effects if it has any; without a path, the published head.

    Parameters
    ----------
    path : Path, optional
        The file.
    remainder : bool
        Whether to keep the remainder that the file may have.
    """
    head = Printhead.published() if path is None else read_printhead(path)
    if remainder or not isinstance(head, AugmentedPrinthead) or head.remainder is None:
        return head
    return head.without_remainder() if head.effects else head.printhead


def remainder_sentence(head: Printhead | AugmentedPrinthead, channels: Collection[str], largest_V: float) -> str | None:
    """What a user must know of a head's remainder in a simulation; None if it has none.

    Parameters
    ----------
    head : Printhead or AugmentedPrinthead
        The simulated head.
    channels : collection of str
        Simulated channels.
    largest_V : float
        Largest magnitude of the drive, in volts.
    """
    if not isinstance(head, AugmentedPrinthead) or head.remainder is None:
        return None
    used = sorted(set(channels) & set(head.remainder.channels))
    if not used:
        return f"The head's unexplained remainder is for {', '.join(head.remainder.channels)}; it changes nothing here."
    said = "The head's unexplained remainder is used; --no-remainder leaves it away."
    fitted_V = min(head.remainder.largest_drive_V[channel] for channel in used)
    if largest_V > fitted_V * (1 + SLACK):
        said += f" It was fitted to drives of up to {fitted_V:.4g} V and no longer grows beyond them."
    return said
