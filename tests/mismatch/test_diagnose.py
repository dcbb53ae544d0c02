"""From a campaign to a verdict, on small campaigns of known truth."""

import importlib
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import Diagnosis, diagnose
from inkjet_env.mismatch.evidence import NOT_CONVERGED
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.plant import Effect, Parameter, Plant
from inkjet_env.recordings import Campaign
from inkjet_env.storage import json_text

LOOKED_FOR = ("cubic_stiffness", "quadratic_damping", "feedthrough", "sensor_bandwidth", "amplifier_bandwidth",
              "mains_hum", "baseline_drift")  # fmt: skip


class WindUp(Effect):
    """Not of the catalogue: the sensor hears the integral of its own signal."""

    id, stage = "wind_up", "sensing"
    sentence = "The sensor's integrator leaks into its output."
    equation, source, signature, shown_by = "y = y₀ + k ∫ y₀ dt", "a test", "a slope after each pulse", "any pulse"
    parameters = (Parameter("leak_per_s", "1/s", -1e6, 1e6),)
    strengths = ("leak_per_s",)

    def starts(self, printhead, excitations):
        return [{"leak_per_s": 0.05 * printhead.frequency_Hz}]

    def sensing(self, values, signal, drive_V, printhead, excitation):
        if excitation.channel != "self_sensing":
            return signal
        return signal + values["leak_per_s"] * excitation.step_s * np.cumsum(signal - signal.mean())


@pytest.fixture(scope="session")
def diagnosed(recorded, head, effects):
    """A function: the diagnosis of a planted campaign, begun at the true head; each made once."""
    made = {}

    def found(*names, looked_for=LOOKED_FOR, **options):
        key = (names, looked_for, tuple(options.items()))
        if key not in made:
            campaign = recorded(*names, **options)
            made[key] = diagnose(campaign, head, [effects[name] for name in looked_for], 0, workers=1)
        return made[key]

    return found


def ids(diagnosis):
    return [named.effect.id for named in diagnosis.effects]


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_found_where_nothing_is(seed, diagnosed):
    found = diagnosed(seed=seed)
    assert (found.verdict, ids(found), found.candidates) == ("none", [], ())
    assert found.next_experiment is None
    assert found.correction is None
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


@pytest.fixture
def never_converging(diagnosed, monkeypatch):
    """From here on, every fit that a diagnosis ends with says that it has not converged; and one from before."""
    usual = diagnosed("quadratic_damping")
    module = importlib.import_module("inkjet_env.mismatch.diagnose")
    polished = module._Work.polished

    def unfinished(self, *given):
        joint, chosen = polished(self, *given)
        joint.base = replace(joint.base, converged=False)
        return joint, replace(chosen, fit=replace(chosen.fit, converged=False))

    monkeypatch.setattr(module._Work, "polished", unfinished)
    return usual


def test_an_effect_whose_fit_did_not_converge_is_named_without_intervals_and_that_is_said(
    never_converging, recorded, head, effects
):
    campaign, looked_for = recorded("quadratic_damping"), [effects["feedthrough"], effects["quadratic_damping"]]
    found = diagnose(campaign, head, looked_for, 0, workers=1)
    assert (found.verdict, ids(found)) == ("named", ["quadratic_damping"])
    (named,) = found.effects
    (usual,) = never_converging.effects
    assert named.parameters.keys() == usual.parameters.keys()
    estimates = [*named.parameters.values(), *found.dynamics.values()]
    assert {e.high for e in estimates} == {math.inf}
    assert all(math.isfinite(e.value) and e.low <= 0 for e in estimates)
    assert named.sentence == f"{usual.sentence} {NOT_CONVERGED}"
    assert named.sentence in found.headline
    (note,) = found.notes
    assert note.startswith("The fit of quadratic damping did not converge")
    written = json.loads(json_text(found.as_json()))
    assert written["notes"] == [note]
    assert written["effects"][0]["sentence"] == named.sentence
    for number in written["effects"][0]["parameters"].values():
        assert (number["low"], number["high"]) == (None, None)


def test_a_base_model_whose_fit_did_not_converge_has_no_intervals_and_that_is_said(
    never_converging, recorded, head, effects
):
    found = diagnose(recorded("wave_echo"), head, [effects["feedthrough"]], 0, workers=1)
    assert found.verdict == "unknown"
    assert {e.high for e in found.dynamics.values()} == {math.inf}
    assert any(note.startswith("The fit of the base model did not converge") for note in found.notes)


def test_several_effects_are_named_together(diagnosed, values):
    found = diagnosed("feedthrough", "quadratic_damping")
    assert found.verdict == "named"
    assert set(ids(found)) == {"feedthrough", "quadratic_damping"}
    for named in found.effects:
        assert_estimates(named, values(named.effect.id))


