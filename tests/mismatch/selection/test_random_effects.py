"""Hum and drift told from noise, by the likelihood of what recordings leave."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.selection.amplitude_likelihood import without_amplitudes
from inkjet_env.mismatch.selection.random_effects import _mean_ratio, detect_random_effects
from inkjet_env.plant import Excitation
from inkjet_env.printhead import Printhead
from inkjet_env.rig import StrainGauge

SETTINGS = DiagnosisSettings()

HEAD = Printhead.published()
STEP_S = 2e-7
GAUGE_STEP_S = 0.01
RMS = 0.02
PULSE_V = np.interp(np.arange(600.0), [0, 10, 25, 60, 75], [0, 0, 80, 80, 0])


def recordings(channel="self_sensing", resting=2, moving=6, step_s=STEP_S, samples=600):
    """Recordings of one channel; what is left of them is made by each test."""
    made = []
    for k in range(resting + moving):
        drive_V = np.zeros(samples) if k < resting else PULSE_V[:samples] * (0.3 + 0.1 * k)
        excitation = Excitation(channel, "periodic", step_s, drive_V, k + 1)
        condition = 0 if k < resting else k
        made.append(
            ObservedRecording(f"{channel}-{k}", channel, "V", condition, excitation, np.zeros(samples), samples)
        )
    return made


def white(observed, rng, rms=RMS):
    return {o.name: rms * rng.standard_normal(o.excitation.samples) for o in observed}


def tone(observed, rng, frequency_Hz, amplitude):
    """A hum of one loudness, its phase another in every recording."""
    result = {}
    for o in observed:
        angle = 2 * np.pi * (frequency_Hz * o.excitation.step_s * np.arange(o.excitation.samples) + rng.random())
        result[o.name] = amplitude * np.cos(angle)
    return result


def drift(observed, rng, size):
    result = {}
    for o in observed:
        at = np.linspace(-1, 1, o.excitation.samples)
        result[o.name] = np.polynomial.polynomial.polyval(at, size * rng.standard_normal(3))
    return result


def together(*parts):
    return {name: sum(part[name] for part in parts) for name in parts[0]}


@pytest.fixture
def look(effects):
    """A function: what is found in what is left of some recordings."""

    def found(observed, residuals, names=("mains_hum", "baseline_drift")):
        return detect_random_effects(
            observed,
            residuals,
            noise_seen(observed, residuals, {}, SETTINGS.fitting),
            [effects[name] for name in names],
            HEAD,
            SETTINGS,
        )

    return found


def test_white_noise_is_neither_hum_nor_drift(look):
    rng = np.random.default_rng(21)
    observed = recordings()
    assert [look(observed, white(observed, rng)) for _ in range(8)] == [[]] * 8


def test_the_strain_gauges_own_noise_is_neither_hum_nor_drift(look):
    """White and 1/f, as the virtual rig has it."""
    rng = np.random.default_rng(22)
    observed = recordings("strain_gauge", 2, 4, GAUGE_STEP_S)
    noise = StrainGauge().noise
    for _ in range(6):
        residuals = {o.name: noise.draw(rng, o.excitation.samples, 1 / o.excitation.step_s) for o in observed}
        assert look(observed, residuals) == []


def test_noise_of_a_steep_spectrum_is_neither_hum_nor_drift(look):
    """Neighbouring samples alike: an amplifier's bandwidth."""
    rng = np.random.default_rng(23)
    observed = recordings()
    for _ in range(5):
        residuals = white(observed, rng)
        for name, signal in residuals.items():
            for k in range(1, signal.size):
                signal[k] += 0.9 * signal[k - 1]
            residuals[name] = signal
        assert look(observed, residuals) == []


def test_an_offset_that_all_recordings_share_is_no_drift(look):
    observed = recordings()
    residuals = white(observed, np.random.default_rng(24))
    assert look(observed, {name: signal + 5.0 for name, signal in residuals.items()}) == []


