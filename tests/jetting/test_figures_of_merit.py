import math
from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.jetting.figures_of_merit import jetting
from inkjet_env.printhead import PeakCost, Printhead, Waveform, respond_sampled

HEAD = Printhead.published()


def a_response(peaks_V, times_s, end_s=20e-6):
    """Straight lines from peak to peak."""
    return SimpleNamespace(
        peaks_V=np.array(peaks_V),
        peak_times_s=np.array(times_s),
        knot_times_s=np.array([0.0, end_s]),
        sensor_V=lambda time_s: np.interp(time_s, times_s, peaks_V),
    )


def test_figures_are_those_worked_out_by_hand():
    found = jetting(a_response([1.0, -6.0, 2.0, -0.4, 0.1], [1e-5, 2e-5, 3e-5, 4e-5, 5e-5]), PeakCost())
    assert (found.effective_V, found.residual_V) == (6.0, 2.0)
    assert found.residual == pytest.approx(1 / 3)
    assert found.settling_s == pytest.approx(4.2e-5)  # from -0.4 V at 40 us to 0.1 V at 50 us it passes -0.3 V
    assert found.highest_Hz == pytest.approx(1 / 4.2e-5)


def test_no_drop_follows_before_the_waveform_has_ended():
    found = jetting(a_response([6.0, -0.1, 0.05], [5e-6, 1e-5, 2e-5], end_s=80e-6), PeakCost())
    assert found.highest_Hz == pytest.approx(12.5e3)


@pytest.mark.parametrize("count", [1, 2])
def test_what_nobody_saw_settle_has_no_highest_frequency(count):
    found = jetting(a_response([6.0, -3.0][:count], [5e-6, 1e-5][:count]), PeakCost())
    assert (found.settling_s, found.highest_Hz) == (math.inf, 0.0)


def test_no_effective_peak_has_no_figures():
    assert math.isnan(jetting(a_response([], []), PeakCost()).effective_V)


def test_a_free_ringing_settles_when_its_envelope_says():
    """After a step each half period keeps e^(-πζ/√(1-ζ²)): so many until 5 %."""
    response = HEAD.respond(Waveform(50, 0, 0.1e-6, 400e-6, 0.1e-6, 0, 0), window_s=390e-6)
    found = jetting(response, PeakCost(effective="first"))
    kept = math.exp(-math.pi * HEAD.damping_ratio / math.sqrt(1 - HEAD.damping_ratio**2))
    half_s = 0.5 / (HEAD.frequency_Hz * math.sqrt(1 - HEAD.damping_ratio**2))
    count = math.floor(math.log(0.05) / math.log(kept))
    last_s = response.peak_times_s[0] + count * half_s
    assert last_s < found.settling_s < last_s + half_s
    assert abs(response.sensor_V(found.settling_s)) == pytest.approx(0.05 * found.effective_V, rel=1e-6)
    assert found.residual == pytest.approx(kept, rel=1e-6)


@pytest.mark.parametrize("name", ["nominal", "slow-head", "augmented-mode"])
def test_what_has_settled_stays_below_a_twentieth_and_had_not_before(name):
    solved = problem(name)
    response = solved.respond(solved.bounds.to_unit(np.array(solved.best_known.waveform)))
    found = jetting(response, solved.cost)
    assert 0 < found.settling_s < 350e-6
    later_s = np.linspace(found.settling_s, 350e-6, 20_001)
    level_V = 0.05 * found.effective_V
    assert np.abs(response.sensor_V(later_s)).max() <= level_V * (1 + 1e-6)
    assert abs(response.sensor_V(found.settling_s - 0.1e-6)) > level_V


def test_a_sampled_drive_settles_when_its_waveform_does():
    """Whatever its first time is; between two peaks a half cosine is right to two hundredths of a period."""
    rng, found = np.random.default_rng(4), 0
    for point in rng.uniform(-1, 1, (40, 7)):
        solved = problem("nominal")
        waveform = Waveform.from_array(solved.bounds.from_unit(point))
        exact = jetting(HEAD.respond(waveform), solved.cost)
        time_s, drive_V = waveform.knots()
        sampled = respond_sampled(HEAD, [*(time_s + 0.3), 0.30035], [*drive_V, 0.0], window_s=350e-6)
        again = jetting(sampled, solved.cost)
        assert again.effective_V == pytest.approx(exact.effective_V, rel=1e-6)
        if exact.highest_Hz:
            found += 1
            assert again.settling_s == pytest.approx(exact.settling_s, abs=0.4e-6)
            assert again.highest_Hz == pytest.approx(exact.highest_Hz, rel=0.01)
    assert found > 20
