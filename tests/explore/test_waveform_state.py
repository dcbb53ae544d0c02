"""State of the waveform: corners and sliders, undo, pins, limits, and what is kept."""

import itertools
import math

import numpy as np
import pytest

from inkjet_env.experiments.explore.drives import PUBLISHED_BEST, SHORTEST_S, Corners, corners_of, moved_corner
from inkjet_env.experiments.explore.exploration import Exploration
from inkjet_env.experiments.explore.waveform_state import MOST_PINNED, MOST_UNDONE, WaveformState
from inkjet_env.printhead import DriverLimits, PeakCost, Waveform

BEST = Waveform.from_array(PUBLISHED_BEST)


@pytest.mark.parametrize("corner", range(1, 6))
def test_a_corner_moves_alone_in_time(corner):
    before_s, _ = BEST.knots()
    after_s, _ = moved_corner(BEST, corner, before_s[corner] - 0.3e-6, BEST.knots()[1][corner]).knots()
    moved_s = after_s - before_s
    assert moved_s[corner] == pytest.approx(-0.3e-6, abs=0.51e-8)
    assert np.abs(np.delete(moved_s, corner)).max() < 1e-14


def test_corners_on_one_plateau_move_together_in_voltage():
    for corner, expected in ((1, [0, 70, 70, -100, -100, 0]), (4, [0, 100, 100, -70, -70, 0])):
        level_V = math.copysign(70, expected[corner])
        assert moved_corner(BEST, corner, BEST.knots()[0][corner], level_V).knots()[1].tolist() == expected


def test_corners_keep_their_order_and_the_signs_of_their_plateaus_wherever_they_are_dragged():
    for corner, time_s, drive_V in itertools.product(range(6), (-1.0, 0.0, 20e-6, 1.0), (-1e9, -1.0, 0.0, 1e9)):
        moved = moved_corner(BEST, corner, time_s, drive_V)
        assert moved.U1 >= 0 >= moved.U2
        assert np.diff(moved.knots()[0]).min() >= SHORTEST_S * (1 - 1e-9)


def test_a_segment_that_is_shorter_than_dragging_leaves_can_still_be_dragged():
    jumps = Waveform(100, -100, 0.0, 10e-6, 0.0, 10e-6, 0.0)
    assert moved_corner(jumps, 1, 3e-6, 50.0).U1 == 50.0


def test_there_is_no_seventh_corner():
    with pytest.raises(ValueError, match="corner must be 0 to 5; got 6"):
        moved_corner(BEST, 6, 0.0, 0.0)


def test_a_gesture_is_undone_as_one():
    state = WaveformState()
    for k in range(5):
        state.drag(2, 11e-6 + k * 1e-7, 90.0)
    state.settle()
    state.change_parameter(6, 18e-6)
    assert state.drive.t5 == 18e-6
    state.undo()
    assert state.drive.t5 == 20e-6
    state.undo()
    assert state.drive == BEST
    assert not state.can_undo


def test_undo_is_bounded():
    state = WaveformState()
    for k in range(MOST_UNDONE + 50):
        state.change_parameter(0, float(k))
    for _ in range(MOST_UNDONE):
        assert state.can_undo
        state.undo()
    assert not state.can_undo


def test_a_drive_that_does_not_fit_between_drops_is_refused_and_a_dragged_corner_stops():
    state = WaveformState()
    state.set_drop_frequency(15e3)
    with pytest.raises(ValueError, match=r"a drive of 94.86 µs does not fit into the 66.67 µs between drops"):
        state.change_parameter(6, 60e-6)
    state.drag(5, 200e-6, 0.0)
    assert state.drive == BEST


def test_drops_never_come_faster_than_the_drive_lasts():
    state = WaveformState()
    state.set_drop_frequency(1e6)
    assert state.conditions.drop_frequency_Hz == pytest.approx(1 / BEST.duration_s)
    with pytest.raises(ValueError, match="must be at least 0 Hz"):
        state.set_drop_frequency(math.nan)


def test_a_legal_waveform_exceeds_no_limit():
    state = WaveformState()
    state.limits = DriverLimits.from_text("lowest_V=-40,highest_V=48,rise_V_per_us=20,fall_V_per_us=20,step_us=0.1")
    assert len(state.excesses()) >= 4
    state.make_legal()
    assert state.excesses() == []
    assert state.can_undo


