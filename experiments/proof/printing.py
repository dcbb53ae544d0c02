"""The score of a proof, printed on a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from inkjet_env.experiments.proof.adaptive import gains

Table = tuple[tuple[str, ...], list[tuple[str, ...]]]
"""Headings and rows."""


def figure_text(value: float | None, kind: str) -> str:
    """A figure as text: a proportion in per cent, a number with three digits, a dash if undefined.

    Examples
    --------
    >>> figure_text(0.0267, "share"), figure_text(1.25, "number"), figure_text(None, "number")
    ('2.7 %', '1.25', '–')
    """
    if value is None:
        return "–"
    return f"{100 * value:.1f} %" if kind == "share" else f"{value:.3g}"


def interval_text(figure: Mapping[str, Any]) -> str:
    """The 90 % interval of a figure as text; a dash if there is none.

    Examples
    --------
    >>> interval_text({"low": 0.5, "high": 0.75, "kind": "share"})
    '50.0 % … 75.0 %'
    >>> interval_text({"low": None, "high": None, "kind": "share"})
    '–'
    """
    low, high = (figure_text(figure[end], figure["kind"]) for end in ("low", "high"))
    return "–" if low == high == "–" else f"{low} … {high}"


def print_score(found: Mapping[str, Any]) -> None:
    """Print the table, the number of criteria met and the two commitments."""
    from inkjet_env.reporting.tables import print_table

    marks = {True: "yes", False: "NO", None: ""}
    rows = []
    for figure in found["figures"]:
        if figure["of"]:
            value = figure_text(figure["value"], figure["kind"])
            count = f"{figure['hits']}/{figure['of']}" if figure["hits"] is not None else str(figure["of"])
            rows.append((figure["name"], value, interval_text(figure), count, figure["asked"], marks[figure["met"]]))
    print_table(("figure", "result", "90 % interval", "cases", "criterion", "met"), rows)
    judged = [figure for figure in found["figures"] if figure["met"] is not None]
    print(f"{len(judged) - len(found['short'])} of {len(judged)} criteria of a first-rate diagnosis are met.")
    print(f"SHA-256 of the sealed truth: {found['truth_sha256']}; of the answers: {found['answers_sha256']}.")


def print_rounds(found: Mapping[str, Any]) -> None:
    """Print the figures of a ``proof-adaptive/1``: before the rounds, after designed ones, and after random ones."""
    from inkjet_env.reporting.tables import print_table

    for table in rounds_tables(found):
        print_table(*table)


def rounds_tables(found: Mapping[str, Any]) -> Iterator[Table]:
    """Tables of a ``proof-adaptive/1``: figures by group of cases, and gains of waveforms."""
    for group, ways in found["figures"].items():
        rows = []
        for before, *after in zip(*ways.values(), strict=True):
            texts = [
                figure_text(one["value"], one["kind"]) + (f" ({one['hits']})" if one["hits"] is not None else "")
                for one in (before, *after)
            ]
            rows.append((before["name"], str(before["of"]), *texts))
        if rows[0][1] != "0":
            yield (group, "cases", "before", "requests as designed", "requests at random"), rows
    if found["waveforms"]["heads"]:
        yield gains_table(found["waveforms"]["heads"])


def gains_table(heads: Sequence[Mapping[str, Any]]) -> Table:
    """What each way to choose a waveform gains of what could be gained on these heads; see `adaptive.gains`."""
    names = {"augmented": "corrected head", "robust": "heads that remain possible", "loop": "closed loop"}
    rows: list[tuple[str, ...]] = [
        (
            names[way], figure_text(one["share"], "share"), figure_text(one["median"], "share"), str(one["worse"]),
            figure_text(one["worst"], "share"),
        )
        for way, one in gains(heads).items()
    ]  # fmt: skip
    return (f"waveforms of {len(heads)} heads", "all volts", "median head", "worse than base", "largest loss"), rows
