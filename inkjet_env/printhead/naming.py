"""The nearest known name, for errors that say what was probably meant."""

from __future__ import annotations

from collections.abc import Iterable


def nearest_name(given: str, known: Iterable[str]) -> str:
    """Return " Did you mean 'x'?" for the known name nearest to the given one, or an empty string."""
    from rapidfuzz import process

    match = process.extractOne(given, list(known), score_cutoff=60)
    return f" Did you mean {match[0]!r}?" if match else ""
