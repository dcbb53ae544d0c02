"""The recording that tells apart what a campaign leaves alike."""

import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.design.drive_library import Train, benches, library, probe_library
from inkjet_env.mismatch.design.next_experiment import _no_longer_than_needed, _times, next_experiments
from inkjet_env.mismatch.design.predictions import Judged
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, observe
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.localization.views import largest_V
from inkjet_env.plant import Effect, Excitation, Parameter, Plant, catalogue
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign
from inkjet_env.rig.battery import default_battery, self_sensing_battery
from inkjet_env.rig.record import record_campaign

SETTINGS = DiagnosisSettings()

HEAD = Printhead.published()
LINEAR = Printhead(HEAD.a0, HEAD.a1, HEAD.b1, (1.0, 0.0), HEAD.full_scale_V)
EFFECTS = {effect.id: effect for effect in catalogue()}


class Gain(Effect):
    """Made for these tests: so much more of everything."""

    equation = source = signature = ""
    parameters = (Parameter("strength", "1", -0.5, 0.5),)
    strengths = ("strength",)
    shown_by = "a second voltmeter"


class WeakAmplifier(Gain):
    id, stage, sentence = "weak_amplifier", "drive", "The amplifier gives less than it is asked for."

    def drive(self, values, drive_V, excitation):
        return drive_V * (1 + values["strength"])


class WeakSensor(Gain):
    id, stage, sentence = "weak_sensor", "sensing", "The sensor shows less than there is."

    def sensing(self, values, signal, drive_V, printhead, excitation):
        return signal * (1 + values["strength"])


def joint_of(printhead, labels, effects=()):
    """A joint fit of a short campaign of self-sensing, and its noise; effects planted by the plant."""
    battery = [line for line in self_sensing_battery(HEAD.frequency_Hz) if line.label in labels]
    campaign = record_campaign(printhead, 1, battery=battery, snr_dB=50.0)
    plain, planted = plants(printhead, effects)
    recordings = []
    for o, r in zip(observe(campaign), campaign.recordings, strict=True):
        recordings.append(replace(r, sensor=r.sensor + planted.signal(o.excitation) - plain.signal(o.excitation)))
    observed = tuple(replace(o, fitted=o.excitation.samples) for o in observe(Campaign("test", tuple(recordings))))
    head = Head(printhead, {"self_sensing": printhead.b1}, {"self_sensing": 0.0})
    noise = noise_seen(
        observed, {o.name: o.measured - planted.signal(o.excitation) for o in observed}, {}, SETTINGS.fitting
    )
    return OutputErrorFit(observed, noise, head, SETTINGS)


def plants(printhead, effects):
    return Plant(printhead), Plant(printhead, effects=tuple(effects))


def candidate(joint, effect, values):
    """An effect with these values beside the base model, not fitted."""
    low, high = (np.array(ends) for ends in zip(*(p.bounds for p in effect.parameters), strict=True))
    at = replace(joint.base.end, active=ActiveEffects.of([(effect, values)]))
    return replace(joint.base, end=at, jacobian=joint.jacobian(at, low, high), converged=True, jacobian_at=at)


@pytest.fixture(scope="module")
def one_amplitude():
    """Damping that grows with speed, seen under one gentle pulse alone; fits of two explanations of it."""
    damping = EFFECTS["quadratic_damping"]
    excitations = [
        Excitation(b.channel, b.initial_state, b.step_s, b.drive_V) for b in self_sensing_battery(HEAD.frequency_Hz)
    ]
    values = {name: 0.2 * value for name, value in damping.starts(HEAD, excitations)[0].items()}
    joint = joint_of(HEAD, ("trapezoid-gentle", "zero"), [(damping, values)])
    fits = []
    for name in ("quadratic_damping", "ferroelastic_softening"):
        effect = EFFECTS[name]
        starts = effect.starts(HEAD, [o.excitation for o in joint.observed])
        fits.append(min((joint.fit(ActiveEffects.of([(effect, s)])) for s in starts), key=lambda fit: fit.nll))
    return joint, fits, (damping, values)


def test_the_separation_is_what_the_best_refit_of_the_rival_leaves():
    joint = joint_of(HEAD, ("trapezoid-60V", "trapezoid-100V", "zero"))
    excitations = [o.excitation for o in joint.observed]
    fits = []
    for name in ("second_mode", "wave_echo"):
        start = EFFECTS[name].starts(HEAD, excitations)[0]
        fits.append(candidate(joint, EFFECTS[name], start))
    (found, *_) = next_experiments(fits, joint.noise, joint.observed, catalogue(), SETTINGS.design)
    excitation = Excitation(found.channel, found.initial_state, found.step_s, np.array(found.drive_V), order=6)
    o = ObservedRecording("next", found.channel, "V", -1, excitation, np.zeros(excitation.samples), excitation.samples)
    signals = [fit.head.plant(fit.active.pairs).signal(excitation) for fit in fits]
    residuals = []
    for fit in fits:
        # the rival sees the campaign again, where it fits, and the new recording, where it does not
        new = np.column_stack([fit.head.sensitivities(o), new_slopes(fit, excitation)])
        again = np.column_stack(
            [joint.stacked({s.name: joint.start.sensitivities(s) for s in joint.seen}), fit.jacobian]
        )
        columns = np.concatenate([again, joint.noise.whitened(o, new)])
        target = np.concatenate([np.zeros(len(again)), joint.noise.whitened(o, signals[0] - signals[1])])
        size = np.linalg.norm(columns, axis=0)
        size[size == 0] = 1.0
        step = np.linalg.lstsq(columns / size, target, rcond=None)[0]
        residuals.append(0.5 * np.sum((target - columns / size @ step) ** 2))
    assert found.separation == pytest.approx(min(residuals), rel=1e-2)


