"""Tables of the speed in Markdown, for the page of the documentation: one column of ratios for each record.

``python -m inkjet_env.experiments.publish.speed_tables FOLDER`` reads every ``*.json`` that `make speed` wrote into the
folder, in the order of their dates. Ratios alone can be compared between machines."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from inkjet_env.experiments.publish.folder import print_sections, read_as
from inkjet_env.experiments.validation.speed import FORMAT
from inkjet_env.reporting.tables import markdown_table


def records(folder: Path) -> list[dict[str, Any]]:
    """Every record in the folder, by date."""
    found = [record for file in sorted(folder.glob("*.json")) if (record := read_as(file, FORMAT)) is not None]
    return sorted(found, key=lambda record: record["date"])


def ratio(value: float | None) -> str:
    """A ratio to three digits."""
    if value is None:
        return "–"
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def sections(folder: Path) -> Iterator[tuple[str, str]]:
    """Heading and text of each table."""
    found = records(folder)
    if not found:
        return
    dates = [record["date"] for record in found]
    for title in [table["title"] for table in found[-1]["tables"]]:
        columns = [
            {name: value for table in record["tables"] if table["title"] == title for name, _, value in table["rows"]}
            for record in found
        ]
        rows = [(name, *(ratio(column.get(name)) for column in columns)) for name in columns[-1]]
        yield title, markdown_table(("ratio", *dates), rows)
    reached = [f"{100 * record['arithmetic']['floor_us'] / record['arithmetic']['taken_us']:.0f} %" for record in found]
    operations = [f"{record['arithmetic']['operations']:,.0f}" for record in found]
    rows = [
        ("operations for a waveform", *operations),
        ("share of the core's arithmetic that lanes reach", *reached),
        ("processor", *(record["processor"] for record in found)),
    ]
    yield "Arithmetic", markdown_table(("", *dates), rows)


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    files = ("a record of make speed", "another")
    print_sections("inkjet_env.experiments.publish.speed_tables", __doc__, sections, files, arguments)


if __name__ == "__main__":
    main()
