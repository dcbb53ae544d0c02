"""A leaderboard in Markdown, from the results folder of a bench or of several that were merged.

``python -m inkjet_env.experiments.publish.leaderboard FOLDER`` prints, from its ``ranking.json``,
the places of the optimisers after each number of evaluations, and where each one and its runs come from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from inkjet_env.experiments.benchmark.merged import AT
from inkjet_env.experiments.benchmark.report import RANKING_FORMAT
from inkjet_env.experiments.publish.folder import print_sections, read_as
from inkjet_env.reporting.tables import markdown_table

DIGITS = 12
"""Digits of a digest that are shown."""
PACKAGES = {
    "nevergrad": "nevergrad", "pymoo": "pymoo", "optuna": "optuna", "scipy": "scipy", "lbfgsb": "scipy",
    "sb3": "stable-baselines3", "cma": "cma", "bipop": "cma",
}  # fmt: skip
"""Package that does the work, by the beginning of an optimiser's name; the others are this package's own."""


def board(ranking: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows: the place of each optimiser and its mean rank after each number of evaluations.

    An asterisk marks a mean rank that does not differ significantly from the best (Nemenyi's critical difference).
    """
    budgets = sorted(ranking["standings"], key=int, reverse=True)
    texts: dict[str, dict[str, str]] = {}
    for budget in budgets:
        standings = ranking["standings"][budget]
        best = standings["rows"][0]["rank"]
        for place, row in enumerate(standings["rows"], start=1):
            alike = row["rank"] - best <= (standings["critical_difference"] or 0.0)
            texts.setdefault(row["optimizer"], {})[budget] = f"{place} ({row['rank']:.1f}{'*' if alike else ''})"
    rows = [(name, *(places.get(budget, "–") for budget in budgets)) for name, places in texts.items()]
    return ("optimiser", *(f"after {int(budget):,}" for budget in budgets)), rows


def origins(ranking: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Of each optimiser its package with version, the bench that has its runs, and the digest of the code."""
    settings = ranking["settings"]
    benches = settings.get("sources") or [{"name": "", **settings}]
    rows = []
    ranked = [row["optimizer"] for one in ranking["standings"].values() for row in one["rows"]]
    for optimizer in dict.fromkeys(ranked):
        name, _, folder = optimizer.partition(AT)
        bench = next(bench for bench in benches if name in bench["optimizers"] and folder in ("", bench["name"]))
        versions, plugins = bench["versions"], bench.get("plugins", {})
        if (plugin := plugins.get(f"optimizer {name}")) is not None:
            package, code = str(plugin["package"]), str(plugin["code"])
        else:
            package = PACKAGES.get(name.partition("-")[0], "inkjet-env")
            package, code = f"{package} {versions.get(package, '')}".strip(), str(bench["code"])
        tuned = next((entrant["settings"] for entrant in ranking["entrants"] if entrant["name"] == name), "")
        rows.append((optimizer, package, tuned or "–", bench["name"] or "–", f"`{code[:DIGITS]}`"))
    return sorted(rows)


def sections(folder: Path) -> Iterator[tuple[str, str]]:
    """Heading and text of each table.

    Raises
    ------
    ValueError
        The ranking is of another format.
    """
    if (ranking := read_as(folder / "ranking.json", RANKING_FORMAT)) is None:
        return
    settings = ranking["settings"]
    yield "Place, and mean rank over the problems", markdown_table(*board(ranking))
    yield (
        "Where the runs come from",
        markdown_table(("optimiser", "package", "settings", "bench", "code"), origins(ranking)),
    )
    names = ", ".join(problem["name"] for problem in ranking["problems"])
    yield "Problems", f"{names}; {settings['repeats']} runs of each, seed {settings['seed']}."


def main(arguments: list[str] | None = None) -> None:
    """Print the leaderboard."""
    print_sections("inkjet_env.experiments.publish.leaderboard", __doc__, sections, ["ranking.json"], arguments)


if __name__ == "__main__":
    main()
