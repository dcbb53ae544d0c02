"""Drive and hysteresis stages: a limit and a second way of computing for each element."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.concealed_rig.effects.drive import AmplifierBandwidth, SlewLimit, TriggerDelay, low_passed
from experiments.concealed_rig.effects.hysteresis import (
    AsymmetricHysteresis,
    Creep,
    RateDependentHysteresis,
    _creep_lap,
    _creep_operator,
)
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.head import drawn_head
from experiments.concealed_rig.linear import relaxations
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.plant import Plant, noise_free
from experiments.concealed_rig.play import changing_play_sum_V, following, play_sum_V


def triangle(top, samples):
    return top * np.interp(np.arange(samples) / samples, [0, 0.25, 0.75, 1], [0, 1, -1, 0])


LADDER = np.prod(
    1 + 0.1j / (2 - 2 * np.cos((2 * np.arange(1, 5) - 1) * np.pi / 9))
)  # by the eigenvalues of four sections
RESPONSES = [
    ("first_order", 1 / (1 + 1j)),
    ("second_order", 1 / 1.4j),
    ("two_poles", 1 / (1 + 1j) / (1 + 0.4j)),
    ("lossy_line", 1 / LADDER),
]


@pytest.mark.parametrize(("kind", "response"), RESPONSES)
def test_a_tone_at_the_bandwidth_is_lowered_as_its_poles_say(kind, response):
    """The tone's line, less what straight lines between the points take, sinc²; left: their aliases, 1e-11."""
    t = np.arange(4001) * 1e-8
    tone = np.sin(2 * np.pi * 1e5 * t)
    out = low_passed(tone, 1e5, kind, 1e-8, True)[:-1]
    line = 2j * np.mean(out * np.exp(-2j * np.pi * 1e5 * t[:-1]))
    assert line == pytest.approx(response * np.sinc(1e-3) ** 2, rel=1e-9)


def test_a_wide_amplifier_is_late_by_twice_its_damping_over_its_frequency():
    """Its own motion is over within a point, exp(−44): left is rounding."""
    drive = np.append(triangle(80.0, 2000), 0.0)
    grid = Grid(1000, 4e-7, 1, True)
    wide = AmplifierBandwidth(1e-3, variant="second_order", resonance_Hz=5e4).on_drive(drive, grid)
    slope = np.diff(drive, prepend=drive[-2]) / 2e-7
    np.testing.assert_allclose(wide, drive - slope * 1.4 / (2 * np.pi * 5e7), rtol=0, atol=1e-12)


def test_a_slew_limit_stretches_an_edge_to_its_height_over_the_limit():
    """Left: the margin against rounding, 1e-9 of the edge; of the soft stage, Runge–Kutta in the pieces, 3e-7 V."""
    grid = Grid(401, 1e-7, 1, False)
    t = np.arange(801) * 5e-8
    drive = np.interp(t, [1e-6, 2e-6, 2.5e-5, 3.5e-5], [0, 100, 100, 0])
    slow = SlewLimit(4.0, variant="hard", steepest_V_per_s=1e8).on_drive(drive, grid)
    np.testing.assert_allclose(slow, np.interp(t, [1e-6, 5e-6, 2.5e-5, 3.5e-5], [0, 100, 100, 0]), rtol=0, atol=3e-7)
    untouched = SlewLimit(1.0, variant="hard", steepest_V_per_s=1e8).on_drive(drive, grid)
    np.testing.assert_allclose(untouched, drive, rtol=0, atol=1e-12)
    soft = SlewLimit(4.0, variant="soft", steepest_V_per_s=1e8).on_drive(drive, grid)
    assert np.max(np.abs(np.diff(soft))) / 5e-8 <= 2.5e7 * (1 + 2e-9)
    # Well inside its linear range the soft stage is a low-pass of S/range, which takes 0.02 V here.
    small = SlewLimit(4.0, variant="soft", steepest_V_per_s=1e8, linear_V=5.0).on_drive(1e-3 * drive, grid)
    np.testing.assert_allclose(
        small, relaxations(1e-3 * drive, np.array([5 / 2.5e7]), 5e-8, False)[0], rtol=0, atol=1e-6
    )


