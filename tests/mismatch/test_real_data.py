"""A measured head with a hidden cubic spring is diagnosed; the recordings are kept outside the project."""

import numpy as np
import pytest

from inkjet_env.mismatch import diagnose
from inkjet_env.recordings import Campaign, Recording
from tests.real_data import real_campaign

SAMPLES = 700


@pytest.fixture(scope="module")
def diagnosed():
    """Three stretches of measured multisines, the last one held out."""
    whole, recordings = real_campaign("silverbox"), []
    for name in ("m04", "m05", "m06"):
        r = whole[name]
        cut = (samples[:SAMPLES] for samples in (r.time_s, r.drive_V, r.sensor))
        recordings.append(Recording(name, *cut, r.unit, r.channel, r.excitation, "free", r.order))
    return diagnose(Campaign("silverbox", tuple(recordings)), held_out=["m06"], workers=1)


def test_the_silverboxs_cubic_spring_is_named_out_of_the_whole_catalogue(diagnosed):
    assert diagnosed.verdict == "named"
    assert [named.effect.id for named in diagnosed.effects] == ["cubic_stiffness"]
    assert diagnosed.effects[0].parameters["stiffening_per_V2"].low > 0  # a spring that hardens


def test_a_stretch_that_no_fit_has_seen_is_predicted_to_a_few_tenths_of_the_models_error(diagnosed):
    base, augmented = diagnosed.heldout_rms("base"), diagnosed.heldout_rms("augmented")
    (held_out,) = [recording for recording in diagnosed.recordings if recording.held_out]
    assert augmented < 0.3 * base
    assert augmented < 0.04 * np.std(held_out.measured) / abs(diagnosed.gains["displacement"])
    assert diagnosed.closure > 0.9
    assert diagnosed.location.recordings
