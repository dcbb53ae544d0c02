"""The paper's formula remembers one turning point: when that is exact, and when it is not."""

import numpy as np
import pytest

from inkjet_env.printhead import Bounds, Printhead, Waveform, batch
from inkjet_env.printhead.sampled import respond_sampled

HEAD = Printhead.published()


def test_one_point_memory_is_exact_in_periodic_firing():
    waveforms = Bounds().from_unit(np.random.default_rng(0).uniform(-1, 1, (300, 7)))
    full = batch.costs(waveforms, HEAD, hysteresis="full_memory")
    one = batch.costs(waveforms, HEAD, hysteresis="one_point")
    np.testing.assert_allclose(one, full, rtol=1e-12, atol=1e-12)


def share_lost_on_a_pulse_pair(second_V: float) -> float:
    """Largest error of one-point memory over the largest signal: a bipolar pulse of ±100 V, then one of ±second_V."""
    first, second = (Waveform(u, -u, 2e-6, 8e-6, 4e-6, 8e-6, 2e-6) for u in (100.0, second_V))
    knots_s = np.append(first.knots()[0], first.duration_s + second.knots()[0][1:])
    knots_V = np.append(first.knots()[1], second.knots()[1][1:])
    time_s = np.arange(2000) * 1e-7
    drive_V = np.interp(time_s, knots_s, knots_V)
    full, one = (respond_sampled(HEAD, time_s, drive_V, hysteresis=name) for name in ("full_memory", "one_point"))
    return float(np.abs(one.sensor_V - full.sensor_V).max() / np.abs(full.sensor_V).max())


def test_one_point_memory_is_wrong_for_a_pulse_pair_the_more_the_pulses_differ():
    """The second pulse is a minor loop in the first; the drive's return must go on along the branch it interrupted."""
    shares = [share_lost_on_a_pulse_pair(second_V) for second_V in (100.0, 80.0, 60.0, 40.0, 20.0)]
    np.testing.assert_allclose(shares, [0.0, 0.0057, 0.0120, 0.0239, 0.0439], atol=2e-4)


def test_one_point_memory_loses_the_virgin_curve():
    waveform = [100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6]
    full = batch.costs(waveform, HEAD, initial_state="demagnetised")[0]
    one = batch.costs(waveform, HEAD, initial_state="demagnetised", hysteresis="one_point")[0]
    assert full == pytest.approx(-20.9915, abs=1e-3)
    assert one == pytest.approx(-17.25, abs=1e-2)
