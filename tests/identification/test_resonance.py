"""A resonance is believed where there is one, and refused where an answer that never rings does as well."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from inkjet_env.experiments.robustness.mutated_inputs import small_campaign
from inkjet_env.experiments.validation.resonance_study import WITH, WITHOUT, outcome
from inkjet_env.identification import UnidentifiableError, identify
from inkjet_env.identification.outcome import _squared_distance_from_zero
from inkjet_env.identification.relaxation import low_passed
from inkjet_env.recordings import Campaign, Recording


@pytest.mark.parametrize("kind", [*WITHOUT, *WITH])
def test_what_never_rings_is_refused_and_what_rings_is_found(kind):
    right, told = outcome(kind, seed=1)
    assert right, told


@pytest.mark.parametrize(
    ("kind", "seed"),
    [("static", 12065), ("clipped", 12023), ("clipped", 12033), ("one_sine", 7079), ("clipped_resonator", 12107)],
)
def test_systems_that_once_were_told_wrongly(kind, seed):
    right, told = outcome(kind, seed)
    assert right, told


def test_a_low_pass_is_that_of_a_transfer_function():
    rng = np.random.default_rng(0)
    v, step_s, tau_s = np.cumsum(rng.normal(size=(400, 2)), axis=0), 1e-6, 7e-6
    mine = low_passed(v, step_s / tau_s, periodic=False)
    for k in range(2):
        _, theirs, _ = signal.lsim(([1.0], [tau_s, 1.0]), v[:, k] - v[0, k], step_s * np.arange(400))
        np.testing.assert_allclose(mine[:, k], theirs + v[0, k], atol=1e-9)


def test_a_steady_low_pass_is_that_of_many_repeats():
    v = np.random.default_rng(0).normal(size=150)
    mine = low_passed(v, 0.02, periodic=True)
    np.testing.assert_allclose(mine, low_passed(np.tile(v, 9), 0.02, periodic=False)[-150:], atol=1e-7)


def test_slow_and_fast_limits_of_a_low_pass():
    v = np.random.default_rng(0).normal(size=300)
    np.testing.assert_allclose(low_passed(v, 1e4, periodic=False), v, atol=1e-3)
    np.testing.assert_allclose(low_passed(v, 1e-9, periodic=False), v[0], atol=1e-5)


def sine(frequency_Hz, state, level):
    time_s = np.arange(2000) * 1e-3
    drive_V = level * np.sin(2 * np.pi * frequency_Hz * time_s)
    return time_s, drive_V, state


def test_the_second_harmonic_of_a_curved_law_is_no_resonance():
    """One sine through a curved law, recorded as displacement: nothing is known between the harmonics."""
    rng = np.random.default_rng(0)
    recordings = []
    for k, level in enumerate((5.0, 10.0, 10.0)):
        time_s, drive_V, state = sine(3.0, "periodic", level)
        sensor = drive_V + 0.02 * drive_V**2 + rng.normal(0, 0.01, 2000)
        recordings.append(
            Recording(f"r{k}", time_s, drive_V, sensor, "um", "displacement", initial_state=state, order=k + 1)
        )
    found = identify(Campaign("curved", tuple(recordings)))
    assert not found.printhead.has_dynamics


@pytest.mark.parametrize(("frequencies_Hz", "found"), [((400.0,) * 4, False), ((200.0, 400.0, 700.0, 900.0), True)])
def test_steady_sines_of_several_frequencies_show_a_resonance_and_those_of_one_do_not(frequencies_Hz, found):
    """Static hysteresis, then a resonator at 500 Hz; sines of different heights."""
    step_s, n = 1e-4, 1000
    s = 2j * np.pi * np.fft.rfftfreq(n, step_s)
    answer = 1 / (1 + 0.06 * s / (1000 * np.pi) + (s / (1000 * np.pi)) ** 2)
    rng = np.random.default_rng(0)
    recordings = []
    for k, frequency_Hz in enumerate(frequencies_Hz):
        drive_V = 10 * (k + 1) * np.sin(2 * np.pi * frequency_Hz * step_s * np.arange(n))
        play = np.tile(drive_V, 2)
        for j in range(1, play.size):
            play[j] = min(max(play[j - 1], play[j] - 3), play[j] + 3)
        sensor = np.fft.irfft(np.fft.rfft(drive_V + 0.3 * play[n:]) * answer, n) + rng.normal(0, 0.01, n)
        recordings.append(
            Recording(
                f"r{k}",
                step_s * np.arange(n),
                drive_V,
                sensor,
                "um",
                "displacement",
                initial_state="periodic",
                order=k + 1,
            )
        )
    head = identify(Campaign("sines", tuple(recordings))).printhead
    assert head.has_dynamics == found
    if found:
        assert head.frequency_Hz == pytest.approx(500, rel=0.02)


def test_a_channel_that_does_not_follow_the_drive_is_refused():
    rng = np.random.default_rng(0)
    drive_V = 40 * np.interp(np.arange(600), [50, 60, 150, 160], [0.0, 1.0, 1.0, 0.0])
    recordings = [
        Recording(
            f"r{k}",
            np.arange(600) * 1e-6,
            drive_V * (1 + k) / 3,
            rng.normal(size=600),
            "V",
            "self_sensing",
            order=k + 1,
        )
        for k in range(4)
    ]
    with pytest.raises(UnidentifiableError):
        identify(Campaign("silent", tuple(recordings)))


def test_a_law_of_strongly_correlated_coefficients_is_told_from_zero():
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    covariance = axes @ np.diag([1e-13, 1e-2, 1.0]) @ axes.T
    assert _squared_distance_from_zero(axes[:, 0] * 1e-4, covariance) > 1e4  # the direction that is known best
    assert _squared_distance_from_zero(axes[:, 2] * 2, covariance) == pytest.approx(4, rel=1e-3)
    assert _squared_distance_from_zero(np.zeros(3), covariance) == 0


def resonator_that_creeps(frequency_Hz, compliance, step_s):
    """Numerator and denominator of a resonator of damping ratio 0.03 behind three Kelvin-Voigt elements."""
    omega = 2 * np.pi * frequency_Hz
    numerator, denominator = np.array([1.0]), np.array([1.0])
    for tau_s in np.array([30.0, 300.0, 3000.0]) * step_s:
        numerator = np.polyadd(np.polymul(numerator, [tau_s, 1.0]), compliance * denominator)
        denominator = np.polymul(denominator, [tau_s, 1.0])
    return numerator, np.polymul(denominator, [omega**-2, 0.06 / omega, 1.0])


@pytest.mark.parametrize(("compliance", "asymmetry"), [(0.0, 0.1), (0.15, 0.0)])
def test_a_ring_in_a_short_part_of_a_long_recording_is_found_beside_creep_and_asymmetry(compliance, asymmetry):
    """A step, and then a slow sine that is answered less on one side; one recording, without repeats."""
    step_s, n = 2e-4, 12000
    time_s = step_s * np.arange(n)
    drive_V = np.where(time_s < 0.2, 0.0, 20.0) + np.where(time_s < 0.5, 0.0, 60 * np.sin(2 * np.pi * (time_s - 0.5)))
    numerator, denominator = resonator_that_creeps(500.0, compliance, step_s)
    _, answer, _ = signal.lsim((numerator, denominator), drive_V, time_s, interp=False)
    rng = np.random.default_rng(0)
    answer *= 1 - asymmetry * (answer < 0)
    recording = Recording(
        "long", time_s, drive_V, answer + rng.normal(0, 0.02, n), "um", "displacement", initial_state="demagnetised"
    )
    found = identify(Campaign("long", (recording,)))
    assert found.printhead.frequency_Hz == pytest.approx(500, rel=0.02)


def test_a_ring_in_one_recording_is_found_beside_louder_errors_in_others():
    """A step that rings; two sines answered by a lag of the velocity's sign, which no answer of the model explains."""
    step_s, n = 2e-4, 6000
    time_s = step_s * np.arange(n)
    rng = np.random.default_rng(0)
    recordings = []
    for k, (step_V, swing_V) in enumerate(((20.0, 0.0), (0.0, 60.0), (0.0, 60.0))):
        moving = np.where(time_s < 0.3, 0.0, np.sin(2 * np.pi * (k + 0.3) * (time_s - 0.3)))
        drive_V = np.where(time_s < 0.2, 0.0, step_V) + swing_V * moving
        _, answer, _ = signal.lsim(resonator_that_creeps(500.0, 0.0, step_s), drive_V, time_s, interp=False)
        velocity = np.tanh(np.gradient(drive_V, step_s) / 50)
        answer += 0.2 * swing_V * signal.lfilter([0.002], [1, -0.998], velocity)
        answer += rng.normal(0, 0.01, n)
        recordings.append(
            Recording(f"r{k}", time_s, drive_V, answer, "um", "displacement", initial_state="demagnetised", order=k + 1)
        )
    found = identify(Campaign("lagging", tuple(recordings)))
    assert found.printhead.frequency_Hz == pytest.approx(500, rel=0.02)


@pytest.mark.parametrize(
    "spoilt", [lambda sensor: -sensor, lambda sensor: np.where(np.arange(sensor.size) > 40, sensor[40], sensor)]
)
def test_a_resonance_is_believed_though_one_of_few_recordings_is_spoilt(spoilt):
    """A sensor wired the other way round, or one that sticks: what is left of it is taken for the noise of all."""
    campaign = small_campaign(np.random.default_rng(0))
    first, *others = campaign.recordings
    found = identify(replace(campaign, recordings=(replace(first, sensor=spoilt(first.sensor)), *others)))
    assert found.printhead.frequency_Hz == pytest.approx(50e3, rel=0.02)
