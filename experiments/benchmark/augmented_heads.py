"""Heads with effects for the suite, as a diagnosis finds them: the task of an optimiser after `inkjet diagnose`.

`studies.make_augmented_heads` creates and stores them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from inkjet_env.experiments.benchmark.data import data_file
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import printhead_of

FILE = "augmented_heads.json"
FORMAT = "augmented_heads/1"


@dataclass(frozen=True)
class HeadDraw:
    """Identifies one head drawn from the concealed plant.

    Parameters
    ----------
    effect : str
        Id of its only effect.
    strength : float
        Ratio of the mismatch's RMS to the noise's RMS.
    seed : int
        Seed of the draw.
    """

    effect: str
    strength: float
    seed: int


HEADS = {
    "augmented-mode": HeadDraw("second_mode", 8.0, 6),
    "augmented-echo": HeadDraw("wave_echo", 8.0, 7),
    "augmented-softening": HeadDraw("ferroelastic_softening", 8.0, 8),
}


def augmented_head(name: str) -> AugmentedPrinthead:
    """The head of that name, one of `HEADS`."""
    content = json.loads(data_file(FILE).read_text(encoding="utf-8"))
    head = printhead_of(content["heads"][name])
    if not isinstance(head, AugmentedPrinthead):
        raise ValueError(f"{name} has no effects in {FILE}.")
    return head