@pytest.mark.parametrize("frequency_Hz", [43_210.0, 300_000.0])
def test_a_hum_is_found_at_its_frequency_and_loudness(frequency_Hz, look):
    rng = np.random.default_rng(25)
    observed = recordings()
    best = look(observed, together(white(observed, rng), tone(observed, rng, frequency_Hz, RMS)))[0]
    assert best.effect.id == "mains_hum"
    assert best.channel == "self_sensing"
    resolution_Hz = 1 / (600 * STEP_S)
    assert best.values["frequency_Hz"] == pytest.approx(frequency_Hz, abs=0.1 * resolution_Hz)
    assert best.values["amplitude"] == pytest.approx(RMS, rel=0.2)
    assert best.gain > 30 - np.log(2)  # the mean over two forms costs so much at most


def test_a_tone_faster_than_a_printhead_file_can_hold_is_not_named(look, effects):
    """A recording of an edge has samples every few nanoseconds."""
    rng = np.random.default_rng(26)
    observed = recordings(step_s=3e-9)
    fastest_Hz = effects["mains_hum"].parameters[0].high
    for frequency_Hz, named in ((0.9 * fastest_Hz, True), (1.5 * fastest_Hz, False)):
        found = look(observed, together(white(observed, rng), tone(observed, rng, frequency_Hz, 2 * RMS)))
        frequencies_Hz = [one.values["frequency_Hz"] for one in found if one.effect.id == "mains_hum"]
        assert frequencies_Hz == [pytest.approx(frequency_Hz, rel=1e-3)] * named


def test_a_tone_and_one_of_its_multiples_need_not_choose_a_form_from_half_of_the_recordings(look):
    """Half of them may take five multiples for the likelier form, which predicts the others worse than noise does."""
    rng = np.random.default_rng(31)
    observed = recordings(resting=2, moving=12)
    hum = together(tone(observed, rng, 43_210.0, 0.7 * RMS), tone(observed, rng, 3 * 43_210.0, 0.2 * RMS))
    best = look(observed, together(white(observed, rng), hum))[0]
    assert best.effect.id == "mains_hum"
    assert best.values["frequency_Hz"] == pytest.approx(43_210.0, abs=0.1 / (600 * STEP_S))


def test_the_mean_of_likelihood_ratios_is_never_more_than_the_largest():
    assert _mean_ratio([2.0, 2.0]) == pytest.approx(2.0)
    assert _mean_ratio([40.0, -30.0]) == pytest.approx(40.0 - np.log(2))
    assert _mean_ratio([-np.inf, -np.inf]) == -np.inf
    assert _mean_ratio([-np.inf, 5.0]) == pytest.approx(5.0 - np.log(2))


def test_a_drift_is_found_with_its_size(look):
    rng = np.random.default_rng(26)
    observed = recordings()
    drifted = drift(observed, rng, RMS)
    best = look(observed, together(white(observed, rng), drifted))[0]
    assert best.effect.id == "baseline_drift"
    level = np.mean(np.concatenate(list(drifted.values())))
    size = np.sqrt(np.mean([np.abs(signal - level).max() ** 2 for signal in drifted.values()]))
    assert best.values["amplitude"] == pytest.approx(size, rel=0.25)


def test_a_random_walk_is_found_where_no_polynomial_tells_it(look, effects):
    """Of half the noise's size; with polynomials alone it passes for noise with a long memory."""
    rng = np.random.default_rng(36)
    observed = recordings(resting=3, moving=12)
    walks = {o.name: np.cumsum(rng.standard_normal(o.excitation.samples)) for o in observed}
    size = np.sqrt(np.mean([np.mean(walk**2) for walk in walks.values()]))
    residuals = together(white(observed, rng), {name: 0.4 * RMS / size * walk for name, walk in walks.items()})
    best = look(observed, residuals)[0]
    assert best.effect.id == "baseline_drift"
    assert best.values["walk"] == 1

    class Smooth(type(effects["baseline_drift"])):
        def starts(self, printhead, excitations):
            return [start for start in super().starts(printhead, excitations) if not start["walk"]]

    noise = noise_seen(observed, residuals, {}, SETTINGS.fitting)
    found = detect_random_effects(observed, residuals, noise, [Smooth()], HEAD, SETTINGS)
    assert not found or found[0].gain < best.gain - 5


