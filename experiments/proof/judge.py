"""Judgement of an answer against the truth, which only the concealed plant knows."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from inkjet_env.experiments.execution.provenance import code_digest
from inkjet_env.experiments.proof.campaign_files import ProofError
from inkjet_env.experiments.proof.concealment import plant_of
from inkjet_env.experiments.proof.corpus import Draw
from inkjet_env.experiments.proof.sealing import JUDGE_SOURCES

COMPARED = {
    ("amplifier_bandwidth", "bandwidth_Hz"): ("bandwidth_Hz", ("first_order",)),
    ("sensor_bandwidth", "bandwidth_Hz"): ("bandwidth_Hz", ("first_order",)),
    ("slew_limit", "slew_rate_V_s"): ("slew_rate_V_per_s", ("hard", "soft")),
    ("trigger_delay", "delay_s"): ("delay_s", ()),
    ("second_mode", "frequency_Hz"): ("frequency_Hz", ("parallel",)),
    ("second_mode", "damping_ratio"): ("damping_ratio", ("parallel",)),
    ("second_mode", "strength"): ("share", ("parallel",)),
    ("wave_echo", "delay_s"): ("delay_s", ("single_return",)),
    ("wave_echo", "strength"): ("share", ("single_return",)),
    ("air_bubble", "bubble_frequency_Hz"): ("frequency_Hz", ("compliant",)),
    ("air_bubble", "bubble_damping_ratio"): ("damping_ratio", ("compliant",)),
    ("feedthrough", "capacitive_s"): ("feedthrough_s", ("capacitive",)),
    ("sensor_saturation", "limit"): ("level_V", ("clip",)),
    ("mains_hum", "frequency_Hz"): ("frequency_Hz", ()),
    ("drive_resonance", "frequency_Hz"): ("frequency_Hz", ("series",)),
    ("drive_resonance", "damping_ratio"): ("damping_ratio", ("series",)),
    ("supply_droop", "droop"): ("droop_per_100_V", ("common",)),
    ("supply_droop", "recovery_s"): ("recovery_s", ("common",)),
    ("generator_steps", "update_s"): ("update_s", ("hold",)),
    ("generator_steps", "resolution_V"): ("step_V", ("bits",)),
    ("self_heating", "cooling_s"): ("time_s", ("burst",)),
    ("sensor_highpass", "corner_Hz"): ("frequency_Hz", ("first_order",)),
    ("timebase_error", "skew"): ("rate_error", ("constant",)),
}
"""Parameters with the same meaning in diagnosis and concealed plant: the plant's name for each, and the variants in
which both use the same equation (all if none is listed): fitted to the plant's signal without noise, the diagnosis's
law gives the plant's value. Parameters that depend on hysteretic volts, a convention that the two models need not
share, and parameters of differing equations (such as the limit of a tanh, or a loss factor of the static stiffness) are
left out."""
MEANING_CHANGES_WITH = {"air_bubble": "mass_ratio"}
"""By effect: the parameter with which its others mean something else, so that none is compared if a verdict has it."""
COVERED = 0.5
"""Fraction of the true segments that the reported location must cover."""


def questions(draws: Sequence[Draw], reoptimise: int, baselines: int) -> dict[int, dict[str, bool]]:
    """Additional questions about each case, by its number.

    Parameters
    ----------
    draws : sequence of Draw
        The corpus.
    reoptimise, baselines : int
        Number of heads whose waveform is re-optimised, and of campaigns on which the baselines are tried; both are
        chosen in turn from all strong effects that fresh drives show.
    """
    from inkjet_env.experiments.proof.fresh_drive_error import UNPREDICTABLE

    turns: Counter[str] = Counter()
    shown = []
    for draw in sorted(draws, key=lambda draw: draw.number):
        effect = draw.effects[0] if draw.family == "effect" else ""
        whole = not (draw.meagre or draw.slow_only)
        if effect and draw.strength == "strong" and whole and effect not in UNPREDICTABLE:
            shown.append((turns[effect], draw.number))
            turns[effect] += 1
    chosen = [number for _, number in sorted(shown)]
    return {
        draw.number: {
            "reoptimise": draw.number in chosen[:reoptimise],
            "baselines": draw.number in chosen[:baselines],
        }
        for draw in draws
    }


def judge_case(
    case: Mapping[str, Any], answer: Mapping[str, Any], packed: bytes, asked: Mapping[str, Any], rig: str, code: str
) -> dict[str, Any]:
    """All results on one answer that require the truth.

    Parameters
    ----------
    case : dict
        The case as sealed: draw, attempt, truth.
    answer : dict
        The answer from `blind_run.diagnose_blind`.
    packed : bytes
        Files of the campaign.
    asked : dict
        Whether to ``reoptimise`` and to try the ``baselines``.
    rig, code : str
        Module of the concealed plant, and the digest of the code that judges.

    Raises
    ------
    ProofError
        The worker has other code.
    """
    if code_digest(JUDGE_SOURCES) != code:
        raise ProofError("the judge's code was changed, here or at a worker. Restart the workers with the same code.")
    draw, truth = Draw.from_json(dict(case["draw"])), case["truth"]
    nothing: dict[str, Any] = {"closure": None, "fresh": None, "parameters": [], "location": {}}
    verdict = answer["verdict"]
    if verdict is None:
        return nothing
    found = nothing | {"parameters": parameters(verdict, truth), "location": located(verdict, truth)}
    if draw.slow_only:  # without dynamics there is nothing to predict fresh drives with
        return found
    plant = plant_of(draw, case["attempt"], rig)
    if draw.family in ("effect", "pair", "outside", "base"):
        from inkjet_env.experiments.proof.fresh_drive_error import UNPREDICTABLE, closure, model_of

        base, augmented = model_of(answer["base"]), model_of(answer["augmented"])
        if not set(draw.effects) & set(UNPREDICTABLE):
            found["fresh"] = closure(base, augmented, plant, draw.case_seed(case["attempt"]))
            found["closure"] = found["fresh"]["closure"]
        if asked.get("reoptimise"):
            from inkjet_env.experiments.proof.waveform_gain import reoptimised_costs

            found["reoptimised"] = reoptimised_costs(answer["base"], answer["augmented"], plant, draw.number)
    if asked.get("baselines"):
        from inkjet_env.experiments.proof.baselines import baselines

        found["baselines"] = baselines(packed, draw.effects, verdict)
    return found


def parameters(verdict: Mapping[str, Any], truth: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Estimates and true values of the parameters in `COMPARED`, for effects that were found correctly."""
    rows = []
    concealed = {entry["id"]: entry for entry in truth["effects"]}
    for effect in verdict["effects"]:
        true = concealed.get(effect["id"])
        if MEANING_CHANGES_WITH.get(effect["id"]) in effect["parameters"]:
            continue
        for name, estimate in effect["parameters"].items():
            there, variants = COMPARED.get((effect["id"], name), ("", ()))
            if not there or true is None or (variants and true["variant"] not in variants):
                continue
            if estimate["value"] is not None and true["parameters"][there]:
                row = {"effect": effect["id"], "parameter": name, "truth": float(true["parameters"][there])}
                rows.append(row | {part: estimate[part] for part in ("value", "low", "high", "unit")})
    return rows


