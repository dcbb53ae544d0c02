"""What certificates say and what they took, as a file for the tables of a comparison.

``python -m inkjet_env.experiments.bounds.summary FOLDER ... --json bounds.json`` reads them and verifies nothing: that
is for ``inkjet_env.experiments.bounds.verification``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from inkjet_env.experiments.benchmark.regret import best_known_cost
from inkjet_env.experiments.bounds.tables import SPENT
from inkjet_env.reporting.tables import markdown_table
from inkjet_env.storage import json_text, write_atomically

FORMAT = "lower-bounds/1"


def summary(folder: Path) -> dict[str, Any]:
    """Problem, bound, and what the search of a folder took.

    Raises
    ------
    ValueError
        The folder holds no certificate, or one that is not finished.
    """
    try:
        header = json.loads((folder / "certificate.json").read_text(encoding="utf-8"))
        parts = [
            json.loads((folder / f"part-{number:02}.json").read_text(encoding="utf-8"))
            for number in range(len(header["parts"]))
        ]
        spent = [json.loads((folder / SPENT).read_text(encoding="utf-8")), *parts]
        return {
            "problem": header["problem"]["name"],
            "bound_V": header["bound_V"],
            "parts": len(parts),
            "boxes": sum(part["boxes"] for part in parts),
            "hours": sum(one["seconds"] for one in spent) / 3600,
        }
    except FileNotFoundError as missing:
        raise ValueError(f"{missing.filename}: there is no such file. Let the search end first.") from None
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{folder}: its files are not those of a search ({error}). Search again.") from None


def bounds_table(found: Mapping[str, Any]) -> str:
    """Each bound beside the best known cost, in Markdown."""
    rows = []
    for one in sorted(found["bounds"], key=lambda one: (one["problem"], one["bound_V"])):
        known_V = best_known_cost(one["problem"])
        rows.append(
            (
                one["problem"], f"{known_V:.6f}", f"{one['bound_V']:g}", f"{known_V - one['bound_V']:.3f}",
                str(one["parts"]), f"{one['boxes']:,}", f"{one['hours']:.1f}",
            )
        )  # fmt: skip
    header = ("problem", "best known, V", "proven not below, V", "gap, V", "parts", "boxes", "processor hours")
    return markdown_table(header, rows)


def main(arguments: list[str] | None = None) -> None:
    """Read certificates, print their table and write the file."""
    parser = argparse.ArgumentParser(
        prog="python -m inkjet_env.experiments.bounds.summary", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="folder of a certificate")
    parser.add_argument("--json", type=Path, help="file to write")
    chosen = parser.parse_args(arguments)
    try:
        found = {"format": FORMAT, "bounds": [summary(folder) for folder in chosen.folders]}
        table = bounds_table(found)
    except ValueError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    if chosen.json:
        write_atomically(chosen.json, json_text(found))
    print(table)


if __name__ == "__main__":
    main()
