"""Recordings that no fit sees: what they may take from a diagnosis, and what not."""

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.held_out import confirmed
from inkjet_env.mismatch.selection.held_out_refit import _at_its_own_resonance, explains_held_out_after_refit
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis, settled
from inkjet_env.plant import Plant
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete
from inkjet_env.recordings import Campaign

FEW = ("trapezoid-60V", "trapezoid-100V", "bipolar-full", "pulse-pair-0.50T")
"""Fast recordings that are enough for a damping."""


def ids(diagnosis):
    return [named.effect.id for named in diagnosis.effects]


def test_a_recording_that_was_held_out_tells_no_fit(recorded, head, effects):
    campaign = recorded("quadratic_damping", fast=FEW)
    looked_for = [effects["quadratic_damping"], effects["feedthrough"]]
    name = next(r.name for r in campaign.recordings if r.excitation == "pulse_pair")
    other = Campaign("other", tuple(
        replace(r, sensor=r.sensor[::-1].copy()) if r.name == name else r for r in campaign.recordings
    ))  # fmt: skip
    one, two = (diagnose(c, head, looked_for, held_out=[name], workers=1) for c in (campaign, other))
    assert one.verdict == "named"
    for first, second in zip(one.attributions, two.attributions, strict=True):
        assert (second.ids, second.description) == (first.ids, first.description)
        assert second.gain == pytest.approx(first.gain, rel=1e-9)
    assert [r.name for r in one.recordings if r.held_out] == [name]
    assert one.closure > 0.9 > two.closure


def held_out_from(other, campaign):
    """The campaign, but what is held out of it as another one has it."""
    unseen = {o.name for o in observe(campaign) if not o.fitted}
    return Campaign("altered", tuple(
        theirs if theirs.name in unseen else ours
        for ours, theirs in zip(campaign.recordings, other.recordings, strict=True)
    ))  # fmt: skip


def test_held_out_recordings_take_the_name_from_what_makes_them_worse_and_do_nothing_else(recorded_as, head, effects):
    same, turned = (recorded_as("feedthrough", capacitive_s=sign * 5e-9) for sign in (1, -1))
    looked_for = [effects["feedthrough"], effects["cubic_stiffness"]]
    names = [o.name for o in observe(same) if not o.fitted]
    named, vetoed = (
        diagnose(held_out_from(c, same), head, looked_for, held_out=names, workers=1) for c in (same, turned)
    )
    assert (named.verdict, ids(named)) == ("named", ["feedthrough"])
    assert named.closure > 0.7
    assert (vetoed.verdict, vetoed.effects, vetoed.candidates) == ("unknown", (), ())
    assert vetoed.closure < 0
    assert vetoed.left_over == 0  # of what was fitted: nothing else is against it
    assert vetoed.headline.startswith(
        "Unknown: feedthrough explains the fitted recordings but predicts the held-out ones poorly. "
    )
    assert vetoed.next_experiment is None
    for one, other in zip(named.attributions, vetoed.attributions, strict=True):
        assert (other.ids, other.gain) == (one.ids, pytest.approx(one.gain, rel=1e-6))
    # what is left standing is the base model whole: its law, its gains and its offsets
    plant = Plant(vetoed.printhead, vetoed.gains, vetoed.offsets)
    for o, recording in zip(observe(held_out_from(turned, same)), vetoed.recordings, strict=True):
        np.testing.assert_allclose(plant.signal(o.excitation), recording.modelled["base"], atol=1e-3)


def test_a_weak_effect_is_confirmed_by_how_held_out_recordings_move_not_by_how_loud_they_are(
    recorded_as, fitted, effects
):
    joint, effect = fitted(recorded_as("feedthrough", capacitive_s=1e-9)), effects["feedthrough"]

    def with_feedthrough(capacitive_s, **options):
        return joint.fit(ActiveEffects.of([(effect, complete(effect, capacitive_s=capacitive_s))]), **options)

    base, right = base_hypothesis(joint), settled(joint, with_feedthrough(1e-9))
    rng = np.random.default_rng(1)
    noise = {o.name: 0.3 * rng.standard_normal(o.excitation.samples) for o in joint.observed}

    def louder(h):
        return Hypothesis(replace(h.fit, residuals={n: r + noise[n] for n, r in h.fit.residuals.items()}), joint)

    assert confirmed(base, right)
    assert confirmed(louder(base), louder(right))
    assert not confirmed(base, Hypothesis(with_feedthrough(-1e-9, most_steps=0), joint))
    assert not confirmed(base, base)  # nothing is foretold


def test_what_came_where_all_was_held_out_keeps_its_name_and_says_that_it_was_predicted_worse(
    recorded_as, head, effects
):
    """A bubble from recording 6 on; 6 to 9 are held out, so nothing tells whether it came before or after them."""
    bubble = {"onset_order": 6.0, "frequency_change": -0.01, "bubble_frequency_Hz": 28800.0,
              "bubble_damping_ratio": 0.1, "bubble_strength": 0.05}  # fmt: skip
    campaign, looked_for = recorded_as("air_bubble", **bubble), [effects["air_bubble"], effects["feedthrough"]]
    found = diagnose(campaign, head, looked_for, held_out=["r006", "r007", "r008", "r009"], workers=1)
    assert (found.verdict, ids(found)) == ("named", ["air_bubble"])
    assert found.closure < 0
    assert found.headline.endswith("but are explained once they are fitted as well.")
    assert "recording 11 on" in found.headline
    assert found.effects[0].parameters["bubble_frequency_Hz"].value == pytest.approx(28800, rel=0.01)