def located(verdict: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, bool]:
    """Whether the reported recordings, times, frequencies and drives cover those where the effect is strongest.

    Empty if the effect shows nowhere.
    """
    reported, details = verdict["location"], truth["location"]["details"]
    if not details:
        return {}

    def held(
        spans: Sequence[Sequence[float]], among: Sequence[Sequence[float]], scale: Callable[[float], float]
    ) -> bool:
        places = [(scale(low), scale(high)) for low, high in among]
        return sum(_covered((scale(low), scale(high)), places) for low, high in spans) >= COVERED * len(spans)

    largest_V = [max(map(abs, one["recording_drive_V"])) for one in details]
    return {
        "recordings": sum(one["recording"] in reported["recordings"] for one in details) >= COVERED * len(details),
        "time": held([one["time_s"] for one in details], reported["time_s"], float),
        "frequency": held([one["frequency_Hz"] for one in details], reported["frequency_Hz"], _log),
        "drive": held([(volts, volts) for volts in largest_V], reported["drive_V"], float),
    }


def _log(value: float) -> float:
    return math.log(max(value, 1e-12))


def _covered(span: tuple[float, float], reported: Sequence[tuple[float, float]]) -> float:
    """Fraction of an interval that lies in the union of others; for a point, 1 or 0."""
    low, high = span
    if high <= low:
        return float(any(a <= low <= b for a, b in reported))
    total, reached = 0.0, low
    for a, b in sorted(reported):
        a, b = max(a, reached), min(b, high)
        if b > a:
            total, reached = total + b - a, b
    return total / (high - low)
