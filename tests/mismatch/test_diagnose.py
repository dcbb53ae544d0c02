"""From a campaign to a verdict, on small campaigns of known truth."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.diagnose import _Work
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.probabilities import NONE_OF_THESE
from tests.mismatch.diagnoses import LOOKED_FOR, ids


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_found_where_nothing_is(seed, diagnosed):
    found = diagnosed(seed=seed)
    assert (found.verdict, ids(found), found.candidates) == ("none", [], ())
    assert found.next_experiment is None
    assert found.remainder is None
    assert math.isnan(found.closure)
    assert found.heldout_rms("augmented") == found.heldout_rms("base")
    assert found.heldout_rms("base") == pytest.approx(found.heldout_rms("noise"), rel=0.15)


def test_the_whole_catalogue_finds_nothing_where_nothing_is(recorded):
    """By the whole way, identification and all."""
    found = diagnose(recorded(seed=11), workers=1)
    assert (found.verdict, ids(found)) == ("none", [])


def assert_estimates(named, truths):
    """Every value is within four standard errors of the truth, and known to two fifths of it or better."""
    for parameter, truth in truths.items():
        if parameter not in named.parameters:  # of a part of the law that is off
            assert truth == rest_value(named.effect, parameter)
            continue
        estimate = named.parameters[parameter]
        half_width = (estimate.high - estimate.low) / 2
        assert estimate.low < estimate.value < estimate.high
        assert abs(estimate.value - truth) < 2.5 * half_width
        assert half_width < 0.4 * abs(truth)


@pytest.mark.parametrize(
    ("name", "strength"),
    [("feedthrough", 1.0), ("cubic_stiffness", 0.35), ("quadratic_damping", 0.35), ("quadratic_damping", 1.0)],
)
def test_one_effect_is_named_with_its_values(name, strength, diagnosed, values):
    found = diagnosed(name, strength=strength)
    assert (found.verdict, ids(found), found.candidates) == ("named", [name], ())
    (named,) = found.effects
    assert_estimates(named, values(name, strength))
    assert named.delta_nll > 50
    assert named.p_value < 1e-6
    assert found.closure > 0.7
    assert found.heldout_rms("augmented") < found.heldout_rms("base")
    assert found.headline.startswith(named.sentence)


@pytest.mark.parametrize("name", ["mains_hum", "baseline_drift"])
def test_an_effect_by_chance_is_named(name, diagnosed):
    found = diagnosed(name)
    assert (found.verdict, ids(found)) == ("named", [name])
    assert found.effects[0].delta_nll > 15


def rest_value(effect, name):
    """What a parameter is where its part of the law is off."""
    parameter = next(p for p in effect.parameters if p.name == name)
    return 0.0 if name in effect.strengths else parameter.plain


def test_several_effects_are_named_together(diagnosed, values):
    found = diagnosed("feedthrough", "quadratic_damping")
    assert found.verdict == "named"
    assert set(ids(found)) == {"feedthrough", "quadratic_damping"}
    for named in found.effects:
        assert_estimates(named, values(named.effect.id, alone=False))


def test_an_effect_beside_a_hum_is_named_too(diagnosed):
    found = diagnosed("mains_hum", "quadratic_damping")
    assert found.verdict == "named"
    assert set(ids(found)) == {"mains_hum", "quadratic_damping"}


def test_a_hum_and_a_drift_have_no_law_so_that_they_are_two_does_not_count_against_them(diagnosed):
    found = diagnosed("mains_hum", "baseline_drift")
    assert found.verdict == "named"
    assert {"mains_hum", "baseline_drift"} == set(ids(found))
    assert found.probabilities[NONE_OF_THESE] < 0.1


@pytest.mark.parametrize("name", ["sensor_bandwidth", "amplifier_bandwidth"])
def test_what_cannot_be_told_apart_is_a_set_with_the_recording_that_would(name, diagnosed):
    found = diagnosed(name)
    assert found.verdict == "set"
    (group,) = found.candidates
    assert set(group) == {"sensor_bandwidth", "amplifier_bandwidth"}
    assert group[0] == ids(found)[0]
    following = found.next_experiment
    assert following.separation > 10
    assert "amplifier bandwidth" in following.sentence
    assert following.step_s > 0
    assert np.abs(following.drive_V).max() <= 100
    assert found.closure > 0.9


@pytest.mark.parametrize("name", ["sensor_bandwidth", "amplifier_bandwidth"])
def test_the_voltage_at_the_head_tells_the_amplifiers_apart(name, diagnosed):
    found = diagnosed(name, monitored=True)
    assert (found.verdict, ids(found), found.candidates) == ("named", [name], ())
    assert found.next_experiment is None
    assert all("monitor" not in recording.name for recording in found.recordings)


def test_a_probe_that_is_half_a_per_cent_off_is_no_mismatch(recorded, head, effects):
    plain = recorded(monitored=True, seed=7)
    off = [replace(r, drive_monitor_V=1.005 * r.drive_monitor_V + 0.3) for r in plain.recordings]
    looked_for = [effects[name] for name in LOOKED_FOR]
    found = diagnose(replace(plain, recordings=tuple(off)), head, looked_for, 0, workers=1)
    assert (found.verdict, ids(found)) == ("none", [])


def test_what_no_effect_explains_is_unknown_and_still_located(diagnosed):
    found = diagnosed("wave_echo", looked_for=("feedthrough", "quadratic_damping", "cubic_stiffness"))
    assert (found.verdict, ids(found), found.candidates) == ("unknown", [], ())
    assert found.location.recordings
    assert found.location.recordings[0] in found.headline
    assert found.remainder.share > 0.5
    assert found.remainder.gain > 100
    assert found.remainder.carrier == ()  # no effect is named, so the base model carries it
    assert found.as_json()["remainder"]["heldout_rms_V"] < 0.8 * found.heldout_rms("base")
    assert found.next_experiment is None


def test_an_effect_that_becomes_something_else_when_refitted_gives_way_to_the_next(monkeypatch):
    """On finer nodes a resonance of the drive may run into its bound: then it is a delay, not nothing at all."""
    work = _Work(None, (), FitContext(ProcessPool(1)))
    effects = [SimpleNamespace(id=name) for name in ("drive_resonance", "trigger_delay")]
    asked = []

    def selected(_, left):
        asked.append([effect.id for effect in left])
        return "signatures", SimpleNamespace(chosen=SimpleNamespace(ids=(left[0].id,)))

    def polished(_, chosen, __):
        turned = frozenset(chosen.ids) & {"drive_resonance"}
        return "finer", SimpleNamespace(ids=chosen.ids, degenerate=bool(turned), degenerated=turned)

    monkeypatch.setattr(work, "selected", selected)
    monkeypatch.setattr(work, "polished", polished)
    joint, chosen, selection, there = work.lasting("coarser", selected("", effects)[1], "old", effects, ())
    assert asked == [["drive_resonance", "trigger_delay"], ["trigger_delay"]]
    assert (joint, chosen.ids, selection.chosen.ids, there) == (
        "finer", ("trigger_delay",), ("trigger_delay",), "signatures"
    )  # fmt: skip