def test_a_resonance_of_its_own_in_each_recording_serves_a_drift_and_no_other_law(recorded_as, fitted, effects):
    """Held-out recordings of another frequency are explained by a drift, however it goes, and not by a stiffness."""
    campaign = recorded_as(
        "thermal_drift", last_order=13.0, **{f"frequency_{k}": 2e-3 * (-1) ** k for k in range(1, 9)}
    )
    drift, stiffness = effects["thermal_drift"], effects["cubic_stiffness"]
    joint = fitted(campaign)
    smooth = joint.fit(ActiveEffects.of([(drift, complete(drift, last_order=13.0, frequency_3=1e-3))]), most_steps=0)
    stiff = joint.fit(ActiveEffects.of([(stiffness, complete(stiffness, stiffening_per_V2=1e-7))]), most_steps=0)
    for fit in (smooth, stiff):
        left = [_at_its_own_resonance(Hypothesis(fit, joint), o) for o in joint.observed if o.excitation.fast]
        whole = [fit.residuals[o.name][o.rows(held_out=True)] for o in joint.observed if o.excitation.fast]
        assert sum(float(r @ r) for r in left) < 0.3 * sum(float(r @ r) for r in whole)  # whichever law it is
    context = FitContext(ProcessPool(1))
    assert not explains_held_out_after_refit(joint, Hypothesis(stiff, joint), context)


def test_without_held_out_recordings_the_effect_is_named_all_the_same(recorded, head, effects):
    looked_for = [effects["quadratic_damping"], effects["feedthrough"]]
    found = diagnose(recorded("quadratic_damping", fast=FEW), head, looked_for, held_out=[], workers=1)
    assert (found.verdict, ids(found)) == ("named", ["quadratic_damping"])
    assert math.isnan(found.closure)
    assert found.as_json()["fit"]["closure"] is None


def test_all_held_out_is_refused(recorded, head):
    campaign = recorded()
    with pytest.raises(ValueError, match="all recordings of campaign 'synthetic' are held out"):
        diagnose(campaign, head, held_out=[r.name for r in campaign.recordings], workers=1)
    gauge = [r.name for r in campaign.recordings if r.channel == "strain_gauge"]
    with pytest.raises(
        ValueError, match=r"all recordings of channel strain_gauge .* so its gain and offset are unknown"
    ):
        diagnose(campaign, head, held_out=gauge, workers=1)


def test_what_only_a_held_out_recording_shows_is_not_called_nothing(recorded_as, recorded, head, effects):
    """An amplifier that only the steepest edge is too fast for, which no fit sees."""
    looked_for = [effects["slew_limit"], effects["feedthrough"]]
    campaign = recorded_as("slew_limit", slew_rate_V_s=60e6)
    steep = next(r.name for r in campaign.recordings if np.abs(np.diff(r.drive_V)).max() / r.step_s > 1e8)
    found = diagnose(campaign, head, looked_for, held_out=[steep], workers=1)
    assert (found.verdict, found.effects, found.closure) == ("unknown", (), 0.0)
    assert found.headline.startswith(f"Unknown: {steep} shows a mismatch that the fitted recordings do not show")
    assert ids(diagnose(campaign, head, looked_for, held_out=["r013"], workers=1)) == ["slew_limit"]
    # where nothing is concealed it may be held out
    assert diagnose(recorded(), head, looked_for, held_out=[steep], workers=1).verdict == "none"


def test_recordings_change_places_where_only_held_out_ones_show_a_mismatch(recorded_as, head, effects, monkeypatch):
    """By chance every edge that the amplifier is too slow for was held out. A user's own choice stays as it is."""
    looked_for = [effects["slew_limit"], effects["feedthrough"]]
    campaign = recorded_as("slew_limit", slew_rate_V_s=20e6)
    steep = {r.name for r in campaign.recordings if np.abs(np.diff(r.drive_V)).max() / r.step_s > 20e6}
    chance = importlib.import_module("inkjet_env.identification.measurements")
    monkeypatch.setattr(chance, "_every_fourth", lambda _: steep)
    found = diagnose(campaign, head, looked_for, workers=1)
    assert (found.verdict, ids(found)) == ("named", ["slew_limit"])
    still = {r.name for r in found.recordings if r.held_out}
    assert still < steep
    assert any(all(name in note for name in steep - still) and "fitted instead" in note for note in found.notes)
    kept = diagnose(campaign, head, looked_for, held_out=sorted(steep), workers=1)
    assert kept.verdict == "unknown"
    assert {r.name for r in kept.recordings if r.held_out} == steep


def test_a_base_model_that_predicts_badly_for_want_of_recordings_leaves_nothing_out(recorded, head, effects):
    """All that is of high voltage is held out, so the law's course up there is anybody's guess."""
    campaign = recorded()
    high = [r.name for r in campaign.recordings if np.abs(r.drive_V).max() > 85 and r.channel == "self_sensing"]
    found = diagnose(campaign, head, [effects["feedthrough"]], held_out=high, workers=1)
    assert (found.verdict, found.closure) == ("none", 0.0)
    assert (
        "to within their noise, the held-out ones once they are fitted as well: they show no missing effect"
        in found.headline
    )
