"""Campaigns of known truth, recorded once."""

from dataclasses import replace

import pytest

from inkjet_env.identification import identify
from inkjet_env.printhead import Printhead
from inkjet_env.rig import record_campaign

OTHER_HEAD = Printhead.published().varied(60e3, 0.07, 1.2, 0.7)


def _changed(campaign, change):
    """The campaign with every sensor's signal as ``change(recording)`` says."""
    return replace(campaign, recordings=tuple(replace(r, sensor=change(r)) for r in campaign.recordings))


@pytest.fixture(scope="session")
def changed():
    return _changed


@pytest.fixture(scope="session")
def other_head():
    return OTHER_HEAD


@pytest.fixture(scope="session")
def published_campaign():
    return record_campaign(Printhead.published(), 0)


@pytest.fixture(scope="session")
def published_found(published_campaign):
    return identify(published_campaign)


@pytest.fixture(scope="session")
def other_campaign():
    return record_campaign(OTHER_HEAD, 1, snr_dB=40)


@pytest.fixture(scope="session")
def other_found(other_campaign):
    return identify(other_campaign)
