"""A flexible model of what a model leaves: it finds structure on recordings it has not seen, and none in noise."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection.discrepancy_regression import discrepancy_regression
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis
from inkjet_env.plant.active_effects import ActiveEffects

SETTINGS = DiagnosisSettings()


@pytest.fixture(scope="module")
def plain(recorded, fitted):
    return fitted(recorded())


def noise_of(o, joint, rng):
    return joint.noise.models[o.noise_key].rms * rng.standard_normal(o.excitation.samples)


@pytest.mark.parametrize("name", ["feedthrough", "quadratic_damping", "wave_echo", "second_mode"])
def test_planted_structure_is_predicted_on_held_out_recordings(name, recorded, fitted):
    found = discrepancy_regression(base_hypothesis(fitted(recorded(name))))
    assert found.predicted > 8 + 2 * found.error
    assert 0.25 < found.share < 1


def test_of_noise_it_predicts_nothing(plain):
    """Over campaigns that differ by their noise alone."""
    rng, sure, shares = np.random.default_rng(41), 0, []
    clean = {o.name: plain.start.plant().signal(o.excitation) for o in plain.observed}
    for _ in range(12):
        observed = [replace(o, measured=clean[o.name] + noise_of(o, plain, rng)) for o in plain.observed]
        found = discrepancy_regression(base_hypothesis(OutputErrorFit(observed, plain.noise, plain.start, SETTINGS)))
        sure += found.predicted > 8 + 2 * found.error
        shares.append(found.share)
    assert sure == 0
    assert max(shares) < 0.02


def test_the_gain_is_that_of_the_held_out_recordings(recorded, fitted):
    joint = fitted(recorded("quadratic_damping"))
    base = base_hypothesis(joint)
    found = discrepancy_regression(base)
    before = after = 0.0
    for o in joint.observed:
        if not o.fitted:
            before += np.sum(base.fit.residuals[o.name] ** 2)
            after += np.sum((base.fit.residuals[o.name] - found.modelled[o.name]) ** 2)
    assert found.predicted == pytest.approx(0.5 * (before - after))
    assert found.share == pytest.approx(1 - after / before)
    assert found.modelled.keys() == {o.name for o in joint.observed}


def test_it_learns_nothing_from_what_was_held_out(recorded, fitted):
    joint = fitted(recorded("quadratic_damping"))
    rng = np.random.default_rng(42)
    changed = [
        o if o.fitted else replace(o, measured=o.measured + 50 * noise_of(o, joint, rng)) for o in joint.observed
    ]
    other = discrepancy_regression(base_hypothesis(OutputErrorFit(changed, joint.noise, joint.start, SETTINGS)))
    one = discrepancy_regression(base_hypothesis(joint))
    for name, added in one.modelled.items():
        np.testing.assert_allclose(other.modelled[name], added, atol=1e-9)


def test_nothing_is_left_to_learn_once_the_effect_is_in_the_model(recorded, fitted, effects, values):
    joint, effect = fitted(recorded("quadratic_damping")), effects["quadratic_damping"]
    fit = joint.fit(ActiveEffects.of([(effect, values("quadratic_damping"))]))
    found = discrepancy_regression(Hypothesis(fit, joint))
    assert found.predicted < 8 + 2 * found.error
    assert found.share < 0.02


def test_a_campaign_without_held_out_recordings_predicts_nothing(recorded, fitted):
    found = discrepancy_regression(base_hypothesis(fitted(recorded("quadratic_damping"), held_out=())))
    assert (found.predicted, found.error, found.share) == (0.0, 0.0, 0.0)


def test_a_strain_gauges_mismatch_is_learnt_too(recorded, fitted):
    """Loops at three rates whose two halves differ."""
    campaign = recorded(slow=("loop-0.5", "loop-1", "loop-5"))
    held_out = min(campaign.select("strain_gauge"), key=lambda r: r.step_s).name
    joint = fitted(campaign, (held_out,))
    changed, shapes = [], {}
    for o in joint.observed:
        if o.channel == "strain_gauge":
            level_V = o.excitation.sampled(
                joint.start.plant().hysteretic_V(o.excitation.drive_at_nodes_V, o.excitation)
            )
            shapes[o.name] = 4 * joint.noise.models[o.noise_key].rms * np.abs(level_V) / np.abs(level_V).max()
            o = replace(o, measured=o.measured + shapes[o.name])
        changed.append(o)
    found = discrepancy_regression(base_hypothesis(OutputErrorFit(changed, joint.noise, joint.start, SETTINGS)))
    assert np.corrcoef(found.modelled[held_out], shapes[held_out])[0, 1] > 0.9
    assert found.predicted > 8 + 2 * found.error
