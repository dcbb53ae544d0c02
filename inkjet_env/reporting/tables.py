"""Tables for standard output and for Markdown pages."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from inkjet_env.extras import extra


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under headings on standard output; the first column is left-aligned, the others right-aligned."""
    with extra("a printed table"):
        from rich import box
        from rich.console import Console
        from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="right" if place else "left", no_wrap=place == 0)
    for row in rows:
        table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else 160, markup=False).print(table)


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Headings and rows as a Markdown table."""
    lines = [" | ".join(headings), " | ".join(["---"] * len(headings)), *(" | ".join(row) for row in rows)]
    return "\n".join(f"| {line} |" for line in lines)
