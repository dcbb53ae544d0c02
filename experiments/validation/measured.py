"""Measured systems: ``python -m inkjet_env.experiments.validation.measured DIR``.

Every campaign folder below DIR is diagnosed. A table says the verdict, the named effects with their 90 % intervals, and
the residual of the recordings or parts that no fit has seen: base model, named effects, and with the unexplained
remainder. ``--hold-out NAME:r1,r2`` declares the held-out recordings of the folder NAME, as for a test on another kind
of drive; otherwise they are chosen as by `inkjet diagnose`. The table and all verdicts are written to --out.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.mismatch import Diagnosis, diagnose
from inkjet_env.progress import shown_steps
from inkjet_env.recordings import read_campaign
from inkjet_env.recordings.data_package import DESCRIPTOR
from inkjet_env.reporting.tables import markdown_table
from inkjet_env.storage import write_atomically, write_json

RESULTS = Path("results/measured")
HEADINGS = (
    "campaign", "held out", "verdict", "effects (90 % interval)", "noise", "base", "effects", "with remainder", "unit",
    "seconds",
)  # fmt: skip


def campaign_folders(folder: Path) -> list[Path]:
    """Campaign folders at and below a folder, in order; ``ValueError`` if there is none."""
    found = sorted(file.parent for file in folder.rglob(DESCRIPTOR))
    if not found:
        raise ValueError(f"{folder}: no campaign ({DESCRIPTOR}) is there or below. Give a folder of campaigns.")
    return found


def heldout_rms(found: Diagnosis, model: str) -> float:
    """RMS over the main channel's held-out samples, in the channel's own unit; NaN where a model is absent.

    Parameters
    ----------
    found : Diagnosis
        A diagnosis.
    model : {"noise", "base", "augmented", "with_remainder"}
        The noise, or the model whose residual it is.
    """
    mine = [r for r in found.recordings if r.held_out and r.channel == found.main_channel]
    if not mine or (model == "with_remainder" and found.remainder is None):
        return math.nan
    rows = [r.measured.size - r.fitted for r in mine]
    sizes = [r.noise_rms if model == "noise" else r.rms(model, held_out=True) for r in mine]
    return float(np.sqrt(np.average(np.square(sizes), weights=rows)))


def row_of(name: str, found: Diagnosis) -> dict[str, Any]:
    """The figures of one campaign, as plain JSON values."""
    held_out = [r.name if r.fitted == 0 else f"{r.name} from sample {r.fitted}" for r in found.recordings if r.held_out]
    figures = {m: heldout_rms(found, m) for m in ("noise", "base", "augmented", "with_remainder")}
    return {
        "campaign": name,
        "heldout": held_out,
        "unit": next(r.unit for r in found.recordings if r.channel == found.main_channel),
        "rms": {model: value if math.isfinite(value) else None for model, value in figures.items()},
        "diagnosis": found.as_json(),
    }


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The figures of all campaigns as a Markdown table."""
    lines = []
    for row in rows:
        verdict, effects = row["diagnosis"], []
        for effect in verdict["effects"]:
            values = [f"{name} {_interval(number)}" for name, number in effect["parameters"].items()]
            effects.append(f"`{effect['id']}`: {', '.join(values)}")
        figures = ("–" if value is None else f"{value:.3g}" for value in row["rms"].values())
        shown = ("; ".join(effects) or "–", *figures, row["unit"], f"{verdict['seconds']:.0f}")
        lines.append((row["campaign"], ", ".join(row["heldout"]) or "–", verdict["verdict"], *shown))
    return markdown_table(HEADINGS, lines)


def _interval(number: Mapping[str, Any]) -> str:
    if number["low"] is None or number["high"] is None:
        return f"{number['value']:.4g} {number['unit']} (interval unknown)"
    return f"{number['value']:.4g} ({number['low']:.4g} … {number['high']:.4g}) {number['unit']}"


def measured(folder: Path, held_out: Mapping[str, Sequence[str]], workers: int = 2) -> list[dict[str, Any]]:
    """Diagnose every campaign below a folder.

    Parameters
    ----------
    folder : Path
        Folder of campaign folders.
    held_out : mapping of str to sequence of str
        By name of a campaign's folder, its held-out recordings; chosen by the diagnosis where not given.
    workers : int
        Number of processes.
    """
    folders = campaign_folders(folder)
    if unknown := sorted(set(held_out) - {path.name for path in folders}):
        raise ValueError(f"--hold-out {unknown[0]}: no campaign of that name below {folder}.")
    rows = []
    for path in folders:
        with shown_steps(str(path)) as progress:
            found = diagnose(read_campaign(path), held_out=held_out.get(path.name), workers=workers, progress=progress)
        rows.append(row_of(path.name, found))
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Diagnose the campaigns, print the table and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--hold-out", action="append", default=[], metavar="NAME:R1,R2")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=RESULTS)
    given = parser.parse_args(arguments)
    try:
        held_out = {}
        for declared in given.hold_out:
            name, colon, recordings = declared.partition(":")
            if not colon:
                raise ValueError(f"--hold-out must read NAME:r1,r2; got {declared!r}.")
            held_out[name] = tuple(recording.strip() for recording in recordings.split(","))
        rows = measured(given.folder, held_out, given.workers)
    except (ValueError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    except KeyboardInterrupt:
        sys.exit(130)
    given.out.mkdir(parents=True, exist_ok=True)
    write_json(given.out / "measured.json", {"format": "measured/1", "campaigns": rows})
    write_atomically(given.out / "measured.md", table(rows) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
