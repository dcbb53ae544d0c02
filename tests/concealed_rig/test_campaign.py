"""The campaign's folder: the same bytes again, and no hint of what is concealed."""

import csv
import json

import numpy as np
import pytest

from experiments.concealed_rig import Case, build

CASES = [
    Case(3, 50, meagre=True),
    Case(3, 50, "effect", ("air_bubble",), "strong", True),
    Case(3, 50, "effect", ("mains_hum",), "strong", True),
    Case(3, 50, "outside", ("locked_interference",), "medium", True),
    Case(3, 50, "base", ("bouc_wen",), meagre=True),
]


def files(case, folder):
    build(case).write(folder, "head-3")
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize(
    "case", [CASES[2], Case(1, 51, "outside", ("clock_jitter",), 1.0, True)], ids=["hum", "jitter"]
)
def test_the_same_case_writes_the_same_bytes(case, tmp_path):
    assert files(case, tmp_path / "a") == files(case, tmp_path / "b")


def test_what_is_concealed_changes_nothing_but_the_sensors_numbers(tmp_path):
    written = [files(case, tmp_path / str(k)) for k, case in enumerate(CASES)]
    for other in written[1:]:
        assert list(other) == list(written[0])
        assert other["datapackage.json"] == written[0]["datapackage.json"]
        for name in other:
            if name.endswith(".csv"):
                here, there = (list(csv.reader(f[name].decode().splitlines())) for f in (other, written[0]))
                assert here[0] == there[0]
                asked = [here[0].index(column) for column in ("time_s", "drive_V")]
                assert [[row[k] for k in asked] for row in here] == [[row[k] for k in asked] for row in there]


def test_half_of_the_other_cases_have_a_firing_neighbour_and_all_of_crosstalk():
    def heard(case):
        return any(row.neighbour_V is not None for row in build(case).setup.rows)

    share = np.mean([heard(Case(k, 52, meagre=True)) for k in range(16)])
    assert 0.2 < share < 0.8
    assert all(heard(Case(k, 52, "effect", ("crosstalk",), "strong", True)) for k in range(3))


def test_the_plan_is_the_one_that_was_described():
    built = build(Case(5, 53))
    rows = built.setup.rows
    assert 24 <= len(rows) <= 29
    assert [row.order for row in rows] == list(range(1, len(rows) + 1))
    repeats = [row for row in rows if row.repeat_of]
    assert {row.channel for row in repeats} == {"self_sensing", "strain_gauge"}
    for row in repeats:
        assert row.repeat_of < row.order
        np.testing.assert_array_equal(row.drive_V, rows[row.repeat_of - 1].drive_V)
    assert {"trapezoid", "bipolar", "pulse_pair", "multisine", "zero", "minor_loops", "step"} <= {
        r.excitation for r in rows
    }
    fast = [row for row in rows if row.channel == "self_sensing"]
    assert all(1 / built.plant.head.resonance_Hz / row.step_s >= 40 for row in fast)
    assert any(row.initial_state == "demagnetised" for row in fast)
    orders = [[r.excitation for r in build(Case(k, 53)).setup.rows] for k in range(2)]
    assert orders[0] != orders[1]


def test_nothing_is_planted_in_a_null_case_and_only_noise_is_left():
    built = build(Case(6, 54))
    truth = built.truth()
    assert truth["rho"] == 0
    assert truth["effects"] == []
    json.dumps(truth, allow_nan=False)
    sensors, _ = built.recorded()
    for row, sensor, base in zip(built.setup.rows, sensors, built.setup.base, strict=True):
        sigma = built.setup.instruments.sigma[row.channel]
        assert np.std(sensor - base.signal) < 2.5 * sigma
    fast = [
        np.std(trace.signal)
        for row, trace in zip(built.setup.rows, built.setup.base, strict=True)
        if row.channel == "self_sensing"
    ]
    assert 40 <= 20 * np.log10(max(fast) / built.setup.instruments.sigma["self_sensing"]) <= 60


def test_a_folder_that_holds_something_is_not_written_over(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "old.txt").write_text("mine")
    with pytest.raises(ValueError, match="must be new or empty"):
        build(Case(0, 55, meagre=True)).write(tmp_path / "a", "x")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]
