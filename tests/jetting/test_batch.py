"""Figures of merit of many waveforms: those of each response."""

import math

import numpy as np
import pytest

from inkjet_env.jetting import jetting
from inkjet_env.jetting.batch import jetting_batch
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform, batch

HEAD = Printhead.published()
SLOW = HEAD.varied(frequency_Hz=37e3, damping_ratio=0.03, gain=0.8)


@pytest.mark.parametrize("head", [HEAD, SLOW])
@pytest.mark.parametrize("cost", [PeakCost(), PeakCost(effective="first"), PeakCost(effective=3.0)])
@pytest.mark.parametrize("settings", [{}, {"initial_state": "demagnetised", "window_s": 120e-6}])
def test_they_are_those_of_each_response(head, cost, settings):
    rows = Bounds().from_unit(np.random.default_rng(0).uniform(-1, 1, (40, 7)))
    found = jetting_batch(rows, head, cost, **settings)
    single = [jetting(head.respond(Waveform.from_array(row), **settings), cost) for row in rows]
    for name in found._fields:
        np.testing.assert_allclose(
            getattr(found, name), [getattr(one, name) for one in single], rtol=2e-8, err_msg=name
        )
    np.testing.assert_allclose(found.residual, [one.residual for one in single], rtol=1e-9)


def test_the_response_is_at_the_level_when_it_has_settled():
    rows = Bounds().from_unit(np.random.default_rng(1).uniform(-1, 1, (50, 7)))
    found = jetting_batch(rows, HEAD)
    for row, settling_s, effective_V in zip(rows, found.settling_s, found.effective_V, strict=True):
        response = HEAD.respond(Waveform.from_array(row))
        assert abs(response.sensor_V(settling_s)) == pytest.approx(0.05 * effective_V, rel=1e-6)
        later = np.linspace(settling_s + 1e-9, 350e-6, 2000)
        assert np.abs(response.sensor_V(later)).max() < 0.05 * effective_V


def test_a_waveform_of_nothing_has_no_figures():
    found = jetting_batch([[0, 0, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6]], HEAD)
    assert np.isnan(found).all()


def test_one_head_for_each_waveform():
    rows = np.tile(Bounds().from_unit(np.zeros(7)), (2, 1))
    found = jetting_batch(rows, batch.head_table([HEAD, SLOW]))
    assert found.effective_V[0] == jetting_batch(rows[:1], HEAD).effective_V[0]
    assert found.effective_V[1] == jetting_batch(rows[:1], SLOW).effective_V[0]
    assert math.isclose(found.highest_Hz[0], 1 / max(found.settling_s[0], rows[0, 2:].sum()))
