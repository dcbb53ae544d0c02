"""Waves that come back: once, and over and over from between two ends, against marches that share nothing with them."""

import math

import numpy as np
import pytest

from inkjet_env.plant import Excitation, Plant, Resonance
from inkjet_env.plant.effect import complete, limits, terms_of
from inkjet_env.plant.effects.wave_echo import WaveEcho
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PERIOD_S = 1 / HEAD.frequency_Hz
ECHO = WaveEcho()
RESONANCE = Resonance(HEAD.a0, HEAD.a1, HEAD.a0)
CORNERS = [0, 20, 70, 110, 160, 200, 500, 510, 550, 560]
HEIGHTS_V = [0.0, 80.0, 80.0, -60.0, -60.0, 0.0, 0.0, 45.0, 45.0, 0.0]


def pulses(samples):
    """Two steep bipolar pulses with rest after each."""
    return np.interp(np.arange(samples), CORNERS, HEIGHTS_V)


def between(source, first, second, r1, r2, keep=0.0):
    """What comes back in a channel of two ends, whole samples away, by marching both waves; a lag at each end."""
    to_first, to_second = source.copy(), source.copy()
    back_1, back_2 = np.zeros(source.size), np.zeros(source.size)
    mean = (1 - keep) / -math.log(keep) if keep else 1.0  # of a signal that is linear between samples
    for k in range(1, source.size):
        for back, wave, delay, r in ((back_1, to_first, first, r1), (back_2, to_second, second, r2)):
            now, before = (wave[k - delay - i] if k - delay - i >= 0 else 0.0 for i in (0, 1))
            back[k] = keep * back[k - 1] + r * ((1 - mean) * now + (mean - keep) * before) if keep else r * now
        to_first[k] += back_2[k]
        to_second[k] += back_1[k]
    return back_1 + back_2


def test_an_echo_is_the_motion_again_delay_later():
    """Between samples the copy is cubic: corners of the self-sensing signal lie within 2e-4 of its largest value."""
    for channel, tolerance in (("displacement", 2e-6), ("self_sensing", 2e-4)):
        excitation = Excitation(channel, "demagnetised", PERIOD_S / 100, pulses(1500))
        finer_V = np.interp(np.arange(14991) / 10, np.arange(1500), excitation.drive_V)
        fine = Excitation(channel, "demagnetised", PERIOD_S / 1000, finer_V)
        values = complete(ECHO, delay_s=1.237 * PERIOD_S, strength=-0.4)  # 123.7 samples: whole on the fine grid
        echoing = ECHO.resonator(values, RESONANCE, excitation)
        exact = RESONANCE.motion(fine.drive_at_nodes_V, fine)
        late = np.append(np.zeros(1237), exact[:-1237])
        expected = (exact - 0.4 * late)[::10]
        error = (
            np.abs(echoing.motion(excitation.drive_at_nodes_V, excitation) - expected).max() / np.abs(expected).max()
        )
        assert error < tolerance, channel


@pytest.mark.parametrize(("r1", "r2"), [(0.6, -0.8), (-0.5, -0.9), (0.9, 0.9), (-0.4, 0.0)])
@pytest.mark.parametrize("loss_periods", [0.0, 0.06])
def test_waves_between_two_ends_are_those_of_a_march(r1, r2, loss_periods):
    """From rest: nothing comes back before the shorter delay."""
    excitation = Excitation("displacement", "demagnetised", PERIOD_S / 50, pulses(1500))
    values = complete(
        ECHO, delay_s=43 * excitation.step_s, second_delay_s=71 * excitation.step_s, strength=0.3 * r1, reflection=r1,
        second_reflection=r2, loss_s=loss_periods * PERIOD_S,
    )  # fmt: skip
    motion = RESONANCE.motion(excitation.drive_at_nodes_V, excitation)
    keep = math.exp(-1 / (50 * loss_periods)) if loss_periods else 0.0
    expected = motion + 0.3 * between(motion, 43, 71, r1, r2, keep)
    found = ECHO.resonator(values, RESONANCE, excitation).motion(excitation.drive_at_nodes_V, excitation)
    assert found == pytest.approx(expected, abs=2e-4 * 0.3 * np.abs(motion).max())


