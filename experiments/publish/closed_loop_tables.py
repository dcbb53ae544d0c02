"""Tables of the closed loop in Markdown, for the record in ``docs``.

``python -m inkjet_env.experiments.publish.closed_loop_tables FOLDER`` prints those of the files in the folder:
``requests.json`` and ``waveforms.json``, each the adaptive.json of `inkjet prove --adaptive` (the second with
``--reoptimise``), and ``study.json`` of the study of `inkjet tune`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from inkjet_env.experiments.proof import tuning_study
from inkjet_env.experiments.proof.adaptive import ADAPTIVE_FORMAT
from inkjet_env.experiments.proof.printing import Table, gains_table, rounds_tables
from inkjet_env.experiments.publish.folder import print_sections, read_as
from inkjet_env.reporting.tables import markdown_table


def rounds_table(found: Mapping[str, Any]) -> Table:
    """What was asked for on each head, and the verdicts before and after."""

    def said(one: Mapping[str, Any]) -> str:
        return f"{one['verdict']} {', '.join(one['effects'])}" + (f" or {one['size'] - 1} more" * (one["size"] > 1))

    rows: list[tuple[str, ...]] = [
        (
            f"{'+'.join(row['effects'])}, {row['strength']}", row["way"], said(row["before"]),
            str(sum(made["recordings"] for made in row["rounds"])),
            said(row["rounds"][-1]["said"]) if row["rounds"] else "–",
        )
        for row in sorted(found["cases"], key=lambda row: (row["number"], row["way"]))
    ]  # fmt: skip
    return ("concealed", "requests", "before", "recordings", "after"), rows


def heads_table(found: Mapping[str, Any]) -> Table:
    """True cost in volts, on each concealed head, of the waveform of each model, of the loop's and of the best one."""
    ways = ("base", "augmented", "robust", "loop", "oracle")
    rows = [
        ("+".join(head["effects"]), *(f"{head[way]:.2f}" for way in ways), head["verdict"])
        for head in found["waveforms"]["heads"]
    ]
    header = ("concealed", "base", "corrected head", "robust", "closed loop", "best possible", "verdict before")
    return header, sorted(rows)


def sections(folder: Path) -> Iterator[tuple[str, str]]:
    """Heading and text of each table whose file is in the folder."""
    for name, details in (("requests", rounds_table), ("waveforms", heads_table)):
        if (found := read_as(folder / f"{name}.json", ADAPTIVE_FORMAT)) is not None:
            for table in (*rounds_tables(found), details(found)):
                yield f"{name}: {table[0][0]}", markdown_table(*table)
    if (study := read_as(folder / "study.json", tuning_study.FORMAT)) is not None:
        heads = study["heads"]
        yield "tuned heads", markdown_table(*tuning_study.table(heads))
        yield "tuned heads: gains", markdown_table(*gains_table([tuning_study.head_row(one) for one in heads]))


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    files = "requests.json", "waveforms.json", "study.json"
    print_sections("inkjet_env.experiments.publish.closed_loop_tables", __doc__, sections, files, arguments)


if __name__ == "__main__":
    main()