def test_pins_have_names_of_their_own_and_the_oldest_makes_room():
    state = WaveformState()
    for k in range(MOST_PINNED + 2):
        state.change_parameter(0, 10.0 + k)
        state.pin()
    assert [one.name for one in state.pinned] == [f"pin {k}" for k in range(3, MOST_PINNED + 3)]
    state.unpin("pin 4")
    state.take("pin 3")
    assert state.drive.U1 == 12.0
    assert [one.name for one in state.pinned][:2] == ["pin 3", "pin 5"]


def test_samples_on_a_line_are_no_corners():
    time_s = np.linspace(0, 60e-6, 601)
    wave = Waveform(80, -60, 2e-6, 10e-6, 5e-6, 8e-6, 3e-6)
    assert corners_of(time_s, wave.drive_V(time_s)).tolist() == [0, 20, 120, 170, 250, 280, 600]


def test_a_drive_file_of_any_segments_can_be_edited(tmp_path):
    text = "[Pulse0]\nSeg0 = 0, 42, 21, 3.5\nSeg1 = 42, 10, -16, 4\nSeg2 = 10, 30, 20, 2\nSeg3 = 30, 0, -10, 0\n"
    exploration = Exploration(tmp_path / "session.json")
    exploration.open_drive("<img onerror=alert(1)>.ini", text.encode())
    drive = exploration.waveform.drive
    assert isinstance(drive, Corners)
    assert drive.drive_V == (0, 42, 42, 10, 10, 30, 30, 0)
    exploration.waveform.drag(5, 13e-6, 35.0)
    moved = exploration.waveform.drive
    assert (moved.drive_V[5], moved.drive_V[6]) == (35.0, 30.0)
    assert moved.time_s[5] == pytest.approx(12.5e-6 - 0.0, abs=1e-6)
    with pytest.raises(ValueError, match="a drive of segments has no seven parameters"):
        exploration.waveform.change_parameter(0, 1.0)


def test_a_file_that_is_no_drive_is_refused_by_the_name_it_was_dropped_with(tmp_path):
    exploration = Exploration(tmp_path / "session.json")
    with pytest.raises(ValueError, match=r"^mine\.csv") as refusal:
        exploration.open_drive("mine.csv", b"hello\n")
    assert str(tmp_path) not in str(refusal.value)
    assert exploration.waveform.drive == BEST


def test_a_session_is_there_again_exactly(tmp_path):
    file = tmp_path / "session.json"
    exploration = Exploration.restored(file)
    head = tmp_path / "<img onerror=alert(1)>.json"
    exploration.shelf.heads["published"].head.to_json(head)
    exploration.shelf.choose(exploration.shelf.add(head).name)
    state = exploration.waveform
    state.change_parameter(3, 10.123456789e-6)
    state.pin()
    state.change_parameter(3, 9.87e-6)
    state.set_cost(PeakCost(-4, 3, 2.5, 6.0))
    state.set_drop_frequency(12e3)
    state.limits = DriverLimits(highest_V=120)
    exploration.save()
    again = Exploration.restored(file)
    assert again.as_json() == exploration.as_json()
    assert again.waveform.conditions == state.conditions
    again.waveform.undo()
    assert again.waveform.drive.t2 == 10.123456789e-6


def test_a_head_that_is_gone_is_told_and_the_rest_is_kept(tmp_path):
    file, head = tmp_path / "session.json", tmp_path / "head.json"
    exploration = Exploration(file)
    exploration.shelf.heads["published"].head.to_json(head)
    exploration.shelf.choose(exploration.shelf.add(head).name)
    exploration.waveform.pin()
    exploration.save()
    head.unlink()
    again = Exploration.restored(file)
    assert again.shelf.chosen == "published"
    assert [one.name for one in again.waveform.pinned] == ["pin 1"]
    assert "head.json" in again.trouble[0]


@pytest.mark.parametrize("content", ["{", "[]", '{"format": "exploration/1"}', '{"format": "simulation/1"}'])
def test_a_file_that_is_no_session_is_refused_in_a_sentence(tmp_path, content):
    file = tmp_path / "session.json"
    file.write_text(content)
    with pytest.raises(ValueError, match=r"session\.json: is not a session of inkjet explore .* Delete it, or give"):
        Exploration.restored(file)
