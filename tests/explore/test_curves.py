"""What is drawn is what the simulator and the commands say."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.augmented_heads import augmented_head
from inkjet_env.experiments.explore import exports
from inkjet_env.experiments.explore.curves import Conditions, curves
from inkjet_env.experiments.explore.drives import Corners
from inkjet_env.experiments.explore.heads import HeadShelf
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform

PUBLISHED = Printhead.published()


def random_waveforms(count, seed=0):
    points = np.random.default_rng(seed).uniform(-1, 1, (count, 7))
    return [Waveform.from_array(row) for row in Bounds().from_unit(points)]


@pytest.mark.parametrize("rate", [0.0, 0.4, 0.95, 1.0])
def test_peaks_and_cost_are_those_of_the_simulator(rate):
    for waveform in random_waveforms(6):
        frequency_Hz = rate / waveform.duration_s
        found = curves(PUBLISHED, waveform, Conditions(drop_frequency_Hz=frequency_Hz))
        exact = PUBLISHED.respond(waveform, period_s=1 / frequency_Hz if rate else np.inf)
        assert found.peaks_V == pytest.approx(exact.peaks_V, abs=1e-10)
        assert found.terms.total == pytest.approx(exact.cost(), abs=1e-9)
        assert found.sensor_V == pytest.approx(exact.sensor_V(found.time_s), abs=1e-9)


COSTS = (
    PeakCost(),
    PeakCost(-3, 2, "first"),
    PeakCost(-5, 5, 2.0),
    PeakCost(-5, 5, 99.0),
    PeakCost(target_height_V=2.0),
)


@pytest.mark.parametrize("cost", COSTS)
def test_the_terms_add_up_to_the_cost(cost):
    for waveform in random_waveforms(5, seed=1):
        terms = curves(PUBLISHED, waveform, Conditions(cost)).terms
        assert terms.effective + terms.next + terms.others == pytest.approx(terms.total, abs=1e-9)


def test_each_drop_of_a_train_is_that_of_the_simulator():
    waveform = Waveform(90, -70, 2e-6, 12e-6, 4e-6, 9e-6, 3e-6)
    found = curves(PUBLISHED, waveform, Conditions(drop_frequency_Hz=20e3))
    for earlier, drawn_V in enumerate(found.drops):
        exact = PUBLISHED.respond(waveform, period_s=50e-6, earlier_drops=earlier)
        assert drawn_V == pytest.approx(exact.sensor_V(found.drop_times_s), abs=2e-3)


def test_segments_that_form_the_waveform_give_its_peaks():
    waveform = random_waveforms(1, seed=2)[0]
    segments = Corners(*(tuple(part.tolist()) for part in waveform.knots()))
    for conditions in (Conditions(), Conditions(drop_frequency_Hz=8e3)):
        one, other = curves(PUBLISHED, waveform, conditions), curves(PUBLISHED, segments, conditions)
        assert other.peaks_V == pytest.approx(one.peaks_V, abs=1e-9)


def test_a_head_with_effects_shows_its_own_response():
    head, waveform = augmented_head("augmented-mode"), random_waveforms(1, seed=3)[0]
    for frequency_Hz in (0.0, 8e3):
        conditions = Conditions(drop_frequency_Hz=frequency_Hz)
        exact = head.respond(waveform, period_s=1 / frequency_Hz if frequency_Hz else np.inf)
        assert curves(head, waveform, conditions).terms.total == exact.cost()


def test_the_spectrum_peaks_at_the_resonance_of_a_ringing_head():
    found = curves(PUBLISHED, Waveform(100, 0, 0.2e-6, 1e-6, 0.2e-6, 0.0, 0.0), Conditions())
    assert found.frequency_Hz[int(found.spectrum_Vs.argmax())] == pytest.approx(PUBLISHED.frequency_Hz, rel=0.02)


def test_the_loop_closes():
    found = curves(PUBLISHED, random_waveforms(1)[0], Conditions())
    assert found.loop_hysteretic_V[-1] == pytest.approx(found.loop_hysteretic_V[0], abs=1e-9)


def test_the_command_line_and_the_files_give_the_same(inkjet, tmp_path):
    shelf = HeadShelf()
    file = tmp_path / "a head.json"
    PUBLISHED.varied(frequency_Hz=60e3).to_json(file)
    head, waveform = shelf.add(file), random_waveforms(1, seed=5)[0]
    conditions = Conditions(PeakCost(-4.0, 3.0, 1.5), drop_frequency_Hz=0.7 / waveform.duration_s)
    command = shlex.split(exports.command_text(head, waveform, conditions))
    status, out, _ = inkjet(*command[1:], "--json", "-")
    told = json.loads(out)
    mine = json.loads(exports.simulation_text(head.head, waveform, conditions))
    assert status == 0
    assert mine.pop("waveform") == waveform.to_array().tolist()
    assert told.pop("peaks_V") == pytest.approx(mine.pop("peaks_V"), abs=1e-10)
    assert told.pop("peak_times_s") == pytest.approx(mine.pop("peak_times_s"), abs=1e-14)
    for key in ("cost", "settling_s", "highest_drop_frequency_Hz"):
        assert told.pop(key) == pytest.approx(mine.pop(key), rel=1e-6)
    assert told == mine

    single = replace(conditions, drop_frequency_Hz=0.0)
    for name, text in (("drive.csv", exports.csv_text(waveform)), ("drive.ini", exports.ini_text(waveform))):
        (tmp_path / name).write_text(text)
        again = Corners.from_file(tmp_path / name)
        expected = curves(head.head, waveform, single).terms.total
        assert curves(head.head, again, single).terms.total == pytest.approx(expected, abs=0.02)
    command = shlex.split(exports.command_text(head, again, single, tmp_path / "drive.ini"))
    status, out, _ = inkjet(*command[1:], "--json", "-")
    assert json.loads(out)["cost"] == pytest.approx(curves(head.head, again, single).terms.total, abs=1e-6)


def test_corners_on_a_head_with_effects_have_the_steady_state_of_the_same_waveform():
    head = augmented_head("augmented-mode")
    waveform = random_waveforms(1, seed=5)[0]
    conditions = Conditions(drop_frequency_Hz=0.7 / waveform.duration_s)
    found = curves(head, Corners(*(tuple(column.tolist()) for column in waveform.knots())), conditions)
    assert found.terms.total == pytest.approx(curves(head, waveform, conditions).terms.total, abs=1e-6)


def test_the_picture_is_a_png():
    assert exports.picture(PUBLISHED, random_waveforms(1)[0], Conditions()).startswith(b"\x89PNG")
