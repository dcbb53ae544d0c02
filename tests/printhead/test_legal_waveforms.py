"""Every waveform of a search box with a driver's limits is legal: checked on its own corners and on a fine grid."""

import math

import numpy as np
import pytest

from inkjet_env.printhead import Bounds, DriverLimits, Waveform

STEPS_US = (0.0, 0.01, 0.05, 0.1, 1 / 3, 1.0)
GRID_S = 2e-9


def random_limits(rng):
    """Any limits, each there or not."""
    given = {
        "highest_V": rng.uniform(5, 120),
        "lowest_V": rng.choice([0.0, -rng.uniform(1, 120)]),
        "rise_V_per_us": 10 ** rng.uniform(-0.5, 2.5),
        "fall_V_per_us": 10 ** rng.uniform(-0.5, 2.5),
        "step_us": rng.choice(STEPS_US),
        "shortest_us": rng.uniform(0.1, 4),
        "longest_us": rng.uniform(20, 80),
    }
    given = {name: float(value) for name, value in given.items() if rng.random() < 0.6}
    if "highest_V" in given and "lowest_V" in given:
        given["bits"] = int(rng.integers(3, 16))
    return DriverLimits(**given)


def on_a_grid(waveform):
    """Times and voltages every 2 ns, with the corners among them."""
    corners_s, _ = waveform.knots()
    time_s = np.union1d(np.arange(0.0, corners_s[-1], GRID_S), corners_s)
    return time_s, waveform.drive_V(time_s)


@pytest.mark.parametrize("seed", range(200))
def test_every_waveform_is_legal_on_a_fine_grid(seed):
    rng = np.random.default_rng(seed)
    limits = random_limits(rng)
    box = Bounds(limits=limits)
    for row in box.from_unit(rng.uniform(-1, 1, (5, 7))):
        waveform = Waveform.from_array(row)
        assert limits.excesses(*waveform.knots()) == []
        time_s, drive_V = on_a_grid(waveform)
        assert limits.lowest_V - 1e-9 <= drive_V.min()
        assert drive_V.max() <= limits.highest_V + 1e-9
        apart = np.diff(time_s) > 1e-12  # corners meet grid points but for rounding
        slews = np.diff(drive_V)[apart] / (1e6 * np.diff(time_s)[apart])
        assert slews.max() <= limits.rise_V_per_us * (1 + 1e-5)
        assert -slews.min() <= limits.fall_V_per_us * (1 + 1e-5)
        assert time_s[-1] <= 1e-6 * limits.longest_us * (1 + 1e-9)
        durations_us = 1e6 * row[2:]
        assert durations_us.min() >= limits.shortest_us * (1 - 1e-9)
        if limits.step_us:
            assert np.abs(durations_us / limits.step_us - np.rint(durations_us / limits.step_us)).max() < 1e-6
        if limits.bits:
            codes = row[:2] * 2**limits.bits / (limits.highest_V - limits.lowest_V)
            assert np.abs(codes - np.rint(codes)).max() < 1e-6
        assert (row >= np.array(box.lower) * (1 - 1e-9))[2:].all()
        assert (row <= np.array(box.upper) * (1 + 1e-9))[2:].all()


def test_a_legal_waveform_stays_as_it_is():
    rng = np.random.default_rng(0)
    for _ in range(50):
        box = Bounds(limits=random_limits(rng))
        legal = box.from_unit(rng.uniform(-1, 1, (20, 7)))
        np.testing.assert_allclose(box.legal(legal), legal, rtol=1e-12, atol=1e-18)


def test_limits_that_no_waveform_meets_change_none():
    points = np.random.default_rng(0).uniform(-1, 1, (20, 7))
    generous = DriverLimits(-200, 200, 1e3, 1e3, longest_us=1e3)
    np.testing.assert_array_equal(Bounds(limits=generous).from_unit(points), Bounds().from_unit(points))


def test_a_row_does_not_depend_on_the_others():
    box = Bounds(limits=DriverLimits(-50, 60, 5, 8, 0.1, 2, 40, 10))
    points = np.random.default_rng(0).uniform(-1, 1, (20, 7))
    np.testing.assert_array_equal(box.from_unit(points), [box.from_unit(point) for point in points])


def test_an_edge_is_lengthened_before_a_voltage_is_lowered():
    box = Bounds(limits=DriverLimits(rise_V_per_us=10, fall_V_per_us=10))
    legal = box.legal(np.array([80.0, -40.0, 1e-6, 5e-6, 1e-6, 5e-6, 1e-6]))
    np.testing.assert_allclose(legal, [80, -40, 8e-6, 5e-6, 12e-6, 5e-6, 4e-6], rtol=1e-12)


def test_voltages_are_lowered_in_proportion_where_the_edges_do_not_fit():
    box = Bounds(limits=DriverLimits(fall_V_per_us=4))
    legal = box.legal(np.array([80.0, -40.0, 1e-6, 5e-6, 1e-6, 5e-6, 1e-6]))
    assert legal[4] == pytest.approx(20e-6)
    np.testing.assert_allclose(legal[:2], [80 * 2 / 3, -40 * 2 / 3], rtol=1e-9)  # 120 V would need 30 µs


def test_a_waveform_that_is_too_long_is_shortened_where_it_can_be():
    box = Bounds(limits=DriverLimits(rise_V_per_us=10, longest_us=25))
    legal = box.legal(np.array([50.0, 0.0, 5e-6, 11e-6, 11e-6, 11e-6, 11e-6]))
    np.testing.assert_allclose(legal[2:], [5e-6, 5e-6, 5e-6, 5e-6, 5e-6], rtol=1e-12)


def test_a_unipolar_driver_gives_one_pulse():
    legal = Bounds(limits=DriverLimits(lowest_V=0)).from_unit(np.random.default_rng(0).uniform(-1, 1, (20, 7)))
    assert (legal[:, 1] == 0).all()
    assert (legal[:, 0] > 0).all()


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (DriverLimits(lowest_V=5), "a waveform starts and ends at 0 V, which a driver from 5 to inf V cannot give"),
        (
            DriverLimits(shortest_us=30),
            r"no t1 of the search box, 1e-06 to 2e-05 s, .* the least that it can do is 3e-05",
        ),
        (DriverLimits(step_us=25), "no t1 of the search box, 1e-06 to 2e-05 s"),
        (DriverLimits(longest_us=4), "the shortest waveform of the search box lasts 5 us, longer than longest_us, 4"),
    ],
)
def test_a_box_without_any_legal_waveform_is_refused(limits, said):
    with pytest.raises(ValueError, match=said):
        Bounds(limits=limits)


def test_a_box_that_asks_for_more_voltage_than_there_is_is_refused():
    lower = (60.0, -100.0, *[1e-6] * 5)
    with pytest.raises(ValueError, match="no U1 of the search box, 60 to 100 V, is within"):
        Bounds(lower=lower, limits=DriverLimits(highest_V=48))
    with pytest.raises(ValueError, match=r"no t1 of the search box, 1e-06 to 2e-05 s, .* 6e-05 s"):
        Bounds(lower=lower, limits=DriverLimits(rise_V_per_us=1))


def test_the_longest_waveform_is_told():
    assert Bounds().longest_s == pytest.approx(100e-6)
    assert Bounds(limits=DriverLimits(longest_us=40)).longest_s == pytest.approx(40e-6)
    assert math.isclose(Bounds(limits=DriverLimits()).longest_s, 100e-6)


def test_waveforms_in_steps_have_no_derivative():
    with pytest.raises(ValueError, match="no derivative"):
        Bounds(limits=DriverLimits()).slope(np.zeros(7))
