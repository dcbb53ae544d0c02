"""The head with effects: what it answers to waveforms and drives, and its file."""

import json
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform, batch, respond_sampled

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
WAVEFORM = Waveform(90.0, -70.0, 3e-6, 9e-6, 5e-6, 8e-6, 7e-6)
FEEDTHROUGH = (EFFECTS["feedthrough"], {"capacitive_s": 8e-9, "lossy": 1e-3, "lag_s": 0.0})
SATURATION = (EFFECTS["sensor_saturation"], {"limit": 5.0, "hardness": 20.0})
CUBIC = EFFECTS["cubic_stiffness"]
BASE = AugmentedPrinthead(HEAD, ())


def waveforms(n, seed=0):
    return Bounds().from_unit(np.random.default_rng(seed).uniform(-1, 1, (n, 7)))


@pytest.mark.parametrize("initial_state", ["periodic", "demagnetised"])
def test_without_effects_the_peaks_are_those_of_the_closed_form(initial_state):
    for row in waveforms(40):
        waveform = Waveform.from_array(row)
        exact, found = HEAD.respond(waveform, initial_state), BASE.respond(waveform, initial_state)
        largest = np.abs(exact.peaks_V).max()
        if np.diff(exact.peak_times_s).min() < found.step_s:
            continue  # two that no sampling tells apart
        assert found.peaks_V == pytest.approx(exact.peaks_V, abs=3e-4 * largest)
        assert found.peak_times_s == pytest.approx(exact.peak_times_s, abs=5e-8)
        time_s = np.linspace(0, 340e-6, 1000)
        assert found.sensor_V(time_s) == pytest.approx(exact.sensor_V(time_s), abs=1e-3 * largest)
        assert found.hysteretic_V(time_s) == pytest.approx(exact.hysteretic_V(time_s), abs=2.0)  # corners are cut


def test_without_effects_costs_are_those_of_the_compiled_head():
    rows, cost = waveforms(40), PeakCost(-5, 5, "first")
    for window_s in (100e-6, 350e-6):
        exact = batch.costs(rows, HEAD, cost, "demagnetised", window_s)
        wrong = np.abs(BASE.costs(rows, cost, "demagnetised", window_s) - exact)
        assert np.sort(wrong)[-2] < 0.01  # of one waveform the second peak is 4 ns long, and B its weight


@pytest.mark.parametrize("frequency_Hz", [1e3, 5e3, 9.7e3, 17e3])
def test_without_effects_a_train_is_that_of_the_closed_form(frequency_Hz):
    period_s = 1 / frequency_Hz
    exact, found = HEAD.respond(WAVEFORM, period_s=period_s), BASE.respond(WAVEFORM, period_s=period_s)
    largest = np.abs(exact.peaks_V).max()
    assert np.sort(found.peaks_V)[[0, 1, -2, -1]] == pytest.approx(
        np.sort(exact.peaks_V)[[0, 1, -2, -1]], abs=3e-4 * largest
    )
    time_s = np.linspace(0, min(period_s, 350e-6) * 0.999, 1000)
    assert found.sensor_V(time_s) == pytest.approx(exact.sensor_V(time_s), abs=1e-3 * largest)
    assert found.cost() == pytest.approx(exact.cost(), abs=0.05)


@pytest.mark.parametrize("name", ["second_mode", "cubic_stiffness", "creep", "feedthrough", "amplifier_bandwidth"])
def test_a_settled_train_is_what_many_drops_one_after_the_other_come_to(name):
    head, period_s, drops = AugmentedPrinthead(HEAD, ((EFFECTS[name], EFFECTS[name].example_values(HEAD)),)), 80e-6, 40
    settled = head.respond(WAVEFORM, period_s=period_s)
    time_s = np.arange(drops * 2000) * (period_s / 2000)
    one_by_one = head.respond_sampled(time_s, WAVEFORM.drive_V(time_s % period_s), window_s=None)
    last_V = one_by_one.sensor_V[-2000:]
    apart = np.abs(settled.sensor_V(np.arange(2000) * (period_s / 2000)) - last_V)
    assert apart.max() < 3e-3 * np.abs(last_V).max()


def test_a_train_on_a_head_with_effects_is_refused_as_on_one_without():
    with pytest.raises(ValueError, match="does not fit into a period"):
        BASE.respond(WAVEFORM, period_s=20e-6)
    with pytest.raises(ValueError, match='period_s needs initial_state="periodic"'):
        BASE.respond(WAVEFORM, "demagnetised", period_s=80e-6)


