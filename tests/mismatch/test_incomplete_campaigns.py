"""Campaigns that lack recordings, repeats, a channel or their states: what a diagnosis makes of them."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification import UnidentifiableError
from inkjet_env.mismatch import Diagnosis, diagnose
from inkjet_env.recordings import Campaign
from inkjet_env.storage import json_text
from tests.mismatch.diagnoses import ids


def only(campaign, chosen):
    recordings = [r for r in campaign.recordings if chosen(r)]
    names = {r.name for r in recordings}
    return Campaign(
        "cut", tuple(replace(r, repeat_of=r.repeat_of if r.repeat_of in names else None) for r in recordings)
    )


@pytest.mark.parametrize("name", [(), ("quadratic_damping",)])
def test_without_a_strain_gauge_it_works(name, recorded, head, effects):
    campaign = only(recorded(*name), lambda r: r.channel == "self_sensing")
    found = diagnose(campaign, head, [effects["quadratic_damping"], effects["feedthrough"]], workers=1)
    assert ids(found) == list(name)


def test_without_repeats_and_without_rest_it_works_and_says_what_it_took_for_noise(recorded, head, effects):
    campaign = recorded("quadratic_damping")
    campaign = only(campaign, lambda r: r.repeat_of is None and np.ptp(r.drive_V) > 0)
    found = diagnose(campaign, head, [effects["quadratic_damping"], effects["feedthrough"]], workers=1)
    assert (found.verdict, ids(found)) == ("named", ["quadratic_damping"])
    assert any("the noise is unknown without repeats or recordings at rest" in note for note in found.notes)


def test_one_recording_is_enough_and_nothing_held_out_is_no_figure(recorded, head, effects):
    campaign = only(recorded(), lambda r: r.excitation == "bipolar")
    one = Campaign("one", campaign.recordings[:1])
    found = diagnose(one, head, [effects["quadratic_damping"], effects["feedthrough"]], workers=1)
    assert isinstance(found, Diagnosis)
    assert found.verdict == "none"
    assert found.as_json()["fit"]["heldout"] == []
    assert found.as_json()["fit"]["base_heldout_rms_V"] is None
    json_text(found.as_json())


def test_recordings_at_rest_alone_are_refused_in_one_sentence(recorded):
    campaign = only(recorded(), lambda r: r.excitation == "zero")
    with pytest.raises(UnidentifiableError, match="has no recording to identify a0, a1 and b1 from"):
        diagnose(campaign, workers=1)


def test_what_the_recordings_cannot_show_is_said_with_why(diagnosed, effects, recorded, head):
    found = diagnose(recorded(), head, [effects["crosstalk"], effects["feedthrough"]], workers=1)
    assert found.untestable.keys() == {"crosstalk"}
    assert "neighbour" in found.untestable["crosstalk"]


def test_no_physics_is_blamed_while_what_had_gone_before_is_in_doubt(recorded, effects):
    campaign = recorded()
    doubtful = replace(
        campaign,
        recordings=tuple(
            replace(r, initial_state="free") if (r.channel, r.initial_state) == ("self_sensing", "periodic") else r
            for r in campaign.recordings
        ),
    )
    found = diagnose(doubtful, effects=[effects["thermal_drift"]], workers=1)
    assert (found.verdict, found.effects) == ("unknown", ())
    assert "set the initial state to periodic" in found.headline
