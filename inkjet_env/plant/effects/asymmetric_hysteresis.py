"""Positive and negative branches that differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import percent
from inkjet_env.printhead import Printhead

Real = NDArray[np.float64]


class AsymmetricHysteresis(Effect):
    """Even part of a memory-free characteristic behind the plays."""

    id = "asymmetric_hysteresis"
    stage = "hysteresis"
    sentence = "Positive and negative branches of the hysteresis differ."
    equation = "v + asymmetry |v| + bending v² / (F / 2), F the law's full scale"
    source = (
        "even part of the superposition operator in K. Kuhnen, Modeling, identification and compensation of complex "
        "hysteretic nonlinearities: a modified Prandtl-Ishlinskii approach, European Journal of Control 9(4), 2003"
    )
    parameters = (
        Parameter("asymmetry", "1", -0.5, 0.5, meaning="positive branches are this much steeper, negative ones less"),
        Parameter("bending", "1", -0.5, 0.5, meaning="even quadratic part, relative, at half the law's full scale"),
    )
    strengths = ("asymmetry", "bending")
    signature = "even harmonics, at slow rates too; the answer to a drive turned upside down is not turned upside down"
    confusable_with = ("sensor_saturation",)
    shown_by = "a pulse and the same one upside down, and a slow loop over the whole range"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        return [{"asymmetry": 0.03, "bending": 0.0}, {"asymmetry": 0.0, "bending": 0.03}]

    def told(self, values: Values, unit: str = "V") -> str:
        small, large = 2 * values["asymmetry"], 2 * (values["asymmetry"] + values["bending"])
        return (
            f"Compared with negative drives, positive ones move the head {_further(small)} where they are small and "
            f"{_further(large)} at half the full scale."
        )

    def hysteresis(self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, shot: Shot) -> Real:
        asymmetry, bending = values["asymmetry"], values["bending"] / (0.5 * printhead.full_scale_V)
        if asymmetry == bending == 0:
            return hysteretic_V
        result: Real = hysteretic_V + asymmetry * np.abs(hysteretic_V) + bending * hysteretic_V * hysteretic_V
        return result


def _further(part: float) -> str:
    return f"{percent(abs(part))} {'less far' if part < 0 else 'further'}"