def new_slopes(fit, excitation):
    """Central differences of the signal with respect to a candidate's coordinates."""
    (effect,) = fit.active.effects
    columns = []
    for k, parameter in enumerate(effect.parameters):
        step = 1e-4 * (1.0 if parameter.scale == "log" else abs(fit.active.theta[k]) or 1e-2)
        ends = []
        for sign in (1, -1):
            theta = fit.active.theta.copy()
            theta[k] += sign * step
            values = {p.name: p.value(z) for p, z in zip(effect.parameters, theta, strict=True)}
            ends.append(fit.head.plant([(effect, values)]).signal(excitation))
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.column_stack(columns)


def test_what_a_campaign_leaves_alike_is_told_apart_by_the_recording_that_was_asked_for(one_amplitude):
    joint, fits, planted = one_amplitude
    before = fits[1].nll - fits[0].nll
    (found, *_) = next_experiments(fits, joint.noise, joint.observed, catalogue(), SETTINGS.design)
    assert abs(before) < 3
    assert found.separation > 20
    excitation = Excitation(found.channel, found.initial_state, found.step_s, np.array(found.drive_V), order=9)
    signal = Plant(HEAD, effects=(planted,)).signal(excitation)
    noise = joint.noise.models[joint.observed[0].noise_key].rms * np.random.default_rng(1).standard_normal(signal.size)
    more = (*joint.observed, ObservedRecording("next", found.channel, "V", 99, excitation, signal + noise, signal.size))
    again = OutputErrorFit(more, joint.noise, joint.start, SETTINGS)
    after = [again.fit(fit.active, fit.head) for fit in fits]
    gained = after[1].nll - after[0].nll
    assert gained > max(10, 0.3 * found.separation)
    assert after[0].nll < 0.55 * sum(o.fitted for o in more)  # the true one explains the new recording, too


def test_amplifier_and_sensor_of_a_linear_head_are_told_apart_at_the_head_alone():
    joint = joint_of(LINEAR, ("trapezoid-60V", "trapezoid-100V", "zero"))
    fits = [candidate(joint, effect, {"strength": -0.1}) for effect in (WeakAmplifier(), WeakSensor())]
    (found, *_) = next_experiments(fits, joint.noise, joint.observed, catalogue(), SETTINGS.design)
    assert found.sentence.startswith("Record the voltage at the head as well (column drive_monitor_V)")
    assert "the predictions for weak amplifier and weak sensor differ there by up to 10 V" in found.sentence
    assert max(map(abs, found.drive_V)) == pytest.approx(100)
    asked = found.as_json("next.csv")
    assert asked["drive_monitor"] is True
    assert (asked["channel"], asked["step_s"], asked["repeats"]) == (
        found.channel,
        found.step_s,
        2,
    )  # noise at that step is new


def test_the_sentence_tells_drive_channel_difference_and_noise(one_amplitude):
    joint, fits, _ = one_amplitude
    sentence = next_experiments(fits, joint.noise, joint.observed, catalogue(), SETTINGS.design)[0].sentence
    assert sentence.startswith("Record the self-sensing signal under ")
    assert "the predictions for quadratic damping and ferroelastic softening differ by up to" in sentence
    assert "times the noise" in sentence


def test_no_drive_goes_beyond_what_the_campaign_dared(one_amplitude):
    joint, fits, _ = one_amplitude
    assert {float(o.excitation.drive_V.min()) for o in joint.observed} == {0.0}  # 0 … 80 V alone
    (bench,) = benches(joint.observed, HEAD.frequency_Hz, SETTINGS.design)
    drives = [p.excitation.drive_V for p in library(bench)]
    drives.append(
        np.array(next_experiments(fits, joint.noise, joint.observed, catalogue(), SETTINGS.design)[0].drive_V)
    )
    for drive in drives:
        assert 0 <= drive.min() <= drive.max() <= 80
    assert max(drive.max() for drive in drives) == 80


