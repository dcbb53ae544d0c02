"""Hysteresis whose positive and negative, or rising and falling, branches differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.plays import PLAYS, play_sum_V
from inkjet_env.plant.stages import law_levels
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.hysteresis import BranchLaw
from inkjet_env.typing import Real

KNEE = 0.1
"""Knee of a start, as a share of the law's full scale."""


class AsymmetricHysteresis(Effect):
    """Plays whose rising and falling branches differ, with even terms of the characteristics before and after them."""

    id = "asymmetric_hysteresis"
    stage = "hysteresis"
    sentence = "Rising and falling, or positive and negative, branches of the hysteresis differ."
    equation = (
        "v + (asymmetry + bowing sign v) max(|v| - knee_V, 0) + bending v² / H; v of the drive u + arching u² / H; "
        "plays between (1 + lean + tilt r / H) u - r and (1 - lean - tilt r / H) u + r; H half the law's full scale"
    )
    source = (
        "the superposition operator of a threshold in K. Kuhnen, Modeling, identification and compensation of complex "
        "hysteretic nonlinearities: a modified Prandtl-Ishlinskii approach, European Journal of Control 9(4), 2003; "
        "generalized plays of M. Al Janaideh, S. Rakheja, C.-Y. Su, An analytical generalized Prandtl-Ishlinskii model "
        "inversion for hysteresis compensation in micropositioning control, IEEE/ASME Trans. Mechatronics 16(4), 2011"
    )
    parameters = (
        Parameter("asymmetry", "1", -0.5, 0.5, meaning="relative rise of the slope at v > 0, and fall at v < 0"),
        Parameter(
            "knee_V",
            "V",
            0.0,
            1e3,
            meaning="hysteretic drive above which the slopes change",
            open_ended=True,
            plain=0.0,
        ),
        Parameter("bowing", "1", -0.5, 0.5, meaning="relative rise of both slopes above the knee"),
        Parameter("bending", "1", -0.5, 0.5, meaning="relative even quadratic term at half the law's full scale"),
        Parameter("arching", "1", -0.5, 0.5, meaning="the same for the drive, before the hysteresis"),
        Parameter(
            "lean", "1", -0.5, 0.5, meaning="relative rise of the plays' slope when rising, and fall when falling"
        ),
        Parameter("tilt", "1", -1.0, 1.0, meaning="the same in proportion to the threshold, at half the full scale"),
    )
    strengths = ("asymmetry", "bowing", "bending", "arching", "lean", "tilt")
    terms = (("asymmetry",), ("bowing", "knee_V"), ("bending",), ("arching",), ("lean",), ("tilt",))
    signature = "even harmonics, also at slow rates; the response to an inverted drive is not the inverted response"
    confusable_with = ("sensor_saturation", "voltage_dependent_gain", "depolarisation")
    shown_by = "a pulse, the same pulse inverted, and a slow loop over the whole range"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        off = dict.fromkeys(self.strengths, 0.0) | {"knee_V": 0.0}
        knee = {"knee_V": KNEE * printhead.full_scale_V}
        sizes = {"asymmetry": 0.03, "bending": 0.03, "arching": 0.03, "lean": 0.1, "tilt": 0.2}
        return [*(off | {name: size} for name, size in sizes.items()), off | {"asymmetry": 0.05} | knee]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"asymmetry": 0.03, "bending": 0.02}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        return {"knee_V": (0.0, 0.5 * printhead.full_scale_V)}

    def description(self, values: Values, unit: str = "V") -> str:
        said = []
        even = values["bending"] + values["arching"]
        asymmetry = values["asymmetry"]
        if asymmetry and values["knee_V"]:
            knee = with_prefix(values["knee_V"], "V")
            said.append(
                f"Above {knee}, the head moves {_further(2 * asymmetry)} per volt at positive than at negative drive."
            )
            asymmetry = 0.0
        if asymmetry or even:
            small, large = 2 * asymmetry, 2 * (asymmetry + even)
            said.append(f"Compared with negative drives, {_compared(small, large)}.")
        lean = values["lean"] + 0.5 * values["tilt"]
        if lean:
            wider = "negative" if lean > 0 else "positive"
            said.append(
                f"The hysteresis loop is wider at {wider} drives: its rising and falling branches differ in slope by "
                f"{percent(2 * abs(lean))}."
            )
        return " ".join(said) or self.sentence

    def hysteresis(
        self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        half_V = 0.5 * printhead.full_scale_V
        asymmetry, bowing, bending = values["asymmetry"], values["bowing"], values["bending"] / half_V
        lean, tilt = values["lean"], values["tilt"] / half_V
        if values["arching"]:
            arched_V = drive_V + values["arching"] / half_V * drive_V * drive_V
            hysteretic_V = (
                hysteretic_V + law_levels(arched_V, printhead, excitation) - law_levels(drive_V, printhead, excitation)
            )
            drive_V = arched_V
        if lean or tilt:
            ends_V = np.append(drive_V, drive_V[0]) if excitation.periodic else np.ascontiguousarray(drive_V)
            law, periodic = printhead.branch_law, excitation.periodic
            change_V = leaning_plays_V(ends_V, lean, tilt, law, periodic)
            change_V -= leaning_plays_V(ends_V, 0.0, 0.0, law, periodic)
            hysteretic_V = hysteretic_V + change_V[: drive_V.size]
        if asymmetry == bowing == bending == 0:
            return hysteretic_V
        beyond_V = np.maximum(np.abs(hysteretic_V) - values["knee_V"], 0.0)
        slope = asymmetry + bowing * np.sign(hysteretic_V)
        result: Real = hysteretic_V + slope * beyond_V + bending * hysteretic_V * hysteretic_V
        return result


def leaning_plays_V(
    ends_V: Real, lean: float, tilt_per_V: float, law: BranchLaw, periodic: bool, plays: int = PLAYS
) -> Real:
    """Output in volts of leaning plays that replace the law, without its linear part, shape (n,); see `play_sum_V`.

    The branches of a play with threshold r have slopes ``1 ± (lean + r tilt_per_V)``.
    """
    from inkjet_env.plant import compiled_hysteresis

    return play_sum_V(compiled_hysteresis.leaning_plays, ends_V, (lean, tilt_per_V), law, periodic, plays)


def _compared(small: float, large: float) -> str:
    """How positive drives, small and of half the full scale, differ."""
    if small == large:
        return f"positive drives move the head {_further(small)}"
    if not small:
        return f"positive drives of half the full scale move the head {_further(large)}"
    return f"small positive drives move the head {_further(small)}, and those of half the full scale {_further(large)}"


def _further(term: float) -> str:
    if not term:
        return "as far"
    return f"{percent(abs(term))} {'less far' if term < 0 else 'further'}"
