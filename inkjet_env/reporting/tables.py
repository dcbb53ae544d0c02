"""Tables for standard output and for Markdown pages."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Sequence

from inkjet_env.extras import extra

BETWEEN = 2
"""Spaces between two columns of a printed table."""
UNBROKEN = 24
"""Longest text of a cell, in characters, that is kept on one line."""
NAME = 28
"""Longest text of the first column, in characters, that is kept on one line."""
SMALLEST_WIDTH = 40
"""Smallest width of a printed table, in characters; narrower terminals break the lines."""
BREAKS = re.compile(r"(?<=[a-z])-(?=[^\s-])")
"""Hyphens within a name, after which a heading may continue on the next line."""


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under headings on standard output; the first column is left-aligned, the others right-aligned.

    The table is at most as wide as the terminal, or as ``COLUMNS`` says; 80 characters where neither is known. Texts
    are broken between words and never cut. Where that does not suffice, the columns follow one another in several
    blocks, each of which begins with the first column.
    """
    with extra("a printed table"):
        from rich import box
        from rich.console import Console
        from rich.table import Table

    if not headings:
        return
    console = Console(width=max(shutil.get_terminal_size((80, 24)).columns, SMALLEST_WIDTH), markup=False, emoji=False)
    for block in blocks(headings, rows, console.width):
        table = Table(box=box.SIMPLE_HEAD, padding=(0, BETWEEN - 1, 0, 0), pad_edge=False, show_edge=False)
        for place, (number, width) in enumerate(block):
            heading = "\n".join(_lines(headings[number], width))
            table.add_column(heading, justify="right" if place else "left", width=width, overflow="fold")
        for row in rows:
            first, *others = ("\n".join(_lines(row[n], width)) if not n else row[n] for n, width in block)
            table.add_row(first, *others)
        with console.capture() as shown:
            console.print(table)
        print(*(line.rstrip() for line in shown.get().splitlines()), "", sep="\n")


def blocks(headings: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> list[list[tuple[int, int]]]:
    """Columns of a table, in blocks of at most ``width`` characters: of each column, its number and its width.

    Parameters
    ----------
    headings : sequence of str
        One for each column.
    rows : sequence of sequences of str
        As many texts each.
    width : int
        Largest width in characters, `BETWEEN` spaces after each column but the last included.

    Returns
    -------
    list of lists of tuples
        Every block begins with column 0. No column is narrower than its longest word, or than a cell of at most
        `UNBROKEN` characters, unless that alone is too long for ``width``.

    Examples
    --------
    >>> blocks(("name", "mean rank", "cost (V)"), [("pso", "1.50", "-22.83"), ("cma-es", "1.25", "-22.83")], 24)
    [[(0, 6), (1, 7), (2, 7)]]
    >>> blocks(("name", "mean rank", "cost (V)"), [("pso", "1.50", "-22.83"), ("cma-es", "1.25", "-22.83")], 14)
    [[(0, 6), (1, 6)], [(0, 6), (2, 6)]]
    """
    columns = [[heading, *(row[number] for row in rows)] for number, heading in enumerate(headings)]
    natural = [max(map(len, column)) for column in columns]
    least = [max(map(len, (*_parts(column[0]), *map(_unbroken, column[1:])))) for column in columns]
    least[0] = min(natural[0], max(NAME, *map(len, _parts(columns[0][0]))))
    found: list[list[int]] = [[0]]
    for number in range(1, len(columns)):
        block = [*found[-1], number]
        if len(block) > 2 and sum(least[n] + BETWEEN for n in block) - BETWEEN > width:
            found.append([0, number])
        else:
            found[-1] = block
    return [_fitted(block, natural, least, width) for block in found]


def _fitted(block: Sequence[int], natural: Sequence[int], least: Sequence[int], width: int) -> list[tuple[int, int]]:
    """The block's columns with their widths: the widest that can be broken become narrower until all fit."""
    widths = {number: natural[number] for number in block}
    while sum(widths.values()) + BETWEEN * (len(block) - 1) > width:
        breakable = [number for number in block if widths[number] > least[number]]
        if not breakable:
            widths[0] = max(1, width - BETWEEN * (len(block) - 1) - sum(widths[n] for n in block if n))
            break
        widths[max(breakable, key=lambda number: widths[number])] -= 1
    return list(widths.items())


def _parts(text: str) -> list[str]:
    """Parts of a heading or a name between which a line may end: words, and those with hyphens; never none."""
    return BREAKS.sub("- ", text).split() or [""]


def _unbroken(text: str) -> str:
    """The longest part of a cell between whose parts a line may end: a word of a long text, all of a short one."""
    return text if len(text) <= UNBROKEN else max(text.split(), key=len)


def _lines(text: str, width: int) -> list[str]:
    """A heading or a name in lines of at most ``width`` characters, where its parts allow that."""
    if len(text) <= width:
        return [text]
    lines = [""]
    for word in text.split():
        for place, part in enumerate(_parts(word)):
            joined = f"{lines[-1]}{'' if place or not lines[-1] else ' '}{part}"
            if len(joined) <= width or not lines[-1]:
                lines[-1] = joined
            else:
                lines.append(part)
    return lines


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Headings and rows as a Markdown table."""
    lines = [" | ".join(headings), " | ".join(["---"] * len(headings)), *(" | ".join(row) for row in rows)]
    return "\n".join(f"| {line} |" for line in lines)
