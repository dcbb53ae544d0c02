"""Creation of the suite's heads with effects.

``python -m inkjet_env.experiments.benchmark.studies.make_augmented_heads`` draws concealed heads, records a campaign of
each, diagnoses it blind, and stores the resulting printheads in ``data/augmented_heads.json``.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from inkjet_env.experiments.benchmark.augmented_heads import FILE, FORMAT, HEADS, HeadDraw
from inkjet_env.experiments.benchmark.data import data_file
from inkjet_env.storage import write_json


def found(draw: HeadDraw) -> dict[str, Any]:
    """The ``printhead/1`` from the diagnosis of a campaign of that head.

    Raises
    ------
    ValueError
        The diagnosis does not name exactly the head's effect.
    """
    import numpy as np

    from inkjet_env.experiments.concealed_plant import Case, build
    from inkjet_env.mismatch import diagnose
    from inkjet_env.recordings import read_campaign

    plant = build(Case(0, draw.seed, "effect", (draw.effect,), draw.strength))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "campaign"
        plant.write(folder, "campaign")
        diagnosis = diagnose(read_campaign(folder), rng=np.random.default_rng(0))
    named = [found.effect.id for found in diagnosis.effects]
    if diagnosis.verdict != "named" or named != [draw.effect]:
        raise ValueError(f"{draw.effect} was found as {diagnosis.verdict} {named}. Draw another head.")
    return diagnosis.augmented_json()


def main() -> None:
    """Draw, record and diagnose all heads, and store the results."""
    heads = {}
    for name, draw in HEADS.items():
        heads[name] = found(draw)
        print(f"{name}: {heads[name]['effects']}", flush=True)
    write_json(data_file(FILE), {"format": FORMAT, "heads": heads})


if __name__ == "__main__":
    main()