@pytest.mark.parametrize("periodic", [False, True])
def test_a_delay_of_whole_points_is_a_shift(periodic):
    drive = triangle(50.0, 400)
    drive = np.append(drive, drive[0])
    grid = Grid(200, 1e-7, 1, periodic)
    late = TriggerDelay(0.01, variant="late", period_s=2e-5).on_drive(drive, grid)
    early = TriggerDelay(0.01, variant="early", period_s=2e-5).on_drive(drive, grid)
    np.testing.assert_allclose(early[:-4], drive[4:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(late[4:], drive[:-4], rtol=0, atol=1e-9)


def test_a_dense_kelvin_voigt_chain_creeps_with_the_logarithm_of_time():
    """By the plant's own recursion, a step that rises within a point of 10 ms, so lg t is meant over that point.

    Left: the chain's end at 1e8 s, t/2e8 of a decade.
    """
    times = np.geomspace(1e-4, 1e8, 97)
    creep = Creep(0.02, variant="logarithmic", times_s=tuple(times), weights=(1 / 8,) * 97)
    held = np.concatenate(([0.0], np.ones(4000)))
    out = creep.on_hysteretic(held, Grid(2001, 0.02, 1, False)) - held

    def mean_decades(point):
        after, before = 0.01 * point, 0.01 * (point - 1)
        return (after * np.log(after) - before * np.log(before) - 0.01) / 0.01 / np.log(10)

    for first, last in ((50, 100), (100, 400), (400, 4000)):
        assert out[last] - out[first] == pytest.approx(0.02 * (mean_decades(last) - mean_decades(first)), rel=3e-7)


def test_a_creep_operator_without_dead_band_is_a_kelvin_voigt_element_and_settles_where_a_long_run_does():
    h = triangle(30.0, 2000) + 10 * np.sin(np.arange(2000) * np.pi / 500)
    h = np.append(h, h[0])
    out, run = np.zeros(h.size), np.zeros(h.size)
    for threshold in (0.0, 4.0, 200.0):
        _creep_operator(h, *following(1000.0), threshold, True, out)
        y = 0.0
        for _ in range(30):
            y = _creep_lap(h, *following(1000.0), threshold, y, run)
        np.testing.assert_allclose(out, run, rtol=0, atol=1e-9)
    _creep_operator(h, *following(1e4), 0.0, True, out)
    exact = relaxations(h, np.array([1e4]), 1.0, True)[0]
    np.testing.assert_allclose(out, exact, rtol=0, atol=1e-11)


def test_at_a_constant_rate_thresholds_that_grow_are_wider_plays():
    head = drawn_head(np.random.default_rng(2))
    threshold, weight = head.plays()
    drive = np.append(triangle(80.0, 4000), 0.0)
    grown = changing_play_sum_V(drive, threshold, weight, True, rate=np.full(drive.size, 2.5), threshold_growth_V=0.4)
    np.testing.assert_allclose(grown, play_sum_V(drive, threshold + 1.0, weight, True), rtol=0, atol=1e-9)
    heavier = changing_play_sum_V(drive, threshold, weight, True, rate=np.full(drive.size, 2.5), weight_growth=0.04)
    np.testing.assert_allclose(heavier, 1.1 * play_sum_V(drive, threshold, weight, True), rtol=0, atol=1e-9)


@pytest.mark.parametrize(("variant", "volts", "share"), [("thresholds", 20.0, 0.0), ("weights", 0.0, 1.0)])
def test_the_loop_widens_with_the_logarithm_of_the_rate_and_not_at_rest(variant, volts, share):
    """A triangle's rate R is the same everywhere, so its plays are plain ones, grown by lg(1 + R/100): rounding."""
    head = replace(drawn_head(np.random.default_rng(2)), density="exponential", shape=(0.5,))
    effect = RateDependentHysteresis(0.02, variant=variant, rate_V_per_s=100.0)
    drive = triangle(80.0, 2000)
    widths = []
    for frequency in (1e-9, 1e-3, 0.5, 5.0):
        row = Measurement("strain_gauge", "arbitrary", "periodic", 1 / frequency / 2000, drive)
        y = noise_free(Plant(head, (effect,)), row)
        decades = 0.02 * np.log10(1 + 4 * 80 * frequency / 100)
        threshold, weight = head.plays()
        plays = (1 + share * decades) * play_sum_V(np.append(drive, 0.0), threshold + volts * decades, weight, True)
        np.testing.assert_allclose(
            y,
            head.gauge_gain_V_per_V * (head.reversible * drive + plays[:-1]) + head.gauge_offset_V,
            rtol=0,
            atol=1e-12,
        )
        widths.append(abs(y[0] - y[1000]))
    assert widths == sorted(widths)


def test_a_play_that_relaxes_lags_a_ramp_by_its_time():
    drive = np.linspace(0, 200, 4001)
    y = changing_play_sum_V(drive, np.array([10.0]), np.array([1.0]), False, relaxation_points=100.0)
    assert drive[-1] - 10 - y[-1] == pytest.approx(100 * 0.05, rel=1e-11)


def test_unequal_envelopes_have_the_slopes_that_are_said():
    drive = np.concatenate((np.linspace(0, 100, 401), np.linspace(100, -100, 801)[1:]))
    y = changing_play_sum_V(drive, np.array([20.0]), np.array([1.0]), False, skew=0.2, skew_swing_V=100.0)
    assert y[400] - y[300] == pytest.approx((1 - 20 * 0.2 / 100) * 25, rel=1e-9)
    assert y[-101] - y[-1] == pytest.approx((1 + 20 * 0.2 / 100) * 25, rel=1e-9)


@pytest.mark.parametrize("variant", ["dead_zones", "unequal_slopes", "bent_input"])
def test_only_an_asymmetric_head_tells_a_drive_from_its_mirror_image(variant):
    head = drawn_head(np.random.default_rng(6))
    drive = triangle(90.0, 800)

    def even_part(effects):
        up, down = (
            noise_free(
                Plant(head, effects), Measurement("strain_gauge", "arbitrary", "demagnetised", 1e-3, side * drive)
            )
            for side in (1, -1)
        )
        return np.max(np.abs(up + down - 2 * head.gauge_offset_V)) / np.ptp(up)

    zones = {"thresholds_V": (0.0, 10.0), "weights": (0.5, 0.5)} if variant == "dead_zones" else {}
    assert even_part(()) < 1e-12
    assert even_part((AsymmetricHysteresis(0.05, variant=variant, **zones),)) > 1e-3