def test_an_effect_beside_a_hum_is_named_too(diagnosed):
    found = diagnosed("mains_hum", "quadratic_damping")
    assert found.verdict == "named"
    assert set(ids(found)) == {"mains_hum", "quadratic_damping"}


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
    assert found.correction.share > 0.5
    assert found.correction.gain > 100
    assert found.next_experiment is None


def with_wind_up(campaign, true_head, leak_per_s):
    """The campaign with the sensor's leak in it."""
    head, recordings = true_head(campaign), []
    for o, recording in zip(observe(campaign), campaign.recordings, strict=True):
        plain = Plant(head.printhead, head.gains, head.offsets)
        leaking = plain.with_effects([(WindUp(), {"leak_per_s": leak_per_s})])
        recordings.append(
            replace(recording, sensor=recording.sensor + leaking.signal(o.excitation) - plain.signal(o.excitation))
        )
    return Campaign("leaking", tuple(recordings))


def test_an_effect_of_ones_own_takes_part_and_is_named(recorded, true_head, head, effects):
    campaign = with_wind_up(recorded(), true_head, 2e3)
    catalogued = [effects[name] for name in ("feedthrough", "quadratic_damping")]
    found = diagnose(campaign, head, [*catalogued, WindUp()], workers=1)
    assert (found.verdict, ids(found)) == ("named", ["wind_up"])
    estimate = found.effects[0].parameters["leak_per_s"]
    assert estimate.low < 2e3 < estimate.high
    assert estimate.high - estimate.low < 0.12 * 2e3
    assert found.as_json()["effects"][0]["parameters"]["leak_per_s"]["unit"] == "1/s"
    assert WindUp.sentence in found.headline
    without = diagnose(campaign, head, catalogued, workers=1)
    assert without.verdict == "unknown"


def test_without_a_printhead_it_is_identified(recorded, head, effects):
    looked_for = [effects[name] for name in LOOKED_FOR]
    found = diagnose(recorded("feedthrough"), None, looked_for, workers=1)
    assert (found.verdict, ids(found)) == ("named", ["feedthrough"])
    assert found.printhead.frequency_Hz == pytest.approx(head.frequency_Hz, rel=1e-3)
    assert found.base_printhead.frequency_Hz == pytest.approx(head.frequency_Hz, rel=1e-3)


def test_a_given_printhead_is_where_the_fit_begins_and_not_where_it_ends(recorded, head, effects):
    looked_for = [effects["feedthrough"]]
    off = head.varied(head.frequency_Hz * 1.01, head.damping_ratio * 1.1)
    found = diagnose(recorded(), off, looked_for, workers=1)
    assert found.verdict == "none"
    assert found.printhead.frequency_Hz == pytest.approx(head.frequency_Hz, rel=1e-3)


