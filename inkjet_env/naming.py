"""Checks of names against the known ones, with an error that suggests the nearest."""

from __future__ import annotations

from collections.abc import Iterable


def nearest_name(given: str, known: Iterable[str]) -> str:
    """Return " Did you mean 'x'?" for the known name nearest to the given one, or an empty string."""
    from rapidfuzz import fuzz, process

    match = process.extractOne(given, list(known), scorer=fuzz.ratio, processor=str.lower, score_cutoff=55)
    return f" Did you mean {match[0]!r}?" if match else ""


def check_name(label: str, given: object, known: Iterable[str]) -> None:
    """Raise ``ValueError`` unless ``given`` is one of the ``known`` names; the message suggests the nearest."""
    known = tuple(known)
    if given not in known:
        raise ValueError(f"{label} must be one of {', '.join(known)}; got {given!r}.{nearest_name(str(given), known)}")
