"""Reading ``printhead/1`` files, with effects or without."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from inkjet_env.naming import check_name
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.effect import Effect
from inkjet_env.plant.effects import catalogue
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.printhead import printhead_data

FOLLOW_THE_ORDER = ("air_bubble", "thermal_drift")
"""Effects that are nothing without knowing at which recording."""
SLACK = 1e-9
"""By how much of itself a bound may be passed: a file keeps rounded numbers."""


def read_printhead(path: str | os.PathLike[str]) -> Printhead | AugmentedPrinthead:
    """The head of a ``printhead/1`` file: augmented where it has effects.

    Raises
    ------
    ValueError
        What `Printhead.from_json` refuses; an effect that is not in the catalogue, a parameter that is missing or out
        of bounds. The message names the file.
    """
    data = printhead_data(path)
    try:
        return printhead_of(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def printhead_of(data: Mapping[str, Any]) -> Printhead | AugmentedPrinthead:
    """The head that a ``printhead/1`` file's content describes; ``ValueError`` names the rule it breaks."""
    base = Printhead.from_data(data)
    entries = data.get("effects") or []
    if not entries:
        return base
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError('effects must be a list of {"id", "parameters"}.')
    known = {effect.id: effect for effect in catalogue()}
    for entry in entries:
        check_name("the id of an effect", entry.get("id"), known)
    effects = tuple((known[entry["id"]], _values(known[entry["id"]], entry.get("parameters"))) for entry in entries)
    ids = [effect.id for effect, _ in effects]
    if len(set(ids)) < len(ids):
        raise ValueError(f"effects must each be there once; got {', '.join(ids)}.")
    return AugmentedPrinthead(base, effects, _gains(data.get("fit")), _order(data, ids))


def _values(effect: Effect, parameters: Any) -> dict[str, float]:
    values = {}
    for parameter in effect.parameters:
        label = f"effect {effect.id}, parameter {parameter.name}"
        entry = parameters.get(parameter.name) if isinstance(parameters, dict) else None
        if not isinstance(entry, dict) or "value" not in entry:
            raise ValueError(f'{label}: is missing. It must have a "value" in {parameter.unit}.')
        value = entry["value"]
        if value is None and parameter.scale == "reciprocal":  # JSON has no infinity
            value = math.inf
        if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
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
    """Gains of the channels that the head was identified from."""
    channels = fit.get("channels") if isinstance(fit, dict) else None
    gains = {}
    for channel, entry in channels.items() if isinstance(channels, dict) else ():
        gain = entry.get("gain") if isinstance(entry, dict) else None
        value = gain.get("value") if isinstance(gain, dict) else None
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise ValueError(f"fit.channels.{channel}.gain.value must be a finite number; got {value!r}.")
        gains[channel] = float(value)
    return gains


def _order(data: Mapping[str, Any], ids: list[str]) -> int:
    order = data.get("order")
    if order is None and not set(ids) & set(FOLLOW_THE_ORDER):
        return 1
    if isinstance(order, bool) or not isinstance(order, int) or order < 1:
        raise ValueError(
            f'"order" must be a whole number from 1 on, of the recording whose head is meant; got {order!r}. '
            "Give that of the last recording."
        )
    return order


def chosen_head(path: Path | None) -> Printhead | AugmentedPrinthead:
    """The head of a printhead.json, with its effects where it has such; or the published one."""
    return Printhead.published() if path is None else read_printhead(path)
