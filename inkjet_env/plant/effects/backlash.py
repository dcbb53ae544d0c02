"""Play in the joint between ceramic and moving mass: part of the travel is lost at each reversal, or around rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.limiter import limited
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

SHARES = (0.005, 0.02, 0.05)
"""Gaps of the starts, as shares of the largest drive."""
SOFT = (0.1, 0.3)
"""Half widths of soft zones of the starts, likewise."""

CORNERS = 100.0
"""Hardness of a zone with corners."""


class Backlash(Effect):
    """A play of fixed gap, and a dead zone, in series behind the hysteresis.

    The two are the usual models of a clearance: with friction the mass stays where it was left within the gap, so that
    travel is lost at each reversal; with springs that centre it, travel is lost around rest only. Both act on the
    motion that the ceramic transmits, before the resonator. A gap within the resonator, which would change the ringing
    of small amplitude, is not meant.
    """

    id = "backlash"
    stage = "hysteresis"
    sentence = "The joint between ceramic and moving mass has play, so part of the travel is lost."
    equation = (
        "v → P_gap[Z(v)], P the play w = max(v - gap_V, min(v + gap_V, w)), "
        "Z(v) = v - lost v / (1 + |v / dead_zone_V|^h)^(1/h), h = hardness"
    )
    source = "M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38, 2002"
    parameters = (
        Parameter("gap_V", "V", 0.0, 1e3, meaning="half the gap of the play, in hysteretic volts"),
        Parameter("dead_zone_V", "V", 0.0, 1e3, meaning="half the width of the dead zone, in hysteretic volts"),
        Parameter(
            "lost", "1", -1.0, 1.0, meaning="share of the travel that is lost in the zone; less: a glue", plain=1.0
        ),
        Parameter(
            "hardness",
            "1",
            1.0,
            CORNERS,
            "log",
            "20 and more: the zone has corners; less: it fades out",
            open_ended=True,
            plain=CORNERS,
        ),
    )
    strengths = ("gap_V", "dead_zone_V")
    signature = "the same travel is lost at each reversal, or around rest, whatever the amplitude: small loops vanish"
    confusable_with = ("voltage_dependent_gain", "supply_droop", "rate_dependent_hysteresis")
    shown_by = "loops of the same rate whose amplitude falls to a few volts"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        largest_V = max((float(np.abs(s.drive_V).max()) for s in excitations), default=0.0) or printhead.full_scale_V
        clear = [{name: min(share * largest_V, 1e3)} for name in self.strengths for share in SHARES]
        soft = [{"dead_zone_V": min(share * largest_V, 1e3), "lost": 0.05, "hardness": 3.0} for share in SOFT]
        return [complete(self, **values) for values in (*clear, *soft)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"gap_V": 1.5}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        largest_V = max((float(np.abs(s.drive_V).max()) for s in excitations), default=0.0)
        return dict.fromkeys(self.strengths, (0.0, min(0.5 * largest_V, 1e3))) if largest_V > 1e-6 else {}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return None if any(np.ptp(s.drive_V) > 0 for s in excitations) else "no recording has a drive that changes"

    def description(self, values: Values, unit: str = "V") -> str:
        said = []
        if values["gap_V"]:
            said.append(f"{with_prefix(2 * values['gap_V'], 'V')} of the hysteretic drive are lost at each reversal")
        if values["dead_zone_V"]:
            moves = "nothing moves" if values["lost"] == 1 else f"{percent(values['lost'])} of the travel is lost"
            said.append(f"within ±{with_prefix(values['dead_zone_V'], 'V')} of rest {moves}")
        return f"The joint has play: {' and '.join(said)}." if said else self.sentence

    def hysteresis(
        self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        from inkjet_env.plant import compiled_hysteresis

        gap_V, dead_V = values["gap_V"], values["dead_zone_V"]
        moved_V = hysteretic_V
        if dead_V:
            hardness = values["hardness"]
            within_V = (
                limited(moved_V, np.abs(moved_V) / dead_V, hardness)
                if hardness < CORNERS
                else np.clip(moved_V, -dead_V, dead_V)
            )
            moved_V = moved_V - values["lost"] * within_V
        if gap_V == 0:
            return moved_V
        output_V = np.empty(moved_V.size)
        periods = 2 if excitation.periodic else 1
        compiled_hysteresis.played(np.ascontiguousarray(moved_V), gap_V, periods, output_V)
        return output_V