def test_a_jump_is_followed_from_the_first_moment_on():
    jumping = Waveform(100.0, -100.0, 0.0, 10e-6, 0.0, 9e-6, 0.0)
    exact = HEAD.respond(jumping)
    assert BASE.respond(jumping).peaks_V == pytest.approx(exact.peaks_V, abs=2e-2 * np.abs(exact.peaks_V).max())


@pytest.mark.parametrize("window_s", [350e-6, 500e-6])
def test_a_generator_that_steps_at_the_start_does_so_on_a_head_at_rest(window_s):
    steps = EFFECTS["generator_steps"]
    values = steps.example_values(HEAD) | {"update_s": 2.3e-6, "resolution_V": 0.0, "ahead": 0.5}
    head, time_s = AugmentedPrinthead(HEAD, ((steps, values),)), np.linspace(0, 100e-6, 1001)
    long_ago_V = head.respond(WAVEFORM, period_s=2e-3, window_s=window_s).sensor_V(time_s)
    at_rest_V = head.respond(WAVEFORM, window_s=window_s).sensor_V(time_s)
    assert np.abs(at_rest_V - long_ago_V).max() < 0.02 * np.abs(long_ago_V).max()


@pytest.mark.parametrize("slower", [1, 30])
def test_a_head_of_another_scale_is_followed_as_well(slower):
    head = HEAD.varied(frequency_Hz=HEAD.frequency_Hz / slower)
    waveform = Waveform.from_array(WAVEFORM.to_array() * [1, 1, *[slower] * 5])
    exact = head.respond(waveform, window_s=3e-4 * slower)
    found = AugmentedPrinthead(head, ()).respond(waveform, window_s=3e-4 * slower)
    assert found.peaks_V == pytest.approx(exact.peaks_V, abs=3e-4 * np.abs(exact.peaks_V).max())


@pytest.mark.parametrize("initial_state", ["periodic", "demagnetised"])
@pytest.mark.parametrize("window_s", [None, 4e-4])
def test_without_effects_a_sampled_drive_is_answered_as_the_closed_form_does(initial_state, window_s):
    time_s = 1e-3 + 2e-7 * np.arange(1000)
    drive_V = 80 * np.interp(time_s - 1e-3, [0, 1e-5, 3e-5, 3.2e-5, 5e-5], [0, 1, 1, -0.3, 0])
    exact = respond_sampled(HEAD, time_s, drive_V, initial_state, window_s=window_s)
    found = BASE.respond_sampled(time_s, drive_V, initial_state, window_s=window_s)
    assert found.sensor_V == pytest.approx(exact.sensor_V, abs=1e-6)
    assert found.peaks_V == pytest.approx(exact.peaks_V, abs=1e-5)
    assert found.peak_times_s == pytest.approx(exact.peak_times_s, abs=1e-9)
    uneven = np.delete(np.arange(1000), [300, 301, 777])
    exact = respond_sampled(HEAD, time_s[uneven], drive_V[uneven], initial_state, window_s=window_s)
    found = BASE.respond_sampled(time_s[uneven], drive_V[uneven], initial_state, window_s=window_s)
    assert found.sensor_V == pytest.approx(exact.sensor_V, abs=2e-3 * np.abs(exact.sensor_V).max())


def test_effects_of_sensing_are_added_to_what_the_head_shows():
    exact = HEAD.respond(WAVEFORM)
    found = AugmentedPrinthead(HEAD, (FEEDTHROUGH,)).respond(WAVEFORM)
    time_s = np.linspace(0, 340e-6, 500)
    knots_s, knots_V = WAVEFORM.knots()
    inside = np.abs(time_s[:, None] - knots_s).min(axis=1) > 2e-7
    slope = np.append(np.diff(knots_V) / np.diff(knots_s), 0)[np.searchsorted(knots_s, time_s, side="right") - 1]
    expected = exact.sensor_V(time_s) + 8e-9 * slope + 1e-3 * exact.drive_V(time_s)
    assert found.sensor_V(time_s)[inside] == pytest.approx(expected[inside], abs=5e-3)
    clipped = AugmentedPrinthead(HEAD, (SATURATION,)).respond(WAVEFORM)
    assert np.abs(clipped.peaks_V).max() < 5.0 < np.abs(exact.peaks_V).max()


