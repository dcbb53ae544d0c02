"""A campaign as the diagnosis sees it, and where its noise is told from."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from inkjet_env.identification.measurements import measurements
from inkjet_env.identification.noise import NoiseModel, noise_model
from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.campaign_noise import Noise, noise_seen
from inkjet_env.mismatch.fitting.dataset import finer, observe
from inkjet_env.recordings import Campaign, Recording

SETTINGS = DiagnosisSettings()

STEP_S = 1e-6
PULSE_V = np.interp(np.arange(500.0), [0, 150, 160, 200, 210], [0, 0, 60, 60, 0])


def recording(name, drive_V=PULSE_V, sensor=None, channel="self_sensing", state="demagnetised", **more):
    drive_V = np.asarray(drive_V, dtype=float)
    sensor = np.zeros(drive_V.size) if sensor is None else sensor
    times_s = more.pop("step_s", STEP_S) * np.arange(drive_V.size)
    return Recording(name, times_s, drive_V, sensor, more.pop("unit", "V"), channel, "arbitrary", state, **more)


def campaign(*recordings):
    return Campaign("test", recordings)


def white(rms, samples, seed):
    return rms * np.random.default_rng(seed).standard_normal(samples)


def seen_in(*recordings, otherwise=None):
    """Noise when a model explains nothing, with nothing held out."""
    observed = observe(campaign(*recordings), held_out=[])
    return observed, noise_seen(observed, {o.name: o.measured for o in observed}, otherwise or {}, SETTINGS.fitting)


def test_recordings_keep_the_campaigns_order_and_what_they_are(recorded):
    found = observe(recorded())
    of = {r.name: r for r in recorded().recordings}
    assert [o.name for o in found] == list(of)
    for o in found:
        r = of[o.name]
        assert (o.channel, o.unit, o.excitation.order, o.excitation.initial_state) == (
            r.channel,
            "V",
            r.order,
            r.initial_state,
        )
        np.testing.assert_array_equal(o.measured, r.sensor)
        np.testing.assert_array_equal(o.excitation.drive_V, r.drive_V)
        assert o.excitation.step_s == pytest.approx(r.step_s)
        assert o.still == (np.ptp(r.drive_V) == 0)


def test_recordings_of_one_drive_share_a_condition_and_no_others_do(recorded):
    found = observe(recorded())
    for a in found:
        for b in found:
            same = (a.channel, a.excitation.initial_state) == (
                b.channel,
                b.excitation.initial_state,
            ) and np.array_equal(a.excitation.drive_V, b.excitation.drive_V)
            assert (a.condition == b.condition) == same


def test_a_free_initial_state_is_a_condition_of_its_own():
    found = observe(campaign(recording("a", state="free"), recording("b", state="free")), held_out=[])
    assert found[0].condition != found[1].condition


def test_whole_conditions_are_held_out_as_in_an_identification(recorded):
    told = {name: m.fitted for m in measurements(recorded()) for name in m.names}
    found = observe(recorded())
    assert {o.name: o.fitted for o in found} == told
    held_out = [o for o in found if not o.fitted]
    assert held_out
    assert len(held_out) < len(found)
    for o in found:
        assert o.fitted in (0, o.excitation.samples)
        assert (o.rows(True), o.rows(False)) == (slice(o.fitted, None), slice(0, o.fitted))
    chosen = next(o for o in found if sum(other.condition == o.condition for other in found) == 2)
    names = {o.name for o in observe(recorded(), [chosen.name]) if not o.fitted}
    assert names == {o.name for o in found if o.condition == chosen.condition}  # repeats go with it


def test_the_end_of_the_longest_is_held_out_where_there_are_few():
    short, long = recording("short"), recording("long", np.tile(PULSE_V, 2))
    fitted = {o.name: o.fitted for o in observe(campaign(short, long))}
    assert fitted == {"short": 500, "long": 750}


def test_a_held_out_name_that_is_none_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match=r"held-out recording 'pulsee' is not in campaign 'test'.*pulse"):
        observe(campaign(recording("pulse")), ["pulsee"])


def test_nanometres_become_micrometres():
    sensor = np.linspace(0, 500, 500)
    (found,) = observe(campaign(recording("a", channel="displacement", unit="nm", sensor=sensor)), [])
    assert found.unit == "um"
    np.testing.assert_allclose(found.measured, 1e-3 * sensor)


def test_a_drive_monitor_is_a_recording_of_its_own(recorded):
    made = recorded(monitored=True)
    found = observe(made)
    monitors = [o for o in found if o.channel == "drive_monitor"]
    assert [o.name for o in monitors] == [f"{r.name} (drive monitor)" for r in made.recordings]
    by_name = {o.name: o for o in found}
    for o, r in zip(monitors, made.recordings, strict=True):
        beside = by_name[r.name]
        assert (o.unit, o.fitted, o.condition) == ("V", beside.fitted, -1 - beside.condition)
        assert not o.excitation.fast
        np.testing.assert_array_equal(o.measured, r.drive_monitor_V)


def test_finer_recordings_follow_the_same_drive_on_more_nodes(recorded):
    found = observe(recorded())
    fine = finer(found, 8)
    for a, b in zip(found, fine, strict=True):
        assert (b.excitation.substeps, b.name, b.fitted) == (8, a.name, a.fitted)
        assert not b.excitation.cache  # nothing computed on the coarser nodes
        np.testing.assert_allclose(b.excitation.sampled(b.excitation.drive_at_nodes_V), a.excitation.drive_V)
        assert a.excitation.substeps == 2


@pytest.mark.parametrize("rms", [1e-6, 3.0])
def test_recordings_at_rest_tell_the_noise_whatever_their_offset(rms):
    still = [recording(n, np.zeros(2000), 5.0 + white(rms, 2000, k)) for k, n in enumerate("ab")]
    (observed, *_), noise = seen_in(*still, recording("c", sensor=100 * rms * PULSE_V))
    model = noise.models[observed.noise_key]
    assert model.rms == pytest.approx(rms, rel=0.05)
    assert model.source == "recordings at rest"
    assert noise.samples[observed.noise_key] == 4000
    assert noise.known(observed)
    assert noise.notes == ()


def test_a_head_at_rest_beside_one_that_fires_tells_no_noise():
    rms, neighbour_V = 0.02, np.interp(np.arange(2000.0), [0, 300, 310], [0, 0, 50])
    heard = recording("a", np.zeros(2000), white(rms, 2000, 3) + 0.01 * neighbour_V, neighbour_V=neighbour_V)
    quiet = recording("b", np.zeros(2000), white(rms, 2000, 4), neighbour_V=np.full(2000, 20.0))
    (first, second, *_), noise = seen_in(heard, quiet, recording("c", sensor=100 * rms * PULSE_V))
    assert first.still
    assert (first.at_rest, second.at_rest) == (False, True)
    model = noise.models[first.noise_key]
    assert model.source == "recordings at rest"
    assert model.rms == pytest.approx(rms, rel=0.05)


def test_repeats_tell_the_noise_whatever_they_share():
    shared = 50 * np.sin(np.arange(500.0))
    same = [recording(n, sensor=shared + white(0.2, 500, k)) for k, n in enumerate("abc")]
    (observed, *_), noise = seen_in(*same)
    model = noise.models[observed.noise_key]
    assert model.source == "repeats"
    assert model.rms == pytest.approx(0.2, rel=0.06)  # of one recording, not of the deviation from their mean
    assert noise.known(observed)


def test_repeats_that_differ_by_more_than_rest_are_left_out_and_told_of():
    rest = recording("rest", np.zeros(1000), white(0.1, 1000, 0))
    same = [recording(n, sensor=white(0.1, 500, k) + 0.4 * k * np.sin(np.arange(500))) for k, n in enumerate("abc")]
    (observed, *_), noise = seen_in(rest, *same)
    assert noise.models[observed.noise_key].source == "recordings at rest"
    assert noise.models[observed.noise_key].rms == pytest.approx(0.1, rel=0.1)
    (note,) = noise.notes
    assert note.startswith("self_sensing: repeats of the same drive differ by ")
    alike = [recording(n, sensor=white(0.1, 500, k)) for k, n in enumerate("abc")]
    _, noise = seen_in(rest, *alike)
    assert noise.models[observed.noise_key].source == "recordings at rest and repeats"
    assert noise.samples[observed.noise_key] == 2000  # of three repeats, one determines their mean
    assert noise.notes == ()


def test_the_rest_before_the_drive_tells_the_noise_where_nothing_else_does():
    sensor = white(0.3, 500, 1)
    sensor[151:] += 40.0
    (observed,), noise = seen_in(recording("a", sensor=sensor))
    assert noise.models[observed.noise_key].source == "samples before the drive"
    assert noise.models[observed.noise_key].rms == pytest.approx(0.3, rel=0.2)
    assert 140 < noise.samples[observed.noise_key] <= 151
    periodic = recording("a", sensor=sensor, state="periodic")  # before the drive comes what still rings
    (observed,), noise = seen_in(periodic)
    assert not noise.known(observed)


def test_a_sampling_step_without_noise_of_its_own_takes_the_nearest_ones():
    rests = [recording(f"r{k}", np.zeros(800), white(s, 800, k), step_s=k * 1e-6) for k, s in ((1, 0.1), (20, 7.0))]
    lone = recording("lone", sensor=9 * PULSE_V, state="periodic", step_s=3e-6)
    observed, noise = seen_in(*rests, lone)
    key = next(o.noise_key for o in observed if o.name == "lone")
    assert key not in {o.noise_key for o in observed if o.still}
    assert noise.models[key].rms == pytest.approx(0.1, rel=0.1)
    assert noise.known(next(o for o in observed if o.name == "lone"))


def remembering(rms, samples, step_s, memory_s, seed):
    """Noise whose correlation falls to 1/e in a memory, of the same RMS at any sampling step."""
    kept = np.exp(-step_s / memory_s)
    pushed = np.sqrt(1 - kept**2) * np.random.default_rng(seed).standard_normal(samples)
    return rms * lfilter([1.0], [1.0, -kept], pushed)


def test_noise_known_at_another_step_has_the_colour_that_the_upper_lines_show():
    """Noise with a memory of 5 µs is white every 100 µs, and is not every microsecond."""
    rest = recording("rest", np.zeros(2000), remembering(0.1, 2000, 1e-4, 5e-6, 1), step_s=1e-4)
    slow = 0.5 * np.sin(2 * np.pi * np.arange(2000) / 700)  # a loop that a model misses
    for loop in (0.0, slow):
        lone = recording("lone", 30 * np.sin(np.arange(2000) / 90), loop + remembering(0.1, 2000, 1e-6, 5e-6, 2))
        observed, noise = seen_in(rest, replace(lone, initial_state="periodic"))
        (o,) = (o for o in observed if o.name == "lone")
        assert o.noise_key in noise.borrowed
        assert noise.models[o.noise_key].rms == pytest.approx(0.1, rel=0.3)
        assert noise.models[o.noise_key].innovation == pytest.approx(0.1 * np.sqrt(1 - np.exp(-0.4)), rel=0.2)


def test_residuals_much_louder_than_the_noise_at_another_step_are_no_noise():
    rest = recording("rest", np.zeros(2000), white(0.1, 2000, 1), step_s=1e-4)
    lone = recording("lone", 30 * np.sin(np.arange(2000) / 90), remembering(0.5, 2000, 1e-6, 5e-6, 2), state="periodic")
    observed, noise = seen_in(rest, lone)
    (o,) = (o for o in observed if o.name == "lone")
    assert noise.models[o.noise_key].innovation == pytest.approx(0.1, rel=0.1)


def test_what_most_samples_leave_is_taken_for_noise_where_nothing_tells_it():
    sensor = white(0.05, 500, 3)
    sensor[160:200] += 30.0  # where the model fails
    (observed,), noise = seen_in(recording("a", sensor=sensor, state="periodic"))
    model = noise.models[observed.noise_key]
    assert model.source == "the level of most residuals"
    assert model.rms == pytest.approx(0.05, rel=0.2)
    assert not noise.known(observed)
    assert "the noise is unknown without repeats or recordings at rest" in noise.notes[0]


def test_an_identifications_noise_is_taken_before_what_most_samples_show():
    told = NoiseModel(np.ones(1), 0.7, 0.7, "the residual of the fit")
    alone = recording("a", sensor=white(0.05, 500, 3), state="periodic")
    key = observe(campaign(alone), [])[0].noise_key
    (observed,), noise = seen_in(alone, otherwise={key: told})
    assert noise.models[key].rms == 0.7
    assert not noise.known(observed)


def test_noise_below_what_the_numbers_can_tell_is_not_believed():
    """Repeats equal to the last bit: the noise is what the converter's step hides."""
    step = 0.01
    sensor = step * np.round(np.sin(np.arange(500.0)) / step)
    (observed, _), noise = seen_in(recording("a", sensor=sensor), recording("b", sensor=sensor))
    assert noise.models[observed.noise_key].rms == pytest.approx(step / np.sqrt(12), rel=1e-6)


