"""Whether recordings are still those of a head: what counts, what does not, and what is said."""

import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification import evaluate
from inkjet_env.identification.agreement import TOLERANCE, agreement_sentence, agreements
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign
from inkjet_env.rig import record_campaign

HEAD = Printhead.published()


def agreed(head, campaign, its_own=None):
    return agreements(campaign, evaluate(campaign, head)[0], its_own)


@pytest.fixture(scope="module")
def warmer():
    """Campaigns of a head that rings a thousandth and a hundredth faster, by that factor."""
    return {factor: record_campaign(HEAD.varied(HEAD.frequency_Hz * factor), 3) for factor in (1.001, 1.01)}


@pytest.mark.parametrize("snr_dB", [20, 45, 80])
def test_a_head_that_has_not_changed_is_still_the_same_whatever_the_noise(snr_dB):
    found = agreed(HEAD, record_campaign(HEAD, 7, snr_dB=snr_dB))
    assert not any(one.differs for one in found)
    assert max(one.share for one in found if one.output_rms > 5 * one.noise_rms) < 0.5 * TOLERANCE or snr_dB == 20
    assert agreement_sentence(found).startswith(f"Yes, this is still the same head: it predicts all {len(found)} ")


def test_a_head_that_rings_a_hundredth_faster_is_another_and_a_thousandth_does_not_count(warmer):
    assert not any(one.differs for one in agreed(HEAD, warmer[1.001]))
    found = agreed(HEAD, warmer[1.01])
    ringing = [one for one in found if one.differs]
    assert len(ringing) > 10
    assert all(one.share > TOLERANCE for one in ringing)
    strain = {r.name for r in warmer[1.01].recordings if r.channel == "strain_gauge"}
    assert not strain & {one.name for one in ringing}  # slow loops do not show the resonance
    told = agreement_sentence(found)
    worst = max(ringing, key=lambda one: one.share)
    assert told.startswith("No, this is not the same head, or it has changed: ")
    assert f"{worst.name} ({100 * worst.share:.2g} %)" in told
    assert f"and {len(ringing) - 3} more." in told


def test_what_the_head_left_when_it_was_identified_does_not_count(warmer):
    worst = max(one.beyond for one in agreed(HEAD, warmer[1.01]))
    assert not any(one.differs for one in agreed(HEAD, warmer[1.01], {"self_sensing": worst / 2}))
    assert any(one.differs for one in agreed(HEAD, warmer[1.01], {"self_sensing": worst / 30}))
    assert any(one.differs for one in agreed(HEAD, warmer[1.01], {"strain_gauge": worst}))


def test_without_repeats_all_of_the_residual_counts(warmer):
    single = next(r for r in warmer[1.01].recordings if r.channel == "self_sensing" and np.ptp(r.drive_V) > 80)
    (found,) = agreed(HEAD, Campaign("one", (replace(single, repeat_of=None, initial_state="periodic"),)))
    assert math.isnan(found.noise_rms)
    assert found.beyond == found.rms
    assert "(no repeats show the noise, so all of it counts)" in agreement_sentence([found])


def test_noise_and_residuals_of_a_displacement_are_in_its_own_unit():
    from inkjet_env.rig import displacement_battery

    campaign = record_campaign(HEAD, 0, battery=displacement_battery(HEAD.frequency_Hz))
    nanometres = Campaign("nm", tuple(replace(r, sensor=1e3 * r.sensor, unit="nm") for r in campaign.recordings))
    for one, thousandfold in zip(agreed(HEAD, campaign), agreed(HEAD, nanometres), strict=True):
        assert thousandfold.noise_rms == pytest.approx(1e3 * one.noise_rms, rel=1e-6)
        assert thousandfold.differs == one.differs
