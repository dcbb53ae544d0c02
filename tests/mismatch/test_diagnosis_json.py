"""A diagnosis as JSON has what was agreed."""

import json

import pytest

from inkjet_env.storage import json_text


def shape_of(value):
    """The types of a JSON value, lists by their first entry."""
    if isinstance(value, dict):
        return {key: shape_of(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [shape_of(value[0])] if value else []
    return type(value)


NUMBER = {"value": float, "low": float, "high": float, "unit": str}
"""As the contract has it."""


@pytest.mark.parametrize("verdict", ["none", "named", "set", "unknown"])
def test_the_verdict_in_json_has_what_was_agreed(verdict, diagnosed):
    found = {
        "none": lambda: diagnosed(seed=0),
        "named": lambda: diagnosed("quadratic_damping"),
        "set": lambda: diagnosed("sensor_bandwidth"),
        "unknown": lambda: diagnosed("wave_echo", looked_for=("feedthrough", "quadratic_damping", "cubic_stiffness")),
    }[verdict]()
    written = json.loads(json_text(found.as_json(["next.csv"])))
    assert (written["format"], written["verdict"]) == ("diagnosis/1", verdict)
    agreed = {"format", "verdict", "effects", "candidates", "location", "fit", "next_experiment", "seconds"}
    assert agreed <= written.keys()
    for effect in written["effects"]:
        assert effect.keys() == {"id", "stage", "sentence", "evidence", "parameters"}
        assert shape_of(effect["evidence"]) == {"delta_nll": float, "p_value": float}
        for number in effect["parameters"].values():
            assert shape_of(number) == NUMBER
            assert number["low"] <= number["value"] <= number["high"]
    assert (len(written["effects"]) > 0) == (verdict in ("named", "set"))
    assert all(len(group) > 1 and set(map(type, group)) == {str} for group in written["candidates"])
    assert (len(written["candidates"]) > 0) == (verdict == "set")
    location = written["location"]
    assert location.keys() == {"recordings", "time_s", "frequency_Hz", "drive_V", "sentence", "by_recording"}
    assert all(type(name) is str for name in location["recordings"])
    assert (len(location["recordings"]) > 0) == (verdict != "none")
    for label in ("time_s", "frequency_Hz", "drive_V"):
        assert all(low <= high for low, high in location[label])
    fit = written["fit"]
    figures = {"noise_rms_V", "base_heldout_rms_V", "augmented_heldout_rms_V"}
    assert {*figures, "closure", "heldout"} <= fit.keys()
    assert all(fit[name] > 0 for name in figures)
    assert (fit["closure"] is None) == (verdict == "none")
    names = {recording.name for recording in found.recordings}
    assert fit["heldout"]
    assert set(fit["heldout"]) < names
    following = written["next_experiment"]
    assert following is None or following["drive_csv"] == "next.csv"
    assert following is None or following["channel"] in ("self_sensing", "strain_gauge", "displacement")
    assert (following is None) == (verdict != "set")
    assert written["seconds"] > 0
