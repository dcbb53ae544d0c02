"""An effect that only held-out recordings show: two steep pulses, on a head whose amplifier is slow enough for them."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.validation.synthetic_campaigns import record_synthetic
from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.selection.held_out_refit import held_out_misfits, held_out_otherwise
from inkjet_env.mismatch.selection.hypotheses import base_hypothesis
from tests.mismatch.conftest import campaign_lines
from tests.mismatch.diagnoses import LOOKED_FOR, ids

STEEP = ("r008", "r011")
"""Held out by default: edges of 35 and 128 V/µs; no other exceeds 32 V/µs."""


@pytest.fixture(scope="module")
def slow(head, effects, values):
    """A function: a campaign on a head with this slew limit, and with other effects."""

    def recorded(slew_rate_V_s, *others):
        limit = effects["slew_limit"], {"slew_rate_V_s": slew_rate_V_s, "lag_s": 1e-9, "fall_ratio": 1.0}
        planted = [limit, *((effects[name], values(name, alone=False)) for name in others)]
        return record_synthetic(head, planted, 3, 50.0, False, campaign_lines())

    return recorded


@pytest.mark.parametrize("others", [(), ("quadratic_damping",)])
def test_some_of_them_are_fitted_instead_and_the_effect_is_named(others, slow, head, effects):
    found = diagnose(slow(33e6, *others), head, [effects[name] for name in (*LOOKED_FOR, "slew_limit")], 0, workers=1)
    assert found.verdict == "named"
    assert set(ids(found)) == {"slew_limit", *others}
    assert found.closure > 0.9
    assert any("At first r011 were held out" in note for note in found.notes)


def test_whoever_says_what_is_held_out_is_heeded(slow, head, effects):
    looked_for = [effects[name] for name in (*LOOKED_FOR, "slew_limit")]
    found = diagnose(slow(33e6), head, looked_for, 0, workers=1, held_out=STEEP)
    assert found.verdict == "unknown"
    assert {r.name for r in found.recordings if r.held_out} == set(STEEP)


def test_the_recording_that_shows_most_is_fitted_and_another_checks_it(slow, fitted):
    joint = fitted(slow(33e6))
    assert held_out_misfits(joint, base_hypothesis(joint)) == ("r011", "r008")
    division = held_out_otherwise(joint, base_hypothesis(joint))
    assert (division.fitted, division.held_out) == (("r011",), ("r008",))


def test_a_few_spikes_of_a_noise_with_heavy_tails_are_no_mismatch(recorded, fitted):
    joint = fitted(recorded(seed=21, noise_kind="impulses"))
    (o, *_) = (o for o in joint.observed if not o.fitted)
    residuals = joint.base.residuals[o.name].copy()
    residuals[[50, 150, 250]] = 20.0, -25.0, 30.0  # five times the power of its 400 samples together
    spiky = replace(o, measured=o.measured + joint.noise.rms(o) * (residuals - joint.base.residuals[o.name]))
    louder = replace(o, measured=o.measured + joint.noise.rms(o) * 2 * np.sin(np.arange(o.measured.size) / 5))
    for other, told in ((spiky, ()), (louder, (o.name,))):
        changed = joint.anew(observed=[other if one is o else one for one in joint.observed])
        assert held_out_misfits(changed, base_hypothesis(changed)) == told


def test_one_recording_alone_stays_held_out_since_none_could_check_it(slow, fitted):
    joint = fitted(slow(118e6))
    assert held_out_misfits(joint, base_hypothesis(joint)) == ("r011",)
    assert held_out_otherwise(joint, base_hypothesis(joint)) is None