def shape_of(value):
    """The types of a JSON value, lists by their first entry."""
    if isinstance(value, dict):
        return {key: shape_of(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [shape_of(value[0])] if value else []
    return type(value)


NUMBER = {"value": float, "low": float, "high": float, "unit": str}
"""As the contract has it."""


@pytest.mark.parametrize("verdict", ["none", "named", "set", "unknown"])
def test_the_verdict_in_json_has_what_was_agreed(verdict, diagnosed):
    found = {
        "none": lambda: diagnosed(seed=0),
        "named": lambda: diagnosed("quadratic_damping"),
        "set": lambda: diagnosed("sensor_bandwidth"),
        "unknown": lambda: diagnosed("wave_echo", looked_for=("feedthrough", "quadratic_damping", "cubic_stiffness")),
    }[verdict]()
    written = json.loads(json_text(found.as_json("next.csv")))
    assert (written["format"], written["verdict"]) == ("diagnosis/1", verdict)
    agreed = {"format", "verdict", "effects", "candidates", "location", "fit", "next_experiment", "seconds"}
    assert agreed <= written.keys()
    for effect in written["effects"]:
        assert effect.keys() == {"id", "stage", "sentence", "evidence", "parameters"}
        assert shape_of(effect["evidence"]) == {"delta_nll": float, "p_value": float}
        for number in effect["parameters"].values():
            assert shape_of(number) == NUMBER
            assert number["low"] <= number["value"] <= number["high"]
    assert (len(written["effects"]) > 0) == (verdict in ("named", "set"))
    assert all(len(group) > 1 and set(map(type, group)) == {str} for group in written["candidates"])
    assert (len(written["candidates"]) > 0) == (verdict == "set")
    location = written["location"]
    assert location.keys() == {"recordings", "time_s", "frequency_Hz", "drive_V", "sentence"}
    assert all(type(name) is str for name in location["recordings"])
    assert (len(location["recordings"]) > 0) == (verdict != "none")
    for label in ("time_s", "frequency_Hz", "drive_V"):
        assert all(low <= high for low, high in location[label])
    fit = written["fit"]
    figures = {"noise_rms_V", "base_heldout_rms_V", "augmented_heldout_rms_V"}
    assert {*figures, "closure", "heldout"} <= fit.keys()
    assert all(fit[name] > 0 for name in figures)
    assert (fit["closure"] is None) == (verdict == "none")
    names = {recording.name for recording in found.recordings}
    assert fit["heldout"]
    assert set(fit["heldout"]) < names
    following = written["next_experiment"]
    assert following is None or following == {"sentence": following["sentence"], "drive_csv": "next.csv"}
    assert (following is None) == (verdict != "set")
    assert written["seconds"] > 0


def without_clock(diagnosis):
    written = diagnosis.as_json()
    del written["seconds"]
    return json_text(written)


def test_the_same_numbers_drawn_give_the_same_diagnosis_on_any_number_of_workers(recorded, head, effects):
    campaign, looked_for = recorded("feedthrough"), [effects[name] for name in LOOKED_FOR]
    told = [
        without_clock(diagnose(campaign, head, looked_for, rng, workers=workers))
        for rng, workers in ((5, 1), (np.random.default_rng(5), 1), (5, 2))
    ]
    assert told[0] == told[1] == told[2]


def only(campaign, chosen):
    recordings = [r for r in campaign.recordings if chosen(r)]
    names = {r.name for r in recordings}
    return Campaign(
        "cut", tuple(replace(r, repeat_of=r.repeat_of if r.repeat_of in names else None) for r in recordings)
    )


@pytest.mark.parametrize("name", [(), ("quadratic_damping",)])
def test_without_a_strain_gauge_it_works(name, recorded, head, effects):
    campaign = only(recorded(*name), lambda r: r.channel == "self_sensing")
    found = diagnose(campaign, head, [effects["quadratic_damping"], effects["feedthrough"]], workers=1)
    assert ids(found) == list(name)


def test_without_repeats_and_without_rest_it_works_and_says_what_it_took_for_noise(recorded, head, effects):
    campaign = recorded("quadratic_damping")
    campaign = only(campaign, lambda r: r.repeat_of is None and np.ptp(r.drive_V) > 0)
    found = diagnose(campaign, head, [effects["quadratic_damping"], effects["feedthrough"]], workers=1)
    assert (found.verdict, ids(found)) == ("named", ["quadratic_damping"])
    assert any("the noise is unknown without repeats or recordings at rest" in note for note in found.notes)


def test_one_recording_is_enough_and_nothing_held_out_is_no_figure(recorded, head, effects):
    campaign = only(recorded(), lambda r: r.excitation == "bipolar")
    one = Campaign("one", campaign.recordings[:1])
    found = diagnose(one, head, [effects["quadratic_damping"], effects["feedthrough"]], workers=1)
    assert isinstance(found, Diagnosis)
    assert found.verdict == "none"
    assert found.as_json()["fit"]["heldout"] == []
    assert found.as_json()["fit"]["base_heldout_rms_V"] is None
    json_text(found.as_json())


def test_recordings_at_rest_alone_are_refused_in_one_sentence(recorded):
    campaign = only(recorded(), lambda r: r.excitation == "zero")
    with pytest.raises(ValueError, match="has no recording to identify a0, a1 and b1 from"):
        diagnose(campaign, workers=1)


def test_no_effects_to_look_for_leaves_none_or_unknown(recorded, head):
    assert diagnose(recorded(), head, [], workers=1).verdict == "none"
    found = diagnose(recorded("quadratic_damping"), head, [], workers=1)
    assert (found.verdict, found.attributions) == ("unknown", ())


def test_what_the_recordings_cannot_show_is_said_with_why(diagnosed, effects, recorded, head):
    found = diagnose(recorded(), head, [effects["crosstalk"], effects["feedthrough"]], workers=1)
    assert found.untestable.keys() == {"crosstalk"}
    assert "neighbour" in found.untestable["crosstalk"]


def test_what_is_being_done_is_told(recorded, head, effects):
    told = []
    diagnose(recorded("feedthrough"), head, [effects["feedthrough"]], workers=1, progress=told.append)
    assert "fitting the base model" in told
    assert "score test of feedthrough (1 of 2)" in told
    assert told[-1] == "designing the next experiment"


def test_no_physics_is_blamed_while_what_had_gone_before_is_in_doubt(recorded, effects):
    campaign = recorded()
    doubtful = replace(
        campaign,
        recordings=tuple(
            replace(r, initial_state="free") if (r.channel, r.initial_state) == ("self_sensing", "periodic") else r
            for r in campaign.recordings
        ),
    )
    found = diagnose(doubtful, effects=[effects["thermal_drift"]], workers=1)
    assert (found.verdict, found.effects) == ("unknown", ())
    assert "set the initial state to periodic" in found.headline