def test_peaks_with_effects_stay_on_a_finer_grid(monkeypatch):
    lag = (EFFECTS["sensor_bandwidth"], {"bandwidth_Hz": 4e5, "second_order": 0.0})
    effects = ((CUBIC, CUBIC.starts(HEAD, [shot_of(WAVEFORM)])[0]), lag, SATURATION)
    rough = AugmentedPrinthead(HEAD, effects).respond(WAVEFORM)
    monkeypatch.setattr("inkjet_env.plant.augmented.STEPS_A_PERIOD", 1600)
    fine = AugmentedPrinthead(HEAD, effects).respond(WAVEFORM)
    largest = np.abs(fine.peaks_V).max()
    assert rough.peaks_V == pytest.approx(fine.peaks_V, abs=1e-3 * largest)
    assert rough.cost() == pytest.approx(fine.cost(), abs=0.01 * largest)


def test_a_nonlinear_head_is_the_plants_on_the_same_drive():
    values = CUBIC.starts(HEAD, [shot_of(WAVEFORM)])[0]
    excitation = shot_of(WAVEFORM)
    time_s = np.arange(excitation.samples) * excitation.step_s
    found = AugmentedPrinthead(HEAD, ((CUBIC, values),)).respond_sampled(time_s, excitation.drive_V, "demagnetised")
    expected = Plant(HEAD, effects=((CUBIC, values),)).signal(excitation)
    assert found.sensor_V == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())
    assert np.abs(expected - Plant(HEAD).signal(excitation)).max() > 5e-3 * np.abs(expected).max()


def test_the_head_is_taken_as_it_was_at_its_order():
    effect = EFFECTS["thermal_drift"]
    values = effect.starts(HEAD, [replace(shot_of(WAVEFORM), order=k) for k in range(1, 31)])[0]
    first, last = (AugmentedPrinthead(HEAD, ((effect, values),), order=order) for order in (1, 30))
    assert first.respond(WAVEFORM).cost() == pytest.approx(BASE.respond(WAVEFORM).cost())
    assert abs(last.respond(WAVEFORM).cost() - first.respond(WAVEFORM).cost()) > 0.01


def test_what_cannot_be_followed_is_refused():
    head = AugmentedPrinthead(HEAD, (FEEDTHROUGH,))
    with pytest.raises(ValueError, match="infinite window needs a printhead without effects"):
        head.respond(WAVEFORM, window_s=np.inf)
    with pytest.raises(ValueError, match="hysteresis of a printhead with effects must be one of full_memory"):
        head.respond(WAVEFORM, hysteresis="one_point")
    with pytest.raises(ValueError, match="initial_state must be"):
        head.respond(WAVEFORM, "resting")
    with pytest.raises(ValueError, match="Shorten the drive or the window"):
        head.respond_sampled([0, 1, 2], [0, 1, 0])
    parameter = next(p for p in CUBIC.parameters if p.name in CUBIC.strengths)
    running_away = AugmentedPrinthead(HEAD, ((CUBIC, {p.name: p.low for p in CUBIC.parameters}),))
    assert parameter.low < 0
    with pytest.raises(ValueError, match="cannot be simulated under a drive of up to 90 V"):
        running_away.respond(WAVEFORM)


def test_a_file_keeps_head_effects_gains_and_order(tmp_path):
    bandwidth = (EFFECTS["sensor_bandwidth"], {"bandwidth_Hz": np.inf, "second_order": 0.0})
    head = AugmentedPrinthead(HEAD, (FEEDTHROUGH, SATURATION, bandwidth), {"strain_gauge": 2.5e-3}, 17)
    path = tmp_path / "head.json"
    head.to_json(path, effect_intervals={"feedthrough": {"lossy": (5e-4, 2e-3)}})
    again = read_printhead(path)
    assert (again.printhead, again.effects, again.gains, again.order) == (HEAD, head.effects, head.gains, 17)
    written = json.loads(path.read_text())
    assert written["effects"][0]["parameters"]["lossy"] == {"value": 1e-3, "low": 5e-4, "high": 2e-3, "unit": "1"}
    assert written["effects"][2]["parameters"]["bandwidth_Hz"]["value"] is None
    HEAD.to_json(path)
    assert read_printhead(path) == HEAD


def test_the_base_model_alone_is_never_read_from_a_file_with_effects(tmp_path):
    AugmentedPrinthead(HEAD, (FEEDTHROUGH,)).to_json(tmp_path / "head.json")
    with pytest.raises(ValueError, match=r"head.json: has effects beyond the base model \(feedthrough\)"):
        Printhead.from_json(tmp_path / "head.json")


