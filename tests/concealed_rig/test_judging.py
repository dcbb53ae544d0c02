"""What judges a model on what nobody saw: fresh drives, the response, the peak cost, and where the mismatch is."""

import numpy as np
import pytest

from experiments.concealed_rig import Case, build
from experiments.concealed_rig.head import Head
from experiments.concealed_rig.location import location, shortest_run
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.peak_cost import averaged_polyline_V, firing, peak_cost, peaks_V
from experiments.concealed_rig.plant import Plant, trace

WAVEFORM = np.array([80.0, -70.0, 2e-6, 9e-6, 4e-6, 11e-6, 7e-6])


def cost_of(plant, waveform, per_period):
    row = firing(waveform, plant.head.resonance_Hz, plant.head.damping_ratio, 1, per_period)
    return peaks_V(trace(plant, row).signal - plant.head.self_sensing_offset_V, row.step_s, 2 * row.step_s)


class Published(Head):
    """The density of the published branch law, p(r) = 2Q''(2r), continued by its tangent (no plays) beyond 180 V."""

    def density_per_V(self, threshold_V):
        q = [19.014, -75.155, 120.8, -101.21, 46.92, -11.697, 1.5782, 0.74743, 0.0]
        return np.where(threshold_V < 90, np.polyval(np.polyder(q, 2), np.minimum(threshold_V / 90, 1.0)), 0.0)


def test_the_published_heads_best_waveform_costs_what_is_known_of_it():
    """Left: the distance of 600 plays, 6e-4 V, and a rest that leaves 1e-4 of the vibration, 2e-4 V."""
    a0, a1 = 1.055e11, 3.046e4
    loop = 180 * (0.99763 - 0.74743)
    head = Published(
        np.sqrt(a0) / 2 / np.pi, a1 / 2 / np.sqrt(a0), 1.907e4, 1.0, 0.0, 0.0, 1.0, 0.0, 0.74743, loop, "published", ()
    )
    peaks = cost_of(Plant(head), np.array([100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6]), 500)
    np.testing.assert_allclose(peaks[:5], [6.1912, -6.9447, 0.6548, -0.5233, 1.9039], rtol=0, atol=1e-3)
    assert peak_cost(peaks) == pytest.approx(-22.8301, abs=1.5e-3)


@pytest.mark.parametrize("effect", [(), ("ferroelastic_softening",), ("second_mode",)])
def test_the_peak_costs_grid_is_fine_enough(effect):
    built = build(Case(0, 70, "effect" if effect else "null", effect, "strong" if effect else None, meagre=True))
    coarse, fine = (cost_of(built.plant, WAVEFORM, n) for n in (500, 3000))
    assert coarse.size == fine.size
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=1e-4 * np.max(np.abs(fine)))
    assert peak_cost(coarse) == pytest.approx(peak_cost(fine), rel=1e-4)
    assert built.peak_cost(WAVEFORM) == peak_cost(coarse)


def test_the_cost_is_a_sum_over_peaks_with_the_largest_and_its_follower_weighted():
    assert peak_cost(np.array([1.0, -4.0, 2.0, -0.5])) == pytest.approx(1 - 20 + 10 + 0.5)
    assert peak_cost(np.array([1.0, -4.0])) == pytest.approx(1 - 20)
    assert peak_cost(np.array([])) == 0.0


def test_parabolas_find_the_peaks_of_a_tone_between_its_samples():
    t = np.arange(4000) * 1e-7
    found = peaks_V(3 * np.sin(2 * np.pi * 5e4 * t + 0.3), 1e-7, 0.0)
    assert found.size == 35
    np.testing.assert_allclose(np.abs(found), 3.0, rtol=4e-8)  # (ω·step)⁴/512


def test_an_averaged_polyline_keeps_lines_and_areas():
    corners, levels = np.array([1.03e-6, 2.51e-6, 7.77e-6, 9.9e-6]), np.array([0.0, 50.0, 50.0, 0.0])
    drive = averaged_polyline_V(corners, levels, 120, 1e-7)
    assert drive[50] == pytest.approx(50.0, abs=1e-12)
    assert drive.sum() * 1e-7 == pytest.approx(np.trapezoid(levels, corners), rel=1e-13)