def test_every_channel_of_a_campaign_has_drives_of_its_own():
    campaign = record_campaign(HEAD, 1, battery=default_battery(HEAD.frequency_Hz), snr_dB=50.0)
    observed = observe(campaign)
    for bench in benches(observed, HEAD.frequency_Hz, SETTINGS.design):
        proposals = library(bench)
        assert {p.excitation.channel for p in proposals} == {bench.channel}
        assert len({p.words for p in proposals}) == len(proposals)
        most = max(largest_V(o) for o in observed)
        assert max(np.abs(p.excitation.drive_V).max() for p in proposals) <= most
        assert any(not p.excitation.drive_V.any() for p in proposals)
        assert {o.noise_key for o in observed if o.channel == bench.channel} >= {
            ObservedRecording("", bench.channel, "V", 0, p.excitation, p.excitation.drive_V, 0).noise_key
            for p in proposals
        }


@pytest.mark.parametrize("frequency_Hz", [20e3, 52e3, 300e3])
def test_pulses_for_a_probe_are_sampled_within_an_edge_or_within_its_corners(one_amplitude, frequency_Hz):
    (bench,) = benches(one_amplitude[0].observed, frequency_Hz, SETTINGS.design)
    found = probe_library(replace(bench, low_V=-bench.high_V))
    assert len({(p.words, p.excitation.step_s) for p in found}) == len(found)
    design = SETTINGS.design
    steps_s = {one / frequency_Hz for one in (design.probe_window / design.probe_samples, design.finest_probe_step)}
    assert sorted({p.excitation.step_s for p in found}) == pytest.approx(sorted(steps_s), rel=0.05)
    assert min(p.train.edge_s / p.excitation.step_s for p in found) > 28
    for proposal in found:
        excitation = proposal.excitation
        assert excitation.samples <= SETTINGS.design.most_samples
        assert excitation.drive_V[0] == excitation.drive_V[-1] == 0
        rings_s = excitation.samples * excitation.step_s - proposal.train.corners[0][-1]
        assert rings_s > 0.95 / frequency_Hz


def test_a_train_has_the_corners_that_its_words_tell():
    train = Train((80.0, 40.0), 2e-6, 10e-6, 30e-6)
    time_s, drive_V = train.corners
    assert np.allclose(time_s, np.array([0, 2, 12, 14, 44, 46, 56, 58, 88]) * 1e-6)
    assert drive_V == [0, 80, 80, 0, 0, 40, 40, 0, 0]
    assert train.words == "pulses of 80 V and 40 V with 30 µs between them (edges 2 µs, dwell 10 µs)"
    assert Train((80.0, -40.0), 2e-6, 10e-6).corners[1] == [0, 80, 80, -40, -40, 0, 0]
    assert Train((87.9, -87.9), 2.04e-6, 1e-5).rounded == Train((87.0, -87.0), 2e-6, 1e-5)


def test_of_one_candidate_what_shows_it_is_told_and_of_none_what_was_not_seen(one_amplitude):
    joint, fits, _ = one_amplitude
    assert (
        fits[0].active.effects[0].shown_by
        in next_experiments(fits[:1], joint.noise, joint.observed, catalogue(), SETTINGS.design)[0].sentence
    )
    (unseen,) = next_experiments([], joint.noise, joint.observed, catalogue(), SETTINGS.design)
    assert EFFECTS["crosstalk"].shown_by in unseen.sentence
    assert unseen.drive_V == ()
    assert math.isclose(unseen.separation, 0)


def test_no_more_recordings_are_asked_for_than_one_takes_in_one_go(one_amplitude):
    """The more is wanted, the more repeats; and where forty would not do, words."""
    joint, fits, _ = one_amplitude
    once = next_experiments(fits, joint.noise, joint.observed, catalogue(), SETTINGS.design)[0].separation
    asked = []
    for times in (0.5, 5.0, 25.0, 1000.0):
        settings = replace(SETTINGS.design, separation=times * once)
        found = next_experiments(fits, joint.noise, joint.observed, catalogue(), settings)
        asked.append(sum(one.repeats for one in found) if found[0].drive_V else None)
    assert asked[0] == 1 < asked[1] < asked[2] <= settings.most_recordings
    assert asked[3] is None


def test_pairs_that_cannot_be_separated_do_not_keep_the_others_from_it():
    """Of three candidates the second and the third stay alike, whatever is recorded."""
    settings = replace(SETTINGS.design, separation=20.0, most_recordings=40)

    def separating(*pairs):  # of 1 and 2, 1 and 3, 2 and 3
        return Judged(None, np.array(pairs), np.zeros(3), (0.0, 0.0, 0.0))

    good, fair, poor = separating(10.0, 5.0, 0.1), separating(1.0, 1.0, 0.1), separating(0.1, 0.1, 0.4)
    assert _times([good], settings) == 4
    assert _times([good, poor], settings) == 4  # 20 times, 2 and 3 would still be short of it
    assert _times([poor], settings) == 0
    assert _no_longer_than_needed([good, fair, poor], settings) == [good]
    assert _no_longer_than_needed([fair, good, poor], settings) == [fair, good]  # 8 recordings, not 20
    assert _no_longer_than_needed([poor, poor], settings) == []
    assert _no_longer_than_needed([], settings) == []