def damaged(change):
    data = AugmentedPrinthead(HEAD, (FEEDTHROUGH, SATURATION), {"strain_gauge": 1.0}).as_json()
    change(data)
    return data


def test_a_file_from_before_a_law_had_a_freedom_is_read_with_its_plain_value(tmp_path):
    slew = (EFFECTS["slew_limit"], {"slew_rate_V_s": 2e7, "lag_s": 1e-7, "fall_ratio": 1.0})
    for ratio, names in ((1.0, {"slew_rate_V_s", "lag_s"}), (0.5, {"slew_rate_V_s", "lag_s", "fall_ratio"})):
        data = AugmentedPrinthead(HEAD, ((slew[0], slew[1] | {"fall_ratio": ratio}),)).as_json()
        assert data["effects"][0]["parameters"].keys() == names
        path = tmp_path / f"older-{ratio}.json"
        path.write_text(json.dumps(data))
        assert read_printhead(path).effects[0][1] == slew[1] | {"fall_ratio": ratio}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["effects"][0].update(id="feedtrough"), "got 'feedtrough'. Did you mean 'feedthrough'"),
        (lambda d: d["effects"][0].update(id=["x"]), "the id of an effect must be one of"),
        (lambda d: d["effects"][0]["parameters"].pop("lossy"), "feedthrough, parameter lossy: is missing"),
        (lambda d: d["effects"][0].pop("parameters"), "parameter capacitive_s: is missing"),
        (lambda d: d["effects"][1]["parameters"]["hardness"].update(value=0.5), r"must be 1 to 10000 1; got 0\.5"),
        (lambda d: d["effects"][1]["parameters"]["hardness"].update(value=None), "must be a number; got None"),
        (lambda d: d["effects"][1]["parameters"]["limit"].update(value=True), "must be a number; got True"),
        (lambda d: d.update(effects=d["effects"] * 2), "may occur only once"),
        (lambda d: d.update(effects="creep"), "effects must be a list"),
        (lambda d: d.update(order=0), '"order" must be a whole number of at least 1'),
        (lambda d: d["fit"]["channels"]["strain_gauge"].pop("gain"), "strain_gauge.gain.value must be a finite number"),
    ],
)
def test_a_damaged_file_is_refused_by_name_and_rule(tmp_path, change, message):
    path = tmp_path / "head.json"
    path.write_text(json.dumps(damaged(change)))
    with pytest.raises(ValueError, match=message) as caught:
        read_printhead(path)
    assert str(caught.value).startswith(str(path))


def test_a_head_that_drifts_with_the_order_needs_one(tmp_path):
    effect = EFFECTS["thermal_drift"]
    values = effect.starts(HEAD, [replace(shot_of(WAVEFORM), order=k) for k in range(1, 31)])[0]
    data = AugmentedPrinthead(HEAD, ((effect, values),), order=30).as_json()
    del data["order"]
    (tmp_path / "head.json").write_text(json.dumps(data))
    with pytest.raises(ValueError, match="Give that of the last recording"):
        read_printhead(tmp_path / "head.json")


def shot_of(waveform):
    step_s = 1 / (100 * HEAD.frequency_Hz)
    time_s = np.arange(1500) * step_s
    return Excitation("self_sensing", "demagnetised", step_s, waveform.drive_V(time_s))


@pytest.mark.parametrize("delay_s", [-3e-7, -1e-9, 3e-7])
def test_a_drive_that_comes_early_is_followed_from_where_it_begins(delay_s):
    """One drop from rest is the first part of a train with long rests, whichever way the clock is off."""
    head = AugmentedPrinthead(HEAD, ((EFFECTS["trigger_delay"], {"delay_s": delay_s}),))
    waveform = Waveform(100, -100, 1.02e-6, 9.4e-6, 13.8e-6, 9e-6, 19.5e-6)
    alone, plain = head.respond(waveform), HEAD.respond(waveform)
    assert alone.cost() == pytest.approx(head.respond(waveform, period_s=2e-3).cost(), abs=1e-3)
    assert alone.cost() == pytest.approx(plain.cost(), abs=5e-3)  # a response that is late is as high
    later_s = np.arange(1, 300) * 1e-6
    np.testing.assert_allclose(alone.sensor_V(later_s), plain.sensor_V(later_s - delay_s), atol=0.02)
