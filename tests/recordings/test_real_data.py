"""Measured public campaigns, kept outside the project, are read."""

import numpy as np
import pytest

from inkjet_env.recordings import check_campaign
from tests.real_data import real_campaign


def test_the_piezo_actuator_is_uniform_where_its_printed_times_are_not():
    campaign = real_campaign("piezo-actuator")
    r = campaign["r001"]
    assert (r.channel, r.unit, r.initial_state) == ("displacement", "um", "demagnetised")
    assert r.step_s == pytest.approx(2e-4, rel=1e-7)
    assert np.ptp(np.diff(r.time_s)) < 1e-14
    (found,) = check_campaign(campaign)
    assert "within ±100 V" in found.message


def test_the_silverbox_has_eight_recordings_and_a_small_drive():
    campaign = real_campaign("silverbox")
    assert [r.name for r in campaign.recordings] == [f"m0{k}" for k in range(1, 9)]
    assert all(r.sample_rate_Hz == pytest.approx(610.35, rel=1e-5) for r in campaign.recordings)
    assert campaign.notes == ()
    assert all("where tens of volts are usual" in found.message for found in check_campaign(campaign))