def coloured(samples, seed):
    """Noise with a memory of a few samples and 1/f noise in it."""
    rng = np.random.default_rng(seed)
    spectrum = np.fft.rfft(rng.standard_normal(samples))
    lines = np.maximum(np.fft.rfftfreq(samples), 1 / samples)
    made = np.fft.irfft(spectrum * np.sqrt(1 + 0.02 / lines), samples)
    for k in range(1, samples):
        made[k] += 0.6 * made[k - 1]
    return made


def test_whitened_noise_is_white_with_unit_variance():
    still = [recording(f"r{k}", np.zeros(4000), coloured(4000, k)) for k in range(4)]
    observed, noise = seen_in(*still)
    fresh = coloured(4000, 99)
    result = noise.whitened(observed[0], fresh)
    assert result.shape == fresh.shape
    lost = noise.models[observed[0].noise_key].lost
    assert lost >= 1
    np.testing.assert_array_equal(result[:lost], 0.0)
    assert np.std(result) == pytest.approx(1.0, rel=0.05)
    power = np.abs(np.fft.rfft(result)[1:]) ** 2 / result.size
    for part in np.array_split(power, 8):
        assert part.mean() == pytest.approx(1.0, abs=0.25)
    lag = float(result[1:] @ result[:-1]) / float(result @ result)
    assert abs(lag) < 4 / np.sqrt(4000)


def test_columns_are_whitened_each_like_a_signal():
    still = recording("r", np.zeros(4000), coloured(4000, 1))
    (observed,), noise = seen_in(still)
    table = np.random.default_rng(2).standard_normal((4000, 3))
    together = noise.whitened(observed, table)
    for k in range(3):
        np.testing.assert_allclose(together[:, k], noise.whitened(observed, table[:, k]), atol=1e-12)


def test_the_scale_of_the_noise_is_its_gaussian_likelihoods():
    """With white noise, what the likelihood loses is the logarithm of its deviation."""
    still = recording("r", np.zeros(3000), white(0.4, 3000, 1))
    (observed,) = observe(campaign(still), [])
    model = noise_model([observed.measured], "a test", 1e-9)
    noise = Noise({observed.noise_key: model}, {observed.noise_key: 3000})
    assert noise.log_scale(observed) == pytest.approx(np.log(0.4), abs=0.05)
    louder = Noise(noise.models, noise.samples, levels={observed.name: np.full(3000, np.e)})
    assert louder.log_scale(observed) == pytest.approx(noise.log_scale(observed) + 1.0)
    np.testing.assert_allclose(
        louder.whitened(observed, observed.measured), noise.whitened(observed, observed.measured) / np.e
    )