def test_the_less_there_is_the_less_is_gained_until_nothing_is_found(look):
    gains = []
    for share in (1.0, 0.5, 0.05):
        rng = np.random.default_rng(27)
        observed = recordings()
        found = look(observed, together(white(observed, rng), tone(observed, rng, 9e4, share * RMS)), ("mains_hum",))
        gains.append(found[0].gain if found else 0.0)
    assert gains[0] > gains[1] > gains[2] == 0.0


def test_a_drift_beside_a_coarse_converter_is_found(look):
    """Means of several samples have less noise than the converter's step leaves one sample."""
    rng, step = np.random.default_rng(28), 2 * RMS
    measured = step * np.round(40 * np.sin(np.arange(2400) / 50) / step)  # tells the step
    observed = [
        replace(o, excitation=replace(o.excitation, drive_V=np.tile(o.excitation.drive_V, 4)), measured=measured)
        for o in (replace(o, fitted=2400) for o in recordings(resting=2, moving=8))
    ]
    noisy = together(white(observed, rng), drift(observed, rng, RMS))
    found = look(observed, {name: step * np.round(signal / step) for name, signal in noisy.items()})
    assert [one.effect.id for one in found] == ["baseline_drift"]


@pytest.mark.parametrize("where", ["self_sensing", "strain_gauge"])
def test_only_the_channel_that_has_it_is_named(where, look):
    rng = np.random.default_rng(28)
    observed = recordings() + recordings("strain_gauge", 2, 4, GAUGE_STEP_S)
    residuals = white(observed, rng)
    mine = [o for o in observed if o.channel == where]
    residuals |= together({o.name: residuals[o.name] for o in mine}, drift(mine, rng, 2 * RMS))
    found = look(observed, residuals)
    assert {f.channel for f in found} == {where}
    assert found[0].effect.id == "baseline_drift"


def test_a_hum_on_every_channel_has_the_frequency_that_the_longest_recordings_tell(look, effects):
    """Fast ones last a thousandth of its period and show a slope; by themselves they would tell any low frequency."""
    rng = np.random.default_rng(35)
    observed = recordings() + recordings("strain_gauge", 2, 4, GAUGE_STEP_S)
    residuals = together(white(observed, rng), tone(observed, rng, 7.3, 20 * RMS))
    best = look(observed, residuals, ("mains_hum",))[0]
    assert best.channel == "strain_gauge"
    assert best.values["frequency_Hz"] == pytest.approx(7.3, abs=0.01)
    clean = without_amplitudes(best.effect, best.values, observed, residuals)
    assert np.std(np.concatenate(list(clean.values()))) == pytest.approx(RMS, rel=0.05)


def test_what_recordings_at_rest_do_not_show_is_no_hum(look):
    """It may be anything that needs a drive."""
    rng = np.random.default_rng(29)
    observed = recordings()
    noise, hum = white(observed, rng), tone(observed, rng, 9e4, RMS)
    driven = {o.name: noise[o.name] + (0 if o.still else hum[o.name]) for o in observed}
    assert look(observed, driven, ("mains_hum",)) == []
    moving = [o for o in observed if not o.still]
    assert look(moving, {o.name: driven[o.name] for o in moving}, ("mains_hum",))  # nothing at rest says otherwise


def test_both_at_once_are_found_one_after_another(look, effects):
    rng = np.random.default_rng(30)
    observed = recordings()
    residuals = together(white(observed, rng), tone(observed, rng, 2e5, RMS), drift(observed, rng, 3 * RMS))
    best = look(observed, residuals)[0]
    rest = without_amplitudes(best.effect, best.values, observed, residuals)
    after = look(observed, rest)[0]
    assert {best.effect.id, after.effect.id} == {"mains_hum", "baseline_drift"}
    clean = without_amplitudes(after.effect, after.values, observed, rest)
    assert np.std(np.concatenate(list(clean.values()))) == pytest.approx(RMS, rel=0.05)
    assert look(observed, clean) == []