@pytest.mark.parametrize(
    ("waveform", "message"),
    [
        (WAVEFORM[:6], "seven finite numbers"),
        (WAVEFORM * [-1, 1, 1, 1, 1, 1, 1], "U1 ≥ 0"),
        (WAVEFORM * [1, 1, 0, 1, 1, 1, 1], "above 0 s"),
    ],
)
def test_a_waveform_that_is_none_is_refused(waveform, message):
    with pytest.raises(ValueError, match=message):
        firing(waveform, 5e4, 0.05, 1)


def test_the_response_is_the_recordings_clean_signal_and_comes_after_the_last_one():
    built = build(Case(4, 71, "effect", ("air_bubble",), "strong"))
    row = built.setup.rows[-1]
    again = built.response(row.drive_V, row.step_s, row.channel, row.initial_state)
    np.testing.assert_array_equal(again, trace(built.plant, row).signal)
    with pytest.raises(ValueError, match="channel must be one of"):
        built.response(row.drive_V, row.step_s, "ear")
    with pytest.raises(ValueError, match="finite"):
        built.response(np.array([0.0, np.nan]), row.step_s)


def test_fresh_drives_are_of_no_campaign_and_within_its_voltages():
    built = build(Case(5, 72, displacement=True))
    fresh = built.fresh_drives(np.random.default_rng(1))
    assert {row.channel for row in fresh} == {"self_sensing", "strain_gauge", "displacement"}
    for row in fresh:
        assert np.max(np.abs(row.drive_V)) <= 105
        assert np.ptp(row.drive_V) > 10
        assert np.all(np.isfinite(built.response(row.drive_V, row.step_s, row.channel, row.initial_state)))
        for seen in built.setup.rows:
            if seen.channel == row.channel:
                assert seen.drive_V.size != row.drive_V.size or np.max(np.abs(seen.drive_V - row.drive_V)) > 5
    other = built.fresh_drives(np.random.default_rng(2))
    assert np.max(np.abs(other[0].drive_V - fresh[0].drive_V)) > 1


def test_half_of_the_power_is_within_the_shortest_run():
    power = np.array([1.0, 0.0, 5.0, 6.0, 0.0, 4.0])
    assert shortest_run(power) == (2, 3)
    assert shortest_run(np.array([0.0, 0.0, 9.0, 1.0])) == (2, 2)
    assert shortest_run(np.ones(10)) in {(k, k + 4) for k in range(6)}


def test_a_mismatch_is_found_where_it_was_put():
    t = np.arange(2000) * 1e-6
    drive = np.interp(t, [4e-4, 5e-4, 6e-4], [0, 60, 0])
    rows = [Measurement("self_sensing", "arbitrary", "periodic", 1e-6, drive, order=k) for k in (1, 2)]
    burst = np.exp(-(((t - 5e-4) / 5e-5) ** 2)) * np.sin(2 * np.pi * 9e4 * t)
    found = location(rows, [np.zeros(2000), burst])
    assert found["recordings"] == ["r002"]
    (detail,) = found["details"]
    # Half of a Gauss bell is within 0.6745 σ; the power's σ is τ/2 in time and 1/2πτ in frequency. Left: the samples,
    # the lines, and where among equally short runs the first one is, within a quarter of its length.
    for found_range, centre, sigma, step in (
        (detail["time_s"], 5e-4, 2.5e-5, 1e-6),
        (detail["frequency_Hz"], 9e4, 1 / (2 * np.pi * 5e-5), 250.0),
    ):
        length = 2 * 0.6745 * sigma
        assert np.ptp(found_range) == pytest.approx(length, abs=1.5 * step)
        assert np.mean(found_range) == pytest.approx(centre, abs=length / 4)
    assert detail["drive_V"][1] == pytest.approx(60, abs=1e-9)
    assert location(rows, [np.zeros(2000)] * 2)["recordings"] == []
