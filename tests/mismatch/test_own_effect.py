"""An effect of a user's own takes part in a diagnosis."""

from dataclasses import replace

import numpy as np

from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.plant import Effect, Parameter, Plant
from inkjet_env.recordings import Campaign
from tests.mismatch.diagnoses import ids


class WindUp(Effect):
    """Not of the catalogue: the sensor hears the integral of its own signal."""

    id, stage = "wind_up", "sensing"
    sentence = "The sensor's integrator leaks into its output."
    equation, source, signature, shown_by = "y = y₀ + k ∫ y₀ dt", "a test", "a slope after each pulse", "any pulse"
    parameters = (Parameter("leak_per_s", "1/s", -1e6, 1e6),)
    strengths = ("leak_per_s",)

    def starts(self, printhead, excitations):
        return [{"leak_per_s": 0.05 * printhead.frequency_Hz}]

    def sensing(self, values, signal, drive_V, printhead, excitation):
        if excitation.channel != "self_sensing":
            return signal
        return signal + values["leak_per_s"] * excitation.step_s * np.cumsum(signal - signal.mean())


def with_wind_up(campaign, true_head, leak_per_s):
    """The campaign with the sensor's leak in it."""
    head, recordings = true_head(campaign), []
    for o, recording in zip(observe(campaign), campaign.recordings, strict=True):
        plain = Plant(head.printhead, head.gains, head.offsets)
        leaking = plain.with_effects([(WindUp(), {"leak_per_s": leak_per_s})])
        recordings.append(
            replace(recording, sensor=recording.sensor + leaking.signal(o.excitation) - plain.signal(o.excitation))
        )
    return Campaign("leaking", tuple(recordings))


def test_an_effect_of_ones_own_takes_part_and_is_named(recorded, true_head, head, effects):
    campaign = with_wind_up(recorded(), true_head, 2e3)
    catalogued = [effects[name] for name in ("feedthrough", "quadratic_damping")]
    found = diagnose(campaign, head, [*catalogued, WindUp()], workers=1)
    assert (found.verdict, ids(found)) == ("named", ["wind_up"])
    estimate = found.effects[0].parameters["leak_per_s"]
    assert estimate.low < 2e3 < estimate.high
    assert estimate.high - estimate.low < 0.12 * 2e3
    assert found.as_json()["effects"][0]["parameters"]["leak_per_s"]["unit"] == "1/s"
    assert WindUp.sentence in found.headline
    without = diagnose(campaign, head, catalogued, workers=1)
    assert without.verdict == "unknown"