def test_a_converter_whose_steps_hide_the_noise_neither_hums_nor_drifts(look, effects):
    """At rest every sample is the same; what is below the step, which the moving recordings tell, is nothing."""
    observed = [replace(o, measured=np.round(20 * np.sin(o.excitation.drive_V / 30)) / 20) for o in recordings()]
    rng = np.random.default_rng(34)
    residuals = {o.name: np.zeros(600) if o.still else 0.05 * (rng.random(600) - 0.5) for o in observed}
    noise = noise_seen(observed, residuals, {}, SETTINGS.fitting)
    resting = [o for o in observed if o.still]
    looked_for = [effects[name] for name in ("mains_hum", "baseline_drift")]
    rounding = {o.name: np.full(600, 1e-18 * (-1) ** k) for k, o in enumerate(observed)}
    assert detect_random_effects(resting, rounding, noise, looked_for, HEAD, SETTINGS) == []


@pytest.mark.parametrize(("steps", "heard"), [(0.02, True), (3.0, False)])
def test_a_hum_of_less_than_a_step_is_heard_only_where_noise_makes_rounding_random(steps, heard, effects):
    """Steps of the noise's RMS: the same hum, half the noise."""
    rng = np.random.default_rng(35)
    observed = recordings()
    noisy = together(white(observed, rng), tone(observed, rng, 9e4, 0.5 * RMS))
    step = steps * RMS
    measured = {
        o.name: step * np.round((noisy[o.name] + 20 * np.sin(o.excitation.drive_V / 30)) / step) for o in observed
    }
    observed = [replace(o, measured=measured[o.name]) for o in observed]
    residuals = {o.name: o.measured - 20 * np.sin(o.excitation.drive_V / 30) for o in observed}
    noise = noise_seen(observed, residuals, {}, SETTINGS.fitting)
    assert bool(detect_random_effects(observed, residuals, noise, [effects["mains_hum"]], HEAD, SETTINGS)) == heard


def test_a_drive_monitor_hums_to_nobody(look):
    rng = np.random.default_rng(32)
    observed = recordings("drive_monitor")
    assert look(observed, together(white(observed, rng), tone(observed, rng, 9e4, 5 * RMS))) == []


def test_intervals_hold_the_truth_mostly(look):
    """Frequency and size of a hum, size of a drift: 90 % intervals, of 6 campaigns each."""
    held = {"frequency_Hz": 0, "amplitude": 0}
    size = 0
    for seed in range(6):
        rng = np.random.default_rng([33, seed])
        observed = recordings()
        noise = white(observed, rng)
        (hum,) = look(observed, together(noise, tone(observed, rng, 9e4, RMS)), ("mains_hum",))
        for name, truth in (("frequency_Hz", 9e4), ("amplitude", RMS)):
            held[name] += hum.estimates[name].low <= truth <= hum.estimates[name].high
        (drifted,) = look(observed, together(noise, drift(observed, rng, 3 * RMS)), ("baseline_drift",))
        # normal coefficients of 1, x and x²: the largest deviation's root mean square, drawn once and for all
        draws = np.abs(np.linspace(-1, 1, 600)[:, None] ** np.arange(3) @ rng.standard_normal((3, 4000))).max(axis=0)
        truth = 3 * RMS * np.sqrt(np.mean(draws**2))
        size += drifted.estimates["amplitude"].low <= truth <= drifted.estimates["amplitude"].high
    assert min(held["frequency_Hz"], held["amplitude"], size) >= 4  # fewer: one time in 60, if nine of ten hold it
    assert held["frequency_Hz"] + held["amplitude"] + size >= 14  # fewer: one time in 36; half hold: one time in 65
