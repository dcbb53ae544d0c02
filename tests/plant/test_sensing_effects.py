"""What the sensing effects add to a recording, against ways of computing it that share no code with them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.effect import complete, switched_off
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PERIOD_S = 1 / HEAD.frequency_Hz
EFFECTS = {effect.id: effect for effect in catalogue()}
KNOTS = np.array([0, 0.1, 0.6, 0.8, 1.3, 1.5])  # of a bipolar trapezoid, in periods
VOLTS = np.array([0, 80.0, 80.0, -60.0, -60.0, 0])


def trapezoid(time_s):
    return np.interp(time_s / PERIOD_S, KNOTS, VOLTS)


def shot_of(drive=trapezoid, per_period=100, periods=6, channel="self_sensing", initial_state="demagnetised", **kwargs):
    step_s = PERIOD_S / per_period
    drive_V = drive(np.arange(int(per_period * periods)) * step_s)
    return Excitation(channel, initial_state, step_s, drive_V, **kwargs)


def added(effect_id, values, excitation):
    """What an effect adds to what the base model shows."""
    base = Plant(HEAD)
    on = base.with_effects([(EFFECTS[effect_id], complete(EFFECTS[effect_id], **values))])
    return on.signal(excitation) - base.signal(excitation)


# feedthrough


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic"])
@pytest.mark.parametrize("substeps", [2, 4])
def test_feedthrough_is_the_mean_slope_and_the_drive(initial_state, substeps):
    excitation = shot_of(initial_state=initial_state, substeps=substeps)
    slope = np.gradient(excitation.drive_V, excitation.step_s)
    if initial_state == "periodic":
        around = np.concatenate([excitation.drive_V[-1:], excitation.drive_V, excitation.drive_V[:1]])
        slope = (around[2:] - around[:-2]) / (2 * excitation.step_s)
    expected = 3e-9 * slope + 2e-3 * excitation.drive_V
    assert added("feedthrough", {"capacitive_s": 3e-9, "lossy": 2e-3}, excitation) == pytest.approx(expected, abs=1e-12)


def test_feedthrough_through_a_resistance_is_behind_by_its_lag():
    """On a long ramp the current is the slope's; a step charges the capacitance with its time constant."""
    excitation = shot_of()
    step = np.interp(np.arange(600), [100, 101], [0.0, 50.0])
    lag_s = 6 * excitation.step_s
    heard = added("feedthrough", {"capacitive_s": 1e-8, "lag_s": lag_s}, replace(excitation, drive_V=step, cache={}))
    times_s = excitation.step_s * (np.arange(600) - 100.5)
    expected = 1e-8 * 50 / lag_s * np.exp(-times_s / lag_s)
    assert heard[110:140] == pytest.approx(expected[110:140], rel=3e-3)
    assert np.trapezoid(heard, dx=excitation.step_s) == pytest.approx(1e-8 * 50, rel=1e-3)


def test_feedthrough_does_not_reach_a_displacement():
    excitation = shot_of(channel="displacement")
    assert not added("feedthrough", {"capacitive_s": 3e-9, "lossy": 2e-3}, excitation).any()


