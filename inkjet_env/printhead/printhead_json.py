"""Content of a ``printhead/1`` file: read from JSON, and each of its entries checked."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

LARGEST_FILE = 50_000_000
"""Size in bytes above which a file is no printhead."""


def printhead_data(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Content of a ``printhead/1`` file; ``ValueError`` names the file if it is not one."""
    file = Path(path)
    if file.exists() and not file.is_file():
        raise ValueError(f"{path}: must be a file; it is a folder, a pipe or a device. Is this a printhead file?")
    try:
        if (size := file.stat().st_size) > LARGEST_FILE:
            raise ValueError(f"{path}: holds {size:,} bytes, more than any printhead. Is this a printhead file?")
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise ValueError(f"{path}: cannot be read: {reason}. Check the file's name.") from None
    try:
        data: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: is not JSON ({error}). Is this a printhead file?") from None
    if not isinstance(data, dict) or data.get("format") != "printhead/1":
        got = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise ValueError(f'{path}: "format" must be "printhead/1"; got {got!r}. Is this a printhead file?')
    return data


def effect_ids(data: Mapping[str, Any]) -> list[str]:
    """Ids of the effects in the content of a ``printhead/1`` file; empty for the base model."""
    effects = data.get("effects") or []
    if not isinstance(effects, list):
        return ["effects"]
    return [str(entry.get("id")) if isinstance(entry, dict) else "?" for entry in effects]


def parameters_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a `Printhead`, by name, in the content of a ``printhead/1`` file; `ValueError` names the rule.

    Those of the dynamics are absent if all three are null: nothing fast was recorded.
    """
    names = ("a0", "a1", "b1")
    values: dict[str, Any] = {}
    if any(_entry(data, "dynamics", name, "value") is not None for name in names):
        values = {name: _number(data, "dynamics", name, "value") for name in names}
    values["full_scale_V"] = _number(data, "hysteresis", "full_scale_V")
    coefficients = _entry(data, "hysteresis", "coefficients")
    if not isinstance(coefficients, list):
        raise ValueError(f"hysteresis.coefficients must be a list of numbers; got {coefficients!r}.")
    values["coefficients"] = tuple(_number({"coefficients": c}, "coefficients") for c in coefficients)
    return values


def _entry(data: Any, *keys: str) -> Any:
    """Entry of a ``printhead/1`` file under nested keys."""
    for depth, key in enumerate(keys):
        if not isinstance(data, dict) or key not in data:
            raise ValueError(f"has no {'.'.join(keys[: depth + 1])}, which a printhead/1 file needs.")
        data = data[key]
    return data


def _number(data: Any, *keys: str) -> float:
    value = _entry(data, *keys)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or abs(value) > 1e300:
        raise ValueError(f"{'.'.join(keys)} must be a number; got {str(value)[:40]}.")
    return float(value)
