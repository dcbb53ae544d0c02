"""Compilation of the plant's kernels, or their loading from the cache, in advance."""

from __future__ import annotations

import numpy as np

from inkjet_env.plant.effects import catalogue
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.extrema import extrema
from inkjet_env.plant.stages import Plant
from inkjet_env.printhead import Printhead


def warm_up() -> None:
    """Simulate a short pulse with every effect of the catalogue, and find its peaks."""
    printhead = Printhead.published()
    drive_V = np.interp(np.arange(64), [0, 10, 20, 30, 40, 63], [0.0, 0.0, 50.0, 50.0, 0.0, 0.0])
    excitations = [
        Excitation(channel, state, step_s, drive_V, order, drive_V[::-1].copy())
        for order, (channel, state, step_s) in enumerate(
            [
                ("self_sensing", "periodic", 2e-7),
                ("self_sensing", "demagnetised", 2e-7),
                ("strain_gauge", "free", 0.01),
            ],
            start=2,
        )
    ]
    for effect in catalogue():
        for values in effect.starts(printhead, excitations)[:1]:
            for excitation in excitations:
                Plant(printhead, effects=((effect, values),)).signal(excitation)
    extrema(drive_V, 1.0)


if __name__ == "__main__":
    warm_up()
