"""Checks of names against the known ones, with an error that suggests the nearest."""

from __future__ import annotations

from collections.abc import Iterable

LEAST_LIKENESS = 0.55
"""Least share of letters in common for a name to be suggested."""


def nearest_name(given: str, known: Iterable[str]) -> str:
    """Return " Did you mean 'x'?" for the known name nearest to the given one, or an empty string."""
    from difflib import SequenceMatcher

    def likeness(name: str) -> float:
        return SequenceMatcher(None, name.lower(), given.lower(), autojunk=False).ratio()

    match = max(known, key=likeness, default="")
    return f" Did you mean {match!r}?" if likeness(match) >= LEAST_LIKENESS else ""


def check_name(label: str, given: object, known: Iterable[str]) -> None:
    """Raise ``ValueError`` unless ``given`` is one of the ``known`` names; the message suggests the nearest."""
    known = tuple(known)
    if given not in known:
        shown = repr(given) if len(repr(given)) <= 60 else f"{repr(given)[:57]}…"
        raise ValueError(
            f"{label} must be one of {', '.join(known)}; got {shown}.{nearest_name(str(given)[:60], known)}"
        )