def test_under_a_repeated_drive_they_are_the_quotient_of_the_transform():
    excitation = Excitation("displacement", "periodic", PERIOD_S / 50, pulses(900))
    r1, r2 = -0.7, 0.85
    values = complete(
        ECHO, delay_s=38.3 * excitation.step_s, second_delay_s=77.9 * excitation.step_s, strength=0.2, reflection=r1,
        second_reflection=r2, loss_s=0.05 * PERIOD_S,
    )  # fmt: skip
    motion = RESONANCE.motion(excitation.drive_at_nodes_V, excitation)
    s = 2j * np.pi * np.fft.rfftfreq(900, excitation.step_s)
    z1, z2 = (
        np.exp(-s * delay_s) / (1 + 0.05 * PERIOD_S * s)
        for delay_s in (38.3 * excitation.step_s, 77.9 * excitation.step_s)
    )
    quotient = 0.2 * (z1 + r2 / r1 * z2 + 2 * r2 * z1 * z2) / (1 - r1 * r2 * z1 * z2)
    expected = np.fft.irfft((1 + quotient) * np.fft.rfft(motion), 900)
    found = ECHO.resonator(values, RESONANCE, excitation).motion(excitation.drive_at_nodes_V, excitation)
    assert found == pytest.approx(expected, abs=2e-3 * np.abs(expected - motion).max())


def test_a_single_return_has_one_part():
    values = complete(ECHO, delay_s=2 * PERIOD_S, strength=0.1)
    point = np.array([p.coordinate(values[p.name]) for p in ECHO.parameters])
    on, off = terms_of(ECHO, point)
    assert on == [("strength",)]
    assert off == [("second_reflection", "second_delay_s", "reflection"), ("loss_s",)]


def test_starts_of_the_whole_law_are_the_sums_they_are_said_to_be():
    """But for the laps after the fifth, which are not heard: ``(r1 r2)^5`` of what comes back."""
    excitations = [Excitation("self_sensing", "periodic", PERIOD_S / 50, pulses(900))]
    plain, starts, weights = ECHO.superposed(HEAD, excitations)
    assert weights.shape == (len(starts), len(plain))
    plant = Plant(HEAD)

    def added(values):
        return plant.with_effects([(ECHO, values)]).signal(excitations[0]) - plant.signal(excitations[0])

    low, high = limits(ECHO, HEAD, excitations)
    points = np.array([[p.coordinate(start[p.name]) for p in ECHO.parameters] for start in starts])
    assert ((points >= low) & (points <= high)).all()
    columns = np.column_stack([added(values) for values in plain])
    laps_s = np.array([start["delay_s"] + start["second_delay_s"] for start in starts])
    whole = np.flatnonzero(6 * laps_s <= plain[-1]["delay_s"])  # of the others later copies are cut off
    for k in np.random.default_rng(5).choice(whole, 12, replace=False):
        expected = added(starts[k])
        found = columns @ weights[[k]].toarray()[0]
        lost = abs(starts[k]["reflection"] * starts[k]["second_reflection"]) ** 5
        assert np.abs(found - expected).max() == pytest.approx(lost * np.abs(expected).max(), rel=0.2)


def test_it_says_what_goes_round():
    values = complete(ECHO, delay_s=20e-6, second_delay_s=35e-6, strength=0.05, reflection=0.5, second_reflection=-0.8)
    said = ECHO.description(values)
    assert "20 µs" in said
    assert "other end" in said
    assert "40 %" in said
    assert "55 µs" in said
    assert "other end" not in ECHO.description(complete(ECHO, delay_s=20e-6, strength=0.05))


def test_an_end_that_reflects_nothing_throws_nothing_back():
    values = complete(ECHO, delay_s=20e-6, second_delay_s=35e-6, strength=0.05, reflection=0.0, second_reflection=0.5)
    excitation = Excitation("displacement", "demagnetised", PERIOD_S / 50, pulses(300))
    with pytest.raises(FloatingPointError, match="reflects nothing"):
        ECHO.resonator(values, RESONANCE, excitation).motion(excitation.drive_at_nodes_V, excitation)
