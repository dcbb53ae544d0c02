"""The printhead as a value: files, variations, and the kinds of hysteresis in one response."""

import json

import numpy as np
import pytest

from inkjet_env.printhead import Printhead, Waveform

HEAD = Printhead.published()
WAVEFORM = Waveform(90, -70, 2e-6, 8e-6, 4e-6, 9e-6, 3e-6)


def test_json_round_trip_keeps_every_bit(tmp_path):
    HEAD.varied(60e3, 0.05, 1.1, 0.8).to_json(tmp_path / "head.json")
    assert Printhead.from_json(tmp_path / "head.json") == HEAD.varied(60e3, 0.05, 1.1, 0.8)
    assert [p.name for p in tmp_path.iterdir()] == ["head.json"]


def broken(change):
    data = {
        "format": "printhead/1",
        "dynamics": {name: {"value": 1e5, "low": 1, "high": 2} for name in ("a0", "a1", "b1")},
        "hysteresis": {"coefficients": [1.0, 0.0], "full_scale_V": 180.0, "degree": 1},
        "fit": {},
    }
    data["dynamics"]["a0"]["value"] = 1e11
    change(data)
    return json.dumps(data)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not json", "is not JSON"),
        ("[1]", "must be \"printhead/1\"; got 'list'"),
        (broken(lambda d: d.update(format="campaign/1")), "got 'campaign/1'"),
        (broken(lambda d: d["dynamics"].pop("a1")), "has no dynamics.a1"),
        (broken(lambda d: d["dynamics"]["b1"].update(value="big")), "dynamics.b1.value must be a number; got big"),
        (broken(lambda d: d["dynamics"]["a0"].update(value=-1.0)), "a0 must be a positive number"),
        (broken(lambda d: d["hysteresis"].update(coefficients=[1.0, 0.5])), "last hysteresis coefficient must be 0"),
        (broken(lambda d: d["hysteresis"].update(full_scale_V=0)), "full_scale_V must be a voltage"),
    ],
)
def test_a_broken_printhead_file_is_named_with_its_rule(tmp_path, text, message):
    path = tmp_path / "head.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        Printhead.from_json(path)
    assert str(path) in str(error.value)


def test_a_missing_printhead_file_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"none\.json: cannot be read"):
        Printhead.from_json(tmp_path / "none.json")


def test_a_varied_head_has_what_was_asked_for_and_nothing_else_changes():
    head = HEAD.varied(frequency_Hz=60e3, damping_ratio=0.04, gain=1.2)
    assert head.frequency_Hz == pytest.approx(60e3)
    assert head.damping_ratio == pytest.approx(0.04)
    assert head.b1 == 1.2 * HEAD.b1
    assert head.coefficients == HEAD.coefficients
    assert HEAD.varied() == HEAD
    assert HEAD.varied(frequency_Hz=60e3).damping_ratio == pytest.approx(HEAD.damping_ratio)


def test_gain_scales_the_response_and_frequency_stretches_time():
    t = np.linspace(0, 200e-6, 100)
    np.testing.assert_allclose(
        HEAD.varied(gain=1.3).respond(WAVEFORM).sensor_V(t), 1.3 * HEAD.respond(WAVEFORM).sensor_V(t), rtol=1e-12
    )
    slow = Waveform(WAVEFORM.U1, WAVEFORM.U2, *(2 * WAVEFORM.to_array()[2:]))
    half = HEAD.varied(frequency_Hz=HEAD.frequency_Hz / 2, damping_ratio=HEAD.damping_ratio)
    np.testing.assert_allclose(
        half.respond(slow).sensor_V(2 * t), 2 * HEAD.respond(WAVEFORM).sensor_V(t), rtol=1e-9, atol=1e-12
    )


def test_play_operators_give_the_same_peaks_as_the_branch_law_to_their_quadrature():
    law, plays = HEAD.respond(WAVEFORM), HEAD.respond(WAVEFORM, hysteresis="play_operators")
    main = np.argsort(-np.abs(law.peaks_V))[:6]
    for time_s, peak_V in zip(law.peak_times_s[main], law.peaks_V[main], strict=True):
        nearest = np.argmin(np.abs(plays.peak_times_s - time_s))
        assert plays.peaks_V[nearest] == pytest.approx(peak_V, abs=2e-3)


def test_the_hysteretic_drive_ends_where_the_branch_law_says():
    response = HEAD.respond(WAVEFORM, "demagnetised")
    knots_s, knots_V = WAVEFORM.knots()
    np.testing.assert_allclose(
        response.hysteretic_V(knots_s), HEAD.branch_law.hysteretic_V(knots_V, "demagnetised"), atol=1e-11
    )
    np.testing.assert_array_equal(response.drive_V(knots_s), knots_V)


def test_a_head_that_answers_nothing_is_refused():
    with pytest.raises(ValueError, match="b1 must be finite and not 0"):
        Printhead(HEAD.a0, HEAD.a1, 0.0, (1.0, 0.0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"a0": 1e300, "a1": 1e149}, "resonance of 1 Hz to 1 GHz"),
        ({"b1": 1e300}, "gain at resonance"),
        ({"a1": 1e-9}, "at least a millionth"),
        ({"coefficients": (1e300, 0.0)}, "within ±1e9"),
        ({"full_scale_V": np.inf}, "full_scale_V must be a voltage"),
    ],
)
def test_numbers_that_no_head_has_are_refused(changes, message):
    values = {name: getattr(HEAD, name) for name in ("a0", "a1", "b1", "coefficients", "full_scale_V")}
    with pytest.raises(ValueError, match=message):
        Printhead(**{**values, **changes})
