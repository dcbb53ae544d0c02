"""What a verdict rests on: how much is left, and how surely."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.evidence import unexplained_share
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.selection.discrepancy_regression import discrepancy_regression
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis, settled
from inkjet_env.plant.active_effects import ActiveEffects

SETTINGS = DiagnosisSettings()

FEW = 200
"""Samples that tell the noise: its variance is known to 10 %."""


def hardly_told(joint):
    """The same where little tells how loud the noise is."""
    noise = Noise(joint.noise.models, dict.fromkeys(joint.noise.samples, FEW), (), joint.noise.least)
    return OutputErrorFit(joint.observed, noise, joint.start, SETTINGS)


@pytest.fixture(scope="module")
def explained(recorded, fitted, effects, values):
    joint, effect = hardly_told(fitted(recorded("feedthrough", strength=3.0))), effects["feedthrough"]
    return settled(joint, joint.fit(ActiveEffects.of([(effect, values("feedthrough", 3.0))])))


def louder(hypothesis, factors):
    """The hypothesis with the rest of some recordings multiplied."""
    residuals = {name: factors.get(name, 1.0) * rest for name, rest in hypothesis.fit.residuals.items()}
    return Hypothesis(replace(hypothesis.fit, residuals=residuals), hypothesis.joint)


def share(chosen):
    return unexplained_share(base_hypothesis(chosen.joint), chosen, discrepancy_regression(chosen))


def fast(chosen):
    return [o.name for o in chosen.joint.seen if o.excitation.fast]


def test_nothing_is_left_of_what_is_explained(explained):
    assert share(explained) == 0


def test_a_rest_that_is_louder_in_few_recordings_is_no_noise_however_badly_that_is_known(explained):
    joint, one = explained.joint, fast(explained)[0]
    moved = [o for o in joint.seen if o.excitation.fast]
    mismatch = sum(float(np.sum(joint.base.residuals[o.name][: o.fitted] ** 2)) - o.fitted for o in moved)
    more = 1.25 * float(np.sum(explained.fit.residuals[one] ** 2))
    assert share(louder(explained, {one: 1.5})) == pytest.approx(more / mismatch, rel=0.1)


def test_of_the_whole_mismatch_counts_what_few_recordings_of_another_rate_showed(explained):
    """Two gauges' recordings that the base model failed on, too few to tell their usual level."""
    joint, one = explained.joint, fast(explained)[0]
    slow = [o for o in joint.seen if not o.excitation.fast and o.channel != "drive_monitor"]
    assert 0 < len(slow) < SETTINGS.verdict.usual_level_recordings
    failed = louder(Hypothesis(joint.base, joint), {o.name: 40.0 for o in slow})
    chosen = louder(explained, {one: 1.5})
    less = unexplained_share(failed, chosen, discrepancy_regression(chosen))
    assert 0 < less < 0.5 * share(chosen)


def test_a_rest_that_is_as_loud_everywhere_may_be_noise(explained):
    assert share(louder(explained, dict.fromkeys(fast(explained), 1.1))) == 0


def test_of_few_recordings_none_is_called_loud(explained):
    few = [o for o in explained.joint.observed if not o.excitation.fast or o.name in fast(explained)[:4]]
    joint = OutputErrorFit(few, explained.joint.noise, explained.joint.start, SETTINGS)
    fit = joint.fit(explained.fit.active)
    assert share(louder(Hypothesis(fit, joint), {fast(explained)[0]: 1.4})) == 0


def test_where_nothing_was_chosen_only_the_sum_counts(recorded, fitted):
    joint = hardly_told(fitted(recorded("feedthrough")))
    base = base_hypothesis(joint)
    assert base.excess > 0.1 * base.residuals.size
    assert unexplained_share(base, base, discrepancy_regression(base)) == 0