def test_feedthrough_follows_a_curved_drive_with_the_nodes_not_the_samples():
    class Rounded(type(EFFECTS["feedthrough"])):
        stage = "drive"

        def drive(self, values, drive_V, excitation):
            return np.sin(2 * np.pi * excitation.time_s / (8 * excitation.step_s))

    effect, errors = EFFECTS["feedthrough"], []
    for substeps in (2, 4, 8):
        excitation = shot_of(substeps=substeps)
        plant = Plant(HEAD, effects=((Rounded(), {}),))
        whole = plant.with_effects([*plant.effects, (effect, complete(effect, capacitive_s=1e-9))])
        rate = 2 * np.pi / (8 * excitation.step_s)
        exact = 1e-9 * rate * np.cos(rate * np.arange(excitation.samples) * excitation.step_s)
        errors.append(np.abs((whole.signal(excitation) - plant.signal(excitation) - exact)[1:-1]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.1)


# sensor bandwidth


def low_pass_error(per_period, bandwidth_Hz, initial_state="demagnetised"):
    """Largest error of the filtered signal, of the signal's largest, against a far finer simulation filtered."""
    effect = (EFFECTS["sensor_bandwidth"], {"bandwidth_Hz": bandwidth_Hz, "second_order": 0.0})
    fine = 4000
    coarse = shot_of(drive=smooth, per_period=per_period, initial_state=initial_state)
    excitation = shot_of(drive=smooth, per_period=fine, initial_state=initial_state)
    signal = Plant(HEAD).signal(excitation)
    w = 2 * np.pi * bandwidth_Hz
    time_s = np.arange(signal.size) * excitation.step_s
    if initial_state == "periodic":
        tones = np.fft.rfftfreq(signal.size, excitation.step_s)
        exact = np.fft.irfft(np.fft.rfft(signal) / (1 + 1j * tones / bandwidth_Hz), signal.size)
    else:
        exact = lsim(([w], [1, w]), signal - signal[0], time_s)[1] + signal[0]
    stride = fine // per_period
    # the base model on few samples is another drive; what is compared is the filter alone
    kept = EFFECTS["sensor_bandwidth"].sensing(effect[1], signal[::stride], None, HEAD, coarse)
    return np.abs(kept - exact[::stride]).max() / np.abs(signal).max()


def smooth(time_s):
    return 80 * np.sin(2 * np.pi * time_s / (6 * PERIOD_S)) ** 3


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic"])
@pytest.mark.parametrize(("per_period", "allowed"), [(10, 1e-3), (20, 1e-4), (100, 1e-6)])
def test_low_pass_of_a_fast_sensor_is_that_of_the_signal_between_samples_too(per_period, allowed, initial_state):
    assert low_pass_error(per_period, 2 * HEAD.frequency_Hz, initial_state) < allowed


def test_low_pass_leaves_the_offset_and_the_strain_gauge_alone():
    rest = shot_of(drive=np.zeros_like)
    plant = Plant(
        HEAD,
        offsets={"self_sensing": 0.7},
        effects=((EFFECTS["sensor_bandwidth"], {"bandwidth_Hz": 1e4, "second_order": 0.0}),),
    )
    assert plant.signal(rest) == pytest.approx(0.7, abs=1e-12)
    assert not added(
        "sensor_bandwidth", {"bandwidth_Hz": 1e4, "second_order": 0.0}, shot_of(channel="strain_gauge")
    ).any()


# saturation


@pytest.mark.parametrize("hardness", [1.5, 2.0, 20.0, 100.0])
def test_saturation_never_passes_the_rail_and_leaves_small_signals(hardness):
    effect = EFFECTS["sensor_saturation"]
    ramp = np.array([-1e6, -3.0, -1e-3, 0.0, 1e-3, 3.0, 1e6])
    shown = effect.sensing(complete(effect, limit=2.0, hardness=hardness), ramp, None, HEAD, shot_of())
    assert np.abs(shown).max() <= 2.0
    assert shown[[0, -1]] == pytest.approx([-2.0, 2.0], rel=1e-6)
    assert shown[3] == 0
    assert shown[[2, 4]] == pytest.approx(ramp[[2, 4]], rel=1e-4)
    assert shown[::-1] == pytest.approx(-shown)


def test_the_softest_saturation_is_the_hyperbola():
    effect, ramp = EFFECTS["sensor_saturation"], np.linspace(-9, 9, 37)
    shown = effect.sensing(complete(effect, limit=2.0, hardness=1.0), ramp, None, HEAD, shot_of())
    assert shown == pytest.approx(ramp / (1 + np.abs(ramp) / 2), rel=1e-12)
    above = effect.sensing(complete(effect, limit=2.0, hardness=1.0, skew=1.0), ramp, None, HEAD, shot_of())
    assert above == pytest.approx(np.where(ramp > 0, shown, ramp), rel=1e-12)


def test_hard_saturation_is_clipping():
    excitation = shot_of()
    signal = Plant(HEAD).signal(excitation)
    limit = 0.6 * np.abs(signal).max()
    shown = signal + added("sensor_saturation", {"limit": limit, "hardness": 100.0}, excitation)
    assert shown == pytest.approx(np.clip(signal, -limit, limit), abs=0.01 * limit)


def test_skewed_rails_lie_apart_and_one_of_them_may_be_gone():
    effect, ramp = EFFECTS["sensor_saturation"], np.array([-1e6, 1e6])
    for skew, above, below in ((0.5, 3.0, 9.0), (-0.25, 5.0, 3.0), (1.0, 3.0, 1e6)):
        values = complete(effect, limit=3.0, hardness=30.0, skew=skew)
        assert effect.sensing(values, ramp, None, HEAD, shot_of()) == pytest.approx([-below, above], rel=1e-6)
    assert "stays below 3 V." in effect.description(complete(effect, limit=3.0, hardness=30.0, skew=1.0))
    assert "stays below 3 V." in effect.description(complete(effect, limit=3.0, hardness=30.0, skew=0.999))
    assert "stays below 3 V and above -9 V." in effect.description(complete(effect, limit=3.0, hardness=30.0, skew=0.5))


def test_saturation_begins_at_what_was_measured_where_that_is_known():
    effect, excitation = EFFECTS["sensor_saturation"], shot_of()

    def softest(excitation):
        return {s["skew"]: s["limit"] for s in effect.starts(HEAD, [excitation]) if s["hardness"] == 1}

    signal = Plant(HEAD).signal(excitation)
    low, high = float(signal.min()), float(signal.max())
    assert softest(excitation) == pytest.approx({0.0: 10 * max(-low, high), 1.0: 10 * high, -1.0: -10 * low})
    measured = replace(excitation, signal_range=(-4.0, 12.0))
    assert softest(measured) == pytest.approx({0.0: 120.0, 1.0: 120.0, -1.0: 40.0})
    both = [s for s in effect.starts(HEAD, [measured]) if s["skew"] not in (-1, 0, 1)]
    ramp = np.array([-1e6, 1e6])
    for values in both:
        assert effect.sensing(values, ramp, None, HEAD, shot_of()) == pytest.approx([-4.0, 12.0], rel=1e-6)
    assert both
    above_0 = replace(excitation, signal_range=(1.0, 3.0))
    assert softest(above_0) == pytest.approx(dict.fromkeys((0.0, 1.0, -1.0), 30.0))


@pytest.mark.parametrize("hardness", [1.0, 6.0])
def test_a_scaled_saturation_cuts_off_as_many_times_as_much(hardness):
    effect, signal = EFFECTS["sensor_saturation"], np.linspace(-1, 1, 21)
    values = complete(effect, limit=30.0 ** (1 / hardness), hardness=hardness)
    cut = signal - effect.sensing(values, signal, None, HEAD, shot_of())
    more = signal - effect.sensing(effect.scaled(values, 2.0), signal, None, HEAD, shot_of())
    assert more == pytest.approx(2 * cut, rel=0.05)


# hum and drift


def test_hum_of_any_phase_is_in_its_columns():
    excitation = shot_of()
    frequency = 3.21 / (excitation.samples * excitation.step_s)
    columns = EFFECTS["mains_hum"].random_effect_basis(
        {"frequency_Hz": frequency, "multiples": 1.0, "amplitude": 1.0}, excitation
    )
    time_s = np.arange(excitation.samples) * excitation.step_s
    hum = 0.4 * np.sin(2 * np.pi * frequency * time_s + 1.1)
    weights = np.linalg.lstsq(columns, hum)[0]
    assert columns @ weights == pytest.approx(hum, abs=1e-12)
    assert np.hypot(*weights) == pytest.approx(0.4)


def test_hum_has_no_columns_where_it_is_off_or_far_too_fast():
    excitation, effect = shot_of(), EFFECTS["mains_hum"]
    assert effect.random_effect_basis({"frequency_Hz": 50.0, "multiples": 1.0, "amplitude": 0.0}, excitation) is None
    assert (
        effect.random_effect_basis(
            {"frequency_Hz": 2.1 / excitation.step_s, "multiples": 5.0, "amplitude": 1.0}, excitation
        )
        is None
    )


@pytest.mark.parametrize(("part", "columns"), [(0.01, 10), (0.39, 10), (0.25, 4), (0.5, 2), (1.0, 1)])
def test_hum_sampled_too_seldom_is_what_its_samples_show(part, columns):
    """Of five multiples at so many periods a sample: each wave once."""
    excitation = shot_of()
    on = {"frequency_Hz": part / excitation.step_s, "multiples": 5.0, "amplitude": 1.0}
    found = EFFECTS["mains_hum"].random_effect_basis(on, excitation)
    assert found.shape == (excitation.samples, columns)
    hum = np.cos(2 * np.pi * part * np.arange(excitation.samples) + 0.3) + 0.2 * np.sin(
        6 * np.pi * part * np.arange(excitation.samples)
    )
    assert found @ np.linalg.lstsq(found, hum)[0] == pytest.approx(hum, abs=1e-9)


def test_hum_begins_at_the_lines_that_were_seen_then_at_the_mains_that_show():
    slow = Excitation("strain_gauge", "demagnetised", 1e-3, np.zeros(400))
    slow = replace(slow, residual_lines_Hz=(77.0,))
    frequencies = [start["frequency_Hz"] for start in EFFECTS["mains_hum"].starts(HEAD, [shot_of(), slow])]
    assert frequencies[:6] == [77.0, 50.0, 60.0, 100.0, 120.0, 150.0]
    fast_only = [start["frequency_Hz"] for start in EFFECTS["mains_hum"].starts(HEAD, [shot_of()])]
    assert fast_only
    assert 50.0 not in fast_only


def test_drift_of_any_parabola_is_in_its_columns():
    excitation = shot_of()
    columns = EFFECTS["baseline_drift"].random_effect_basis({"amplitude": 1.0, "degree": 2.0, "walk": 0.0}, excitation)
    time_s = np.arange(excitation.samples) * excitation.step_s
    drift = 0.3 + 2e3 * time_s - 1e7 * time_s**2
    assert columns @ np.linalg.lstsq(columns, drift)[0] == pytest.approx(drift, abs=1e-12)
    assert (
        EFFECTS["baseline_drift"].random_effect_basis({"amplitude": 0.0, "degree": 2.0, "walk": 0.0}, excitation)
        is None
    )


def test_the_columns_of_a_random_walk_have_its_covariance():
    """E[w(s) w(t)] = min(s, t), less what steps shorter than the last term's add."""
    excitation = shot_of()
    values = complete(EFFECTS["baseline_drift"], amplitude=1.0, walk=1.0)
    columns = EFFECTS["baseline_drift"].random_effect_basis(values, excitation)
    time = np.linspace(0, 1, excitation.samples)
    found = 2 / math.pi**2 * columns[:, 1:] @ columns[:, 1:].T
    assert found == pytest.approx(np.minimum.outer(time, time), abs=0.02)
    assert np.trace(found) / np.sum(time) == pytest.approx(0.983, abs=0.002)
    assert np.ptp(columns[:, 0]) == 0


@pytest.mark.parametrize("effect_id", ["mains_hum", "baseline_drift"])
def test_what_chance_adds_to_the_sensor_is_not_in_the_voltage_at_the_head(effect_id):
    values = {"frequency_Hz": 2e4, "multiples": 1.0, "amplitude": 1.0, "degree": 2.0, "walk": 0.0}
    assert EFFECTS[effect_id].random_effect_basis(values, shot_of()) is not None
    assert EFFECTS[effect_id].random_effect_basis(values, shot_of(channel="drive_monitor")) is None


# crosstalk


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic", "free"])
@pytest.mark.parametrize("channel", ["self_sensing", "displacement", "strain_gauge"])
def test_mechanical_crosstalk_is_the_heads_own_answer_to_the_neighbour(channel, initial_state):
    excitation = shot_of(channel=channel, initial_state=initial_state)
    neighbour_V = -0.5 * np.roll(excitation.drive_V, 40)
    own = Plant(HEAD).signal(replace(excitation, drive_V=neighbour_V, cache={}))
    heard = replace(excitation, neighbour_V=neighbour_V, cache={})
    assert added("crosstalk", {"mechanical": 0.2, "electrical": 0.0, "direct": 0.0}, heard) == pytest.approx(
        0.2 * own, abs=1e-12
    )


def test_electrical_and_direct_crosstalk_are_the_neighbours_slope_and_drive():
    excitation = shot_of(neighbour_V=np.roll(shot_of().drive_V, 70))
    slope = np.gradient(excitation.neighbour_V, excitation.step_s)
    expected = 0.03 * 1e-6 * slope + 0.004 * excitation.neighbour_V
    assert added("crosstalk", {"mechanical": 0.0, "electrical": 0.03, "direct": 0.004}, excitation) == pytest.approx(
        expected, abs=1e-12
    )


def test_crosstalk_of_another_head_is_not_that_of_the_last():
    excitation = shot_of(neighbour_V=shot_of().drive_V)
    values = complete(EFFECTS["crosstalk"], mechanical=0.2)
    other = HEAD.varied(frequency_Hz=1.1 * HEAD.frequency_Hz)
    effects = [(EFFECTS["crosstalk"], values)]
    Plant(HEAD).with_effects(effects).signal(excitation)
    assert Plant(other).with_effects(effects).signal(excitation) == pytest.approx(
        1.2 * Plant(other).signal(excitation), abs=1e-12
    )


def test_crosstalk_of_a_detuned_neighbour_rings_as_it_does():
    """Of a head without hysteresis, against the closed form of its answer."""
    linear = Printhead(HEAD.a0, HEAD.a1, HEAD.b1, (1.0, 0.0), HEAD.full_scale_V)
    excitation = replace(shot_of(), drive_V=np.zeros(600), neighbour_V=shot_of().drive_V)
    values = complete(EFFECTS["crosstalk"], mechanical=0.1, detuning=-0.1, damping_change=0.5)
    found = Plant(linear).with_effects([(EFFECTS["crosstalk"], values)]).signal(excitation)
    omega0, zeta = 0.9 * math.sqrt(HEAD.a0), 1.5 * HEAD.a1 / (2 * math.sqrt(HEAD.a0))
    system = ([0.1 * 0.9 * linear.b1, 0.0], [1.0, 2 * zeta * omega0, omega0**2])
    fine = np.arange(5991) * excitation.step_s / 10
    _, expected, _ = lsim(system, np.interp(fine, excitation.step_s * np.arange(600), excitation.neighbour_V), fine)
    assert found == pytest.approx(expected[::10], abs=2e-4 * np.abs(expected).max())


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic"])
def test_crosstalk_through_the_ink_is_the_answer_to_a_neighbour_that_was_driven_later(initial_state):
    """By whole samples, so that the later drive is exact; between samples it is interpolated."""
    later_V = np.roll(shot_of().drive_V, 90)
    heard = shot_of(initial_state=initial_state, neighbour_V=later_V)
    late = replace(heard, neighbour_V=np.roll(later_V, 37), cache={})
    delay_s = 37 * heard.step_s
    expected = added("crosstalk", {"mechanical": 0.1}, late)
    assert added("crosstalk", {"mechanical": 0.1, "delay_s": delay_s}, heard) == pytest.approx(expected, abs=1e-10)
    direct = {"electrical": 0.03, "direct": 0.004}  # arrive at once
    at_once = added("crosstalk", {**direct, "delay_s": delay_s}, heard)
    assert at_once == pytest.approx(added("crosstalk", direct, heard), abs=1e-12)


def test_crosstalk_needs_a_neighbour_that_moves():
    silent, still = shot_of(), replace(shot_of(), neighbour_V=np.zeros(600))
    moving = replace(shot_of(), neighbour_V=shot_of().drive_V)
    effect = EFFECTS["crosstalk"]
    assert "column neighbour_V" in effect.untestable([silent])
    assert "is constant" in effect.untestable([silent, still])
    assert effect.untestable([silent, still, moving]) is None
    assert not added("crosstalk", {"mechanical": 0.2, "electrical": 1.0, "direct": 1.0}, silent).any()


# starts


@pytest.mark.parametrize("effect_id", ["feedthrough", "sensor_bandwidth", "sensor_saturation", "crosstalk"])
@pytest.mark.parametrize("slower", [1, 1000], ids=["52 kHz", "52 Hz"])
def test_starts_change_the_recordings_by_a_few_per_cent_whatever_the_heads_scale(effect_id, slower):
    head = HEAD.varied(frequency_Hz=HEAD.frequency_Hz / slower)
    head = replace(head, b1=HEAD.b1 / slower)
    excitation = shot_of(neighbour_V=np.roll(shot_of().drive_V, 70))
    excitation = replace(excitation, step_s=excitation.step_s * slower, cache={})
    effect, base = EFFECTS[effect_id], Plant(head)
    signal = base.signal(excitation)
    for start in effect.starts(head, [excitation]):
        change = base.with_effects([(effect, start)]).signal(excitation) - signal
        least = 0.0 if start.get("hardness") == 100 else 1e-4  # such a rail cuts the very largest sample alone
        assert least < np.sqrt(np.mean(change**2) / np.mean(signal**2)) < 0.6, start
        off = base.with_effects([(effect, switched_off(effect, start))]).signal(excitation)
        assert off == pytest.approx(signal, abs=1e-12)
