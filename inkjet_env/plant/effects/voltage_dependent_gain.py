"""Electrostriction: a displacement in proportion to the square of the drive, and a gain that depends on the bias."""

from __future__ import annotations

from collections.abc import Sequence

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.wording import percent
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real


class VoltageDependentGain(Effect):
    """A square and a cube of the voltage at the ceramic, without hysteresis, added to the hysteretic drive."""

    id = "voltage_dependent_gain"
    stage = "hysteresis"
    sentence = "The displacement per volt changes with the voltage: part of it goes with the square of the drive."
    equation = (
        "v + (electrostriction u / H + stiffening u² / H²) w, w = u + remanent (v - u), H half the law's full scale"
    )
    source = (
        "R. E. Newnham, V. Sundar, R. Yimnirun, J. Su, Q. M. Zhang, Electrostriction: nonlinear electromechanical "
        "coupling in solid dielectrics, Journal of Physical Chemistry B 101, 1997"
    )
    parameters = (
        Parameter(
            "electrostriction", "1", -0.5, 0.5, meaning="quadratic displacement over the drive, at half the full scale"
        ),
        Parameter("stiffening", "1", -0.5, 0.5, meaning="cubic displacement over the drive, at half the full scale"),
        Parameter(
            "remanent", "1", -0.5, 1.5, meaning="share of w that follows the loop; 1: a gain set by bias", plain=0.0
        ),
    )
    strengths = ("electrostriction", "stiffening")
    signature = "even harmonics with the square of the drive, at any rate; small loops keep their shape"
    confusable_with = ("asymmetric_hysteresis", "depolarisation")
    shown_by = "small loops on top of several positive and negative bias voltages"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        return [
            {"electrostriction": 0.03, "stiffening": 0.0, "remanent": 0.0},
            {"electrostriction": 0.0, "stiffening": 0.03, "remanent": 0.0},
            {"electrostriction": 0.0, "stiffening": -0.03, "remanent": 0.0},
        ]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"electrostriction": 0.04}

    def description(self, values: Values, unit: str = "V") -> str:
        terms = {"square": values["electrostriction"], "cube": values["stiffening"]}
        said = [f"{percent(part, signed=True)} by a term in its {power}" for power, part in terms.items() if part]
        if not said:
            return self.sentence
        loop = ", which follows the hysteresis loop" if values["remanent"] > 0.5 else ""
        return f"At a drive of half the full scale the displacement changes by {' and '.join(said)}{loop}."

    def hysteresis(
        self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        if values["electrostriction"] == values["stiffening"] == 0:
            return hysteretic_V
        share = drive_V / (0.5 * printhead.full_scale_V)
        carrier_V = drive_V + values["remanent"] * (hysteretic_V - drive_V)
        added_V: Real = (values["electrostriction"] + values["stiffening"] * share) * share * carrier_V
        return hysteretic_V + added_V
