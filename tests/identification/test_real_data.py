"""Measured public campaigns, kept outside the project, are identified."""

import numpy as np
import pytest

from inkjet_env.identification import identify
from inkjet_env.recordings import Campaign, Recording
from tests.real_data import real_campaign


def test_a_measured_piezo_actuator_is_predicted_to_a_hundredth_of_its_stroke():
    whole = real_campaign("piezo-actuator")["r001"]

    def cut(name, start, end, state):
        part = slice(start, end)
        return Recording(
            name,
            whole.time_s[part],
            whole.drive_V[part],
            whole.sensor[part],
            whole.unit,
            whole.channel,
            "arbitrary",
            state,
        )

    periods = [cut(f"sine-{k}", 5000 * k, 5000 * (k + 1), "periodic") for k in (1, 2, 3)]
    campaign = Campaign("piezo", (cut("step", 1500, 2300, "demagnetised"), *periods))
    found = identify(campaign, held_out=["sine-3"])
    (held_out,) = found.heldout
    assert held_out.name == "sine-3"
    assert held_out.rms() < 0.0105 * np.std(held_out.measured)
    assert any(note.startswith("displacement: the residual is") for note in found.notes)  # creep, and more


def test_the_measured_silverbox_is_predicted_to_millivolts():
    campaign = real_campaign("silverbox")
    kept = Campaign(campaign.name, campaign.recordings[3:])
    found = identify(kept, held_out=["m08"])
    (held_out,) = found.heldout
    assert held_out.rms() < 7e-3
    assert np.std(held_out.measured) > 7 * held_out.rms()
    # Built for 68.6 Hz.
    assert np.sqrt(found.dynamics["a0"].value) / (2 * np.pi) == pytest.approx(69, abs=2)
