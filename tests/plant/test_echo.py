"""A signal delayed by any time, against shifts, cubics and lags of it."""

import numpy as np
import pytest

from inkjet_env.plant.echo import returned
from inkjet_env.plant.lag import lagged


def test_a_delay_of_whole_samples_is_exact_and_any_other_cubic():
    signal = np.random.default_rng(1).normal(size=40)
    assert returned(signal, 3.0, True) == pytest.approx(np.roll(signal, 3), abs=1e-15)
    assert returned(signal, -2.0, True) == pytest.approx(np.roll(signal, -2), abs=1e-15)
    assert returned(signal, 3.0, False) == pytest.approx(np.append(np.full(3, signal[0]), signal[:-3]), abs=1e-15)
    t = np.linspace(-1, 1, 40)
    moved = returned(2 * t**3 - t, 2.3, False)
    earlier = t - 2.3 * (t[1] - t[0])
    assert moved[6:] == pytest.approx((2 * earlier**3 - earlier)[6:], abs=1e-13)


@pytest.mark.parametrize("periodic", [False, True])
def test_what_was_at_two_ends_is_lagged_twice(periodic):
    signal = np.random.default_rng(2).normal(size=50)
    late = returned(signal, 4.3, periodic)
    assert returned(signal, 4.3, periodic, 2).tolist() == late.tolist()  # ends without loss
    twice = lagged(lagged(late, 7.0, 1.0, periodic), 7.0, 1.0, periodic)
    assert returned(signal, 4.3, periodic, 2, 7.0) == pytest.approx(twice, abs=1e-14)
    if periodic:  # in the steady state, the same wherever one begins to count
        moved = returned(np.roll(signal, 9), 4.3, periodic, 2, 7.0)
        assert moved == pytest.approx(np.roll(twice, 9), abs=1e-13)
