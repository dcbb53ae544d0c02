"""Heads with effects as a diagnosis finds them, for the suite: what an optimiser meets after `inkjet diagnose`.

``python -m experiments.augmented_heads`` draws concealed heads, records a campaign of each, diagnoses it without being
told, and keeps the printheads that come out of it in `augmented_heads.json`.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.storage import write_json

FILE = "augmented_heads.json"
FORMAT = "augmented_heads/1"


@dataclass(frozen=True)
class Concealed:
    """A head to draw: an effect of the concealed plant, RMS of the mismatch over the noise, and the draw's seed."""

    effect: str
    strength: float
    seed: int


HEADS = {
    "augmented-mode": Concealed("second_mode", 8.0, 6),
    "augmented-echo": Concealed("wave_echo", 8.0, 7),
    "augmented-softening": Concealed("ferroelastic_softening", 8.0, 8),
}


def augmented_head(name: str) -> AugmentedPrinthead:
    """The head of that name, one of `HEADS`."""
    content = json.loads((resources.files("experiments") / FILE).read_text(encoding="utf-8"))
    head = printhead_of(content["heads"][name])
    if not isinstance(head, AugmentedPrinthead):
        raise ValueError(f"{name} has no effects in {FILE}.")
    return head


def found(concealed: Concealed) -> dict[str, Any]:
    """The ``printhead/1`` that the diagnosis of a campaign of that head ends with.

    Raises
    ------
    ValueError
        The diagnosis does not name the effect, and it alone.
    """
    import numpy as np

    from experiments.concealed_rig import Case, build
    from experiments.diagnosis_command import augmented_json
    from inkjet_env.mismatch import diagnose
    from inkjet_env.recordings import read_campaign

    plant = build(Case(0, concealed.seed, "effect", (concealed.effect,), concealed.strength))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "campaign"
        plant.write(folder, "campaign")
        diagnosis = diagnose(read_campaign(folder), rng=np.random.default_rng(0))
    named = [found.effect.id for found in diagnosis.effects]
    if diagnosis.verdict != "named" or named != [concealed.effect]:
        raise ValueError(f"{concealed.effect} was found as {diagnosis.verdict} {named}. Draw another head.")
    return augmented_json(diagnosis)


def main() -> None:
    """Draw, record, diagnose, keep."""
    heads = {}
    for name, concealed in HEADS.items():
        heads[name] = found(concealed)
        print(f"{name}: {heads[name]['effects']}", flush=True)
    write_json(Path(__file__).with_name(FILE), {"format": FORMAT, "heads": heads})


if __name__ == "__main__":
    main()
