"""The ranking of a comparison, printed as tables on standard output."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from inkjet_env.reporting.tables import print_table

SIDE_BY_SIDE = 6
"""Largest number of problems with a column each; a ranking over more problems shows summaries instead."""


def print_ranking(ranking: Mapping[str, Any]) -> None:
    """Print the ranking in a ``ranking/1``, the conclusions from it, and the optimisers that were not compared."""
    from inkjet_env.reporting.formatting import volts

    names = [problem["name"] for problem in ranking["problems"]]
    if len(names) <= SIDE_BY_SIDE:
        rows = [
            (
                one["optimizer"],
                f"{one['mean_rank']:.2f}",
                *(volts(one["problems"].get(name, {}).get("median_regret_V", math.nan)) for name in names),
            )
            for one in ranking["ranking"]
        ]
        print_table(("optimiser", "mean rank", *names), rows)
        print("Median regret in volts: cost minus the best known cost.")
    else:
        print_table(*standings_table(ranking["standings"][str(ranking["settings"]["budget"])]))
        print(f"Regret in the problems' scales, over all {len(names)} problems. Solved: a regret of at most 0.01.")
    for sentence in ranking["sentences"]:
        print(f"- {sentence}")
    for name, reason in ranking["unavailable"].items():
        print(f"- Not compared: {name}: {reason}")


def standings_table(found: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows of one budget's standings in a ``ranking/1``."""

    def share(value: float | None) -> str:
        return "–" if value is None else f"{100 * value:.0f} %"

    def regret(value: float | None) -> str:
        return "–" if value is None else f"{value:.2f}" if value >= 0.1 else f"{value:.2g}"

    def ranged(entry: Mapping[str, float | None], written: Callable[[float | None], str]) -> str:
        low, high = entry["low"], entry["high"]
        ends = "" if low is None or high is None else f" ({written(low)} to {written(high)})"
        return written(entry["value"]) + ends

    rows: list[tuple[str, ...]] = [
        (
            row["optimizer"] + ("" if row["applies"] == found["problems"] else f" (on {row['applies']})"),
            f"{row['rank']:.2f}",
            ranged(row["quality"], regret),
            ranged(row["solved"], share),
            ranged(row["improvement"], share),
            "–" if (s := row["signed_rank"]) is None else ", ".join(share(s[k]) for k in ("first", "alike", "second")),
        )
        for row in found["rows"]
    ]
    pairwise = ("lower cost than pso", "all such problems: better, equivalent, worse")
    return ("optimiser", "mean rank", "regret", "solved", *pairwise), rows
