"""A head with effects on recordings: simulated as the plant does, and nothing of it refitted."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification import evaluate
from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.effect import complete
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.rig import default_battery, displacement_battery, record_campaign

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
STEP_S = 2e-7
TIME_S = STEP_S * np.arange(2000)
DRIVE_V = np.interp(TIME_S, [0, 1e-4, 1.02e-4, 2e-4, 2.03e-4], [-40, -40, 50, 50, 0])
CUBIC = EFFECTS["cubic_stiffness"]


def recorded(effects, channel="self_sensing", initial_state="demagnetised", gain=1.0, offset=0.0, start=(0.0, 0.0)):
    excitation = Excitation(channel, initial_state, STEP_S, DRIVE_V, start=start)
    signal = Plant(HEAD, {channel: gain}, {channel: offset}, effects).signal(excitation)
    unit = "V" if channel == "self_sensing" else "um"
    return Recording("r", TIME_S, DRIVE_V, signal, unit, channel, initial_state=initial_state)


def middling(effect):
    return effect.starts(HEAD, [Excitation("self_sensing", "demagnetised", STEP_S, DRIVE_V)])[0]


def test_without_effects_the_evaluation_is_the_base_heads():
    battery = (*default_battery(HEAD.frequency_Hz), *displacement_battery(HEAD.frequency_Hz))
    campaign = record_campaign(HEAD, 0, battery=battery, snr_dB=60)
    base, base_refitted = evaluate(campaign, HEAD)
    found, refitted = evaluate(campaign, AugmentedPrinthead(HEAD, ()))
    assert refitted == base_refitted
    for mine, other in zip(found, base, strict=True):
        assert mine.rms == pytest.approx(other.rms, rel=1e-3, abs=1e-4 * other.output_rms)


def test_the_effects_explain_what_the_base_head_leaves():
    effects = ((CUBIC, middling(CUBIC)), (EFFECTS["feedthrough"], complete(EFFECTS["feedthrough"], capacitive_s=5e-9)))
    campaign = Campaign("c", (recorded(effects, offset=0.2),))
    (found,), _ = evaluate(campaign, AugmentedPrinthead(HEAD, effects))
    (left,), _ = evaluate(campaign, HEAD)
    assert found.rms < 1e-9 * found.output_rms
    assert found.offset == pytest.approx(0.2)
    assert left.rms > 0.01 * left.output_rms


@pytest.mark.parametrize("start", [(-30.0, 0.0), (8.0, -12.0)])
def test_a_free_initial_state_of_a_nonlinear_head_is_found(start):
    values = middling(CUBIC)
    recording = recorded(((CUBIC, values),), initial_state="free", offset=0.1, start=start)
    (found,), _ = evaluate(Campaign("c", (recording,)), AugmentedPrinthead(HEAD, ((CUBIC, values),)))
    assert found.rms < 1e-6 * found.output_rms
    told_otherwise = replace(recording, initial_state="demagnetised")
    (found,), _ = evaluate(Campaign("c", (told_otherwise,)), AugmentedPrinthead(HEAD, ((CUBIC, values),)))
    assert found.rms > 0.01 * found.output_rms


def test_the_gain_is_the_augmented_heads_and_fitted_where_it_has_none():
    campaign = Campaign("c", (recorded((), "displacement", gain=2.5e-3, offset=0.7),))
    (known,), refitted = evaluate(campaign, AugmentedPrinthead(HEAD, (), {"displacement": 2e-3}))
    assert refitted == ()
    assert known.rms > 0.1 * np.std(known.recording.sensor)
    (fitted,), refitted = evaluate(campaign, AugmentedPrinthead(HEAD, ()))
    assert refitted == ("displacement",)
    assert fitted.rms < 1e-9


def test_a_hum_explains_nothing_by_itself():
    hum = (EFFECTS["mains_hum"], {"frequency_Hz": 4e3, "multiples": 1.0, "amplitude": 0.5})
    recording = recorded(())
    recording = replace(recording, sensor=recording.sensor + 0.5 * np.sin(2 * np.pi * 4e3 * TIME_S + 1))
    (found,), _ = evaluate(Campaign("c", (recording,)), AugmentedPrinthead(HEAD, (hum,)))
    assert found.rms > 0.3
