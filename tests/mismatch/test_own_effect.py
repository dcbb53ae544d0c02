"""An effect of a user's own takes part in a diagnosis."""

from dataclasses import replace

from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.plant import Plant
from inkjet_env.recordings import Campaign
from tests.mismatch.diagnoses import ids
from tests.mismatch.leak import Leak


def with_leak(campaign, true_head, leak_per_s):
    """The campaign with the sensor's leak in it."""
    head, recordings = true_head(campaign), []
    for o, recording in zip(observe(campaign), campaign.recordings, strict=True):
        plain = Plant(head.printhead, head.gains, head.offsets)
        leaking = plain.with_effects([(Leak(), {"leak_per_s": leak_per_s})])
        recordings.append(
            replace(recording, sensor=recording.sensor + leaking.signal(o.excitation) - plain.signal(o.excitation))
        )
    return Campaign("leaking", tuple(recordings))


def test_an_effect_of_ones_own_takes_part_and_is_named(recorded, true_head, head, effects):
    campaign = with_leak(recorded(), true_head, 2e3)
    catalogued = [effects[name] for name in ("feedthrough", "quadratic_damping")]
    found = diagnose(campaign, head, [*catalogued, Leak()], workers=1)
    assert (found.verdict, ids(found)) == ("named", ["leak"])
    estimate = found.effects[0].parameters["leak_per_s"]
    assert estimate.low < 2e3 < estimate.high
    assert estimate.high - estimate.low < 0.12 * 2e3
    assert found.as_json()["effects"][0]["parameters"]["leak_per_s"]["unit"] == "1/s"
    assert Leak.sentence in found.headline
    without = diagnose(campaign, head, catalogued, workers=1)
    assert without.verdict == "unknown"
