"""Positive and negative branches that differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.plays import PLAYS, play_sum_V
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import percent
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.hysteresis import BranchLaw

Real = NDArray[np.float64]


class AsymmetricHysteresis(Effect):
    """Plays whose rising and falling branches differ, and an even part of a memory-free characteristic behind them."""

    id = "asymmetric_hysteresis"
    stage = "hysteresis"
    sentence = "Rising and falling, or positive and negative, branches of the hysteresis differ."
    equation = (
        "v + asymmetry |v| + bending v² / (F / 2), F the law's full scale; "
        "plays between (1 + lean) u − r and (1 − lean) u + r"
    )
    source = (
        "even part of the superposition operator in K. Kuhnen, Modeling, identification and compensation of complex "
        "hysteretic nonlinearities: a modified Prandtl-Ishlinskii approach, European Journal of Control 9(4), 2003; "
        "generalized plays of M. Al Janaideh, S. Rakheja, C.-Y. Su, An analytical generalized Prandtl-Ishlinskii model "
        "inversion for hysteresis compensation in micropositioning control, IEEE/ASME Trans. Mechatronics 16(4), 2011"
    )
    parameters = (
        Parameter("asymmetry", "1", -0.5, 0.5, meaning="positive branches are this much steeper, negative ones less"),
        Parameter("bending", "1", -0.5, 0.5, meaning="even quadratic part, relative, at half the law's full scale"),
        Parameter("lean", "1", -0.5, 0.5, meaning="rising branches of plays are this much steeper, falling ones less"),
    )
    strengths = ("asymmetry", "bending", "lean")
    signature = "even harmonics, at slow rates too; the answer to a drive turned upside down is not turned upside down"
    confusable_with = ("sensor_saturation",)
    shown_by = "a pulse and the same one upside down, and a slow loop over the whole range"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        off = {"asymmetry": 0.0, "bending": 0.0, "lean": 0.0}
        return [off | {name: value} for name, value in (("asymmetry", 0.03), ("bending", 0.03), ("lean", 0.1))]

    def told(self, values: Values, unit: str = "V") -> str:
        said = []
        if values["asymmetry"] or values["bending"]:
            small, large = 2 * values["asymmetry"], 2 * (values["asymmetry"] + values["bending"])
            said.append(
                f"Compared with negative drives, positive ones move the head {_further(small)} where they are small "
                f"and {_further(large)} at half the full scale."
            )
        if values["lean"]:
            wider = "negative" if values["lean"] > 0 else "positive"
            said.append(
                f"The hysteresis loop is wider at {wider} drives: its rising and falling branches differ in slope by "
                f"{percent(2 * abs(values['lean']))}."
            )
        return " ".join(said) or self.sentence

    def hysteresis(self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, shot: Shot) -> Real:
        asymmetry, bending = values["asymmetry"], values["bending"] / (0.5 * printhead.full_scale_V)
        if values["lean"]:
            ends_V = np.append(drive_V, drive_V[0]) if shot.periodic else np.ascontiguousarray(drive_V)
            law, periodic = printhead.branch_law, shot.periodic
            change_V = leaning_plays_V(ends_V, values["lean"], law, periodic)
            change_V -= leaning_plays_V(ends_V, 0.0, law, periodic)
            hysteretic_V = hysteretic_V + change_V[: drive_V.size]
        if asymmetry == bending == 0:
            return hysteretic_V
        result: Real = hysteretic_V + asymmetry * np.abs(hysteretic_V) + bending * hysteretic_V * hysteretic_V
        return result


def leaning_plays_V(ends_V: Real, lean: float, law: BranchLaw, periodic: bool, plays: int = PLAYS) -> Real:
    """What leaning plays in place of the law give, but for its linear part, shape (n,); see `play_sum_V`."""
    from inkjet_env.plant import compiled_hysteresis

    return play_sum_V(compiled_hysteresis.leaning_plays, ends_V, lean, law, periodic, plays)


def _further(part: float) -> str:
    return f"{percent(abs(part))} {'less far' if part < 0 else 'further'}"
