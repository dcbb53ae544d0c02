"""A law that goes straight from some swing on is the base model's: what no polynomial follows is no effect's doing."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.validation.synthetic_campaigns import record_synthetic, synthetic_values
from inkjet_env.mismatch import DiagnosisSettings, diagnose
from inkjet_env.mismatch.fitting.base_model import base_model
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.mismatch.selection.hypotheses import base_hypothesis
from inkjet_env.mismatch.selection.truncated_law import fit_truncated_law, narrower
from inkjet_env.printhead import Printhead
from inkjet_env.rig.battery import default_battery

SETTINGS = DiagnosisSettings()

SUSPECTS = ("cubic_stiffness", "asymmetric_hysteresis")
DRIVES = ("trapezoid-minus100V", "bipolar-full", "first-bipolar", "multisine-95V-a", "multisine-95V-b", "zero")
PUBLISHED = Printhead.published()
"""Its law goes straight from 180 V on."""


def recorded_without_a_gauge(*effects, printhead=PUBLISHED):
    """Self-sensing alone, of little noise, swinging over 200 V."""
    lines = [line for line in default_battery(printhead.frequency_Hz) if line.label in DRIVES]
    campaign = record_synthetic(printhead, effects, 3, 70.0, False, lines)
    return replace(campaign, recordings=tuple(r for r in campaign.recordings if r.channel == "self_sensing"))


def bent_and_not(campaign):
    joint = base_model(campaign, observe(campaign, None), None, None, lambda _: None, SETTINGS)
    return fit_truncated_law(joint, base_hypothesis(joint)), joint


def test_the_swing_from_which_a_law_goes_straight_is_found():
    bent, joint = bent_and_not(recorded_without_a_gauge())
    assert joint.base.head.printhead.full_scale_V == pytest.approx(200)
    assert bent.base.head.printhead.full_scale_V == pytest.approx(PUBLISHED.full_scale_V, rel=0.01)
    assert joint.base.nll - bent.base.nll > 50


def test_a_polynomial_law_is_left_alone():
    polynomial = narrower(Head(PUBLISHED, {}, {}), 200 / PUBLISHED.full_scale_V).printhead
    bent, _ = bent_and_not(recorded_without_a_gauge(printhead=polynomial))
    assert bent is None


def test_no_effect_is_blamed_for_it(effects):
    found = diagnose(recorded_without_a_gauge(), effects=[effects[name] for name in SUSPECTS])
    assert found.verdict == "none", found.headline


def swing_V(head, change_V):
    """Swing of a branch; above full scale, a law is straight."""
    scale, law = head.full_scale_V, head.branch_law
    over_V = max(change_V - scale, 0.0)
    slope = (law.Q(1.0) - law.Q(1.0 - 1e-6)) / 1e-6
    return scale * float(law.Q(min(change_V / scale, 1.0))) + slope * over_V


def test_an_effect_beside_it_is_named_alone(effects):
    cubic = effects["cubic_stiffness"]
    campaign = recorded_without_a_gauge((cubic, synthetic_values(cubic, 0.03, PUBLISHED, largest_V=1.0)))
    found = diagnose(campaign, effects=[effects[name] for name in SUSPECTS])
    assert [named.effect.id for named in found.effects] == ["cubic_stiffness"], found.headline
    changes_V = np.linspace(20.0, 200.0, 40)  # whether or not the full scale is found, the law is
    fitted, true = (np.array([swing_V(head, v) for v in changes_V]) for head in (found.printhead, PUBLISHED))
    assert fitted / fitted[-1] == pytest.approx(true / true[-1], rel=0.01)


@pytest.mark.parametrize("part", [0.8, 1.1])
def test_a_law_is_cut_off_where_it_is_told_and_stays_itself_up_to_there(part):
    cut = narrower(Head(PUBLISHED, {}, {}), part).printhead
    assert cut.full_scale_V == pytest.approx(part * PUBLISHED.full_scale_V)
    swings_V = np.linspace(1.0, min(part, 1.0) * PUBLISHED.full_scale_V, 40)
    old, new = (
        np.array([law.full_scale_V * law.branch_law.Q(swing / law.full_scale_V) for swing in swings_V])
        for law in (PUBLISHED, cut)
    )
    # within the old law it is the same polynomial; beyond, the nearest one to a law that no polynomial is
    assert new == pytest.approx(old, rel=1e-9 if part < 1 else 0.005, abs=1e-9 if part < 1 else 0.15)
