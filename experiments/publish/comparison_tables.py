"""Tables of a comparison in Markdown, for the record in ``docs``.

``python -m inkjet_env.experiments.publish.comparison_tables FOLDER`` prints the tables of a bench's ranking.json and of
the other results in the folder: beating.json (the challenge of the best known costs), bounds.json (proven
lower bounds), amortised.json and few_tries.json."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.experiments.benchmark.ranking_tables import standings_table
from inkjet_env.experiments.benchmark.regret import scale_V
from inkjet_env.experiments.benchmark.report import RANKING_FORMAT
from inkjet_env.experiments.benchmark.studies import challenge_best_known
from inkjet_env.experiments.benchmark.suite import family_of, suite
from inkjet_env.experiments.bounds import summary
from inkjet_env.experiments.learning import amortised, few_shot
from inkjet_env.experiments.publish.folder import print_sections, read_as
from inkjet_env.jetting.figures_of_merit import jetting
from inkjet_env.reporting.tables import markdown_table

Content = Mapping[str, Any]


def problems_table(tried: Content) -> str:
    """The suite: best known cost, its scale and certainty, and how far above it each method of the challenge ended."""
    columns = list(dict.fromkeys(attempt["method"] for attempt in tried["attempts"]))
    above_V = {
        (attempt["problem"], attempt["method"]): attempt["cost_V"] - attempt["known_V"] for attempt in tried["attempts"]
    }
    rows = []
    for one in suite().values():
        known = one.best_known
        found = ("–", "–") if known is None else (f"{known.cost:.6f}", f"{known.runs_near} of {known.runs}")
        by_method = [f"{above_V[one.name, by]:+.4f}" if (one.name, by) in above_V else "–" for by in columns]
        rows.append((one.name, family_of(one.name), found[0], f"{scale_V(one.name):.2f}", found[1], *by_method))
    header = ("problem", "family", "best known, V", "scale, V", "runs near it", *(f"{by}, V" for by in columns))
    return markdown_table(header, rows)


def press_table() -> str:
    """Jetting figures of the best known waveforms, for one drop from rest on the nominal head."""
    rows = []
    for one in suite().values():
        if (known := one.best_known) is None:
            continue
        found = jetting(one.respond(one.bounds.to_unit(np.array(known.waveform))), one.cost)
        settled = f"{1e6 * found.settling_s:.1f}" if math.isfinite(found.settling_s) else "–"
        rows.append(
            (
                one.name, f"{found.effective_V:.2f}", f"{1e3 * found.residual_V:.0f}", f"{100 * found.residual:.1f}",
                settled, f"{1e-3 * found.highest_Hz:.1f}",
            )
        )  # fmt: skip
    residual = ("residual, mV", "residual, % of the peak")
    header = ("problem", "effective peak, V", *residual, "settled after, µs", "fastest, kHz")
    return markdown_table(header, rows)


def entrants_table(ranking: Content) -> str:
    """The entrants with their budgets and settings."""
    rows = [
        (
            one["name"], f"{one['budget']:,}", f"{one['tuning']:,}" if one["tuning"] else "–", one["settings"],
            one["remark"],
        )
        for one in ranking["entrants"]
    ]  # fmt: skip
    return markdown_table(("optimiser", "evaluations per run", "evaluations for tuning", "settings", "remarks"), rows)


def sections(folder: Path) -> Iterator[tuple[str, str]]:
    """Headings and text of the sections for which the folder has results.

    Raises
    ------
    ValueError
        A file has another format.
    """
    ranking = read_as(folder / "ranking.json", RANKING_FORMAT)
    tried = read_as(folder / "beating.json", challenge_best_known.FORMAT)
    if tried is not None:
        yield "Problems", problems_table(tried)
        yield "Jetting figures", press_table()
    if ranking is not None:
        yield "Entrants", entrants_table(ranking)
        for budget, found in ranking["standings"].items():
            said = "\n".join(f"* {text}" for text in found["sentences"])
            yield f"After {int(budget):,} evaluations", f"{said}\n\n{markdown_table(*standings_table(found))}"
    if (bounds := read_as(folder / "bounds.json", summary.FORMAT)) is not None:
        yield "Proven bounds", summary.bounds_table(bounds)
    for name, module in (("amortised", amortised), ("few_tries", few_shot)):
        if (kept := read_as(folder / f"{name}.json", module.FORMAT)) is not None:
            tables = (markdown_table(*table) for table in module.result_tables(kept))
            yield module.TITLE, "\n\n".join((*tables, module.legend(kept)))


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    files = "ranking.json", "beating.json", "bounds.json", "amortised.json", "few_tries.json"
    print_sections("inkjet_env.experiments.publish.comparison_tables", __doc__, sections, files, arguments)


if __name__ == "__main__":
    main()
