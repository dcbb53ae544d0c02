"""The score of a proof for people, on a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def figure_text(value: float | None, kind: str) -> str:
    """A figure for people.

    Examples
    --------
    >>> figure_text(0.0267, "share"), figure_text(1.25, "number"), figure_text(None, "number")
    ('2.7 %', '1.25', '–')
    """
    if value is None:
        return "–"
    return f"{100 * value:.1f} %" if kind == "share" else f"{value:.3g}"


def print_score(found: Mapping[str, Any]) -> None:
    """Print the table, and how many figures fall short."""
    from experiments.tables import print_table

    marks = {True: "yes", False: "SHORT", None: ""}
    rows = []
    for figure in found["figures"]:
        if figure["of"]:
            value, low, high = (figure_text(figure[name], figure["kind"]) for name in ("value", "low", "high"))
            count = f"{figure['hits']}/{figure['of']}" if figure["hits"] is not None else str(figure["of"])
            rows.append((figure["name"], value, f"{low} … {high}", count, figure["asked"], marks[figure["met"]]))
    print_table(("figure", "reached", "90 % interval", "cases", "asked", "met"), rows)
    judged = [figure for figure in found["figures"] if figure["met"] is not None]
    print(f"{len(judged) - len(found['short'])} of {len(judged)} figures are what is asked of a first-rate diagnosis.")
    print(f"Truth sealed as {found['truth_sha256']}, answers as {found['answers_sha256']}.")
