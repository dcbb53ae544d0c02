"""Tables of the results in a folder, printed in Markdown."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

Sections = Callable[[Path], Iterable[tuple[str, str]]]
"""Heading and text of each table whose file is in a folder."""


def read_as(file: Path, expected: str) -> dict[str, Any] | None:
    """The content of a JSON file; None if there is none.

    Raises
    ------
    ValueError
        It is of another format than expected.
    """
    if not file.is_file():
        return None
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    if content.get("format") != expected:
        raise ValueError(f"{file} is not a {expected}; it is {content.get('format')!r}. Make it again.")
    return content


def print_sections(
    module: str, about: str | None, sections: Sections, files: Sequence[str], arguments: list[str] | None
) -> None:
    """The command of a module: print the tables of the folder that it is given."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=about)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    folder = parser.parse_args(arguments).folder
    try:
        found = list(sections(folder))
    except ValueError as error:
        parser.error(str(error))
    if not found:
        *others, last = files
        parser.error(f"{folder} holds " + (f"none of {', '.join(others)} and {last}." if others else f"no {last}."))
    print("\n\n".join(f"## {heading}\n\n{text}" for heading, text in found))
