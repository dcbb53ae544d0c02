"""Drives from files of every style, and the segment files of print controllers."""

import gzip

import numpy as np
import pytest

from inkjet_env.printhead import Waveform
from inkjet_env.recordings import CampaignError
from inkjet_env.recordings.drive import read_drive
from inkjet_env.recordings.segment_file import write_segments

TIME_S = np.array([0.0, 1e-6, 3e-6, 8e-6, 9e-6])
DRIVE_V = np.array([0.0, 0.0, 40.0, 40.0, 0.0])
PULSE = """[generic]
HeadType = any
[Pulse0]
; start V, end V, slew V/us, hold us
Seg0 = 0, 42, 21, 3.5
Seg1 = 42, -10, -26, 0 ; no hold
[Pulse1]
Seg0 = -10, -10, 0, 2
Seg1 = -10, 0, 5, 0
GLMask = 0x0E
"""


def lines_of(delimiter=",", decimal=".", header=("time_s", "drive_V"), times=1.0, volts=1.0):
    rows = [f"{t * times:.9g}{delimiter}{v * volts:.9g}" for t, v in zip(TIME_S, DRIVE_V, strict=True)]
    return "\n".join([delimiter.join(header), *(row.replace(".", decimal) for row in rows)]) + "\n"


STYLES = {
    "plain": lines_of().encode(),
    "millivolts and microseconds": lines_of(header=("t (us)", "drive (mV)"), times=1e6, volts=1e3).encode(),
    "decimal commas": lines_of(";", ",").encode(),
    "tabs in two bytes": lines_of("\t").encode("utf-16"),
    "compressed": gzip.compress(lines_of().encode()),
    "other columns": lines_of(header=("time_s", "drive_V")).replace("\n", ",1\n").replace("_V,1", "_V,rest").encode(),
    "no header": "".join(lines_of().partition("\n")[2:]).encode(),
}  # fmt: skip


@pytest.mark.parametrize("style", STYLES)
def test_every_style_is_read_to_the_same_drive(tmp_path, style):
    (tmp_path / "d.csv").write_bytes(STYLES[style])
    read = read_drive(tmp_path / "d.csv")
    np.testing.assert_allclose(read.time_s, TIME_S, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(read.drive_V, DRIVE_V, rtol=1e-9)
    told = (
        f"{tmp_path}/d.csv: column column 2 has no unit: taken as V.",
        f"{tmp_path}/d.csv: column column 1 (guessed: the first column) has no unit: taken as s.",
    )
    assert read.notes == (told if style == "no header" else ())


def test_arrays_are_read_to_the_same_drive(tmp_path):
    np.savez(tmp_path / "d.npz", time_s=TIME_S, drive_V=DRIVE_V)
    np.testing.assert_array_equal(read_drive(tmp_path / "d.npz").drive_V, DRIVE_V)
    np.savez(tmp_path / "e.npz", drive_V=DRIVE_V, other=DRIVE_V)
    with pytest.raises(CampaignError, match="no column of times"):
        read_drive(tmp_path / "e.npz")
    np.testing.assert_allclose(read_drive(tmp_path / "e.npz", interval_s=1e-7).time_s, 1e-7 * np.arange(5))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "time_s,drive_V\n0,0\n1e-6,0\n1e-6,40\n",
            "row 4: .*got 1e-06 s twice. For a vertical edge, put the second row",
        ),
        (
            "time_s,drive_V\n0,0\n2e-6,0\n1e-6,40\n",
            "row 4: time must increase from row to row; got 1e-06 s after 2e-06 s",
        ),
        ("time_s,drive_V\n0,0\n1e-6,40000\n", "goes to 40000 V. Check the unit"),
        ("time_s,drive (A)\n0,0\n1e-6,4\n", "the drive must be in V; column drive .A. is in A"),
        ("time_s,one,other\n0,0,0\n1e-6,4,5\n", "could be: one, other. Call one of them drive_V"),
    ],
)
def test_what_is_no_drive_is_refused(tmp_path, text, said):
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(CampaignError, match=said):
        read_drive(tmp_path / "d.csv")


def test_an_implausible_drive_may_be_meant(tmp_path):
    (tmp_path / "d.csv").write_text("time_s,drive_V\n0,0\n1e-6,40000\n")
    read = read_drive(tmp_path / "d.csv", implausible=True)
    assert read.drive_V[1] == 40000
    assert "beyond ±100 V" in read.notes[0]


def test_segments_of_several_pulses_follow_each_other(tmp_path):
    (tmp_path / "w.txt").write_text(PULSE)
    read = read_drive(tmp_path / "w.txt")
    np.testing.assert_allclose(read.time_s * 1e6, [0, 2, 5.5, 7.5, 9.5, 11.5])
    np.testing.assert_array_equal(read.drive_V, [0, 42, 42, -10, -10, 0])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "Seg1 = 42, -10",
            "Seg1 = 40, -10",
            "row 6: the segment must start at 42 V, where the one before ended; got 40 V",
        ),
        ("42, 21,", "42, -21,", "row 5: the slew rate must be above 0 V/us from 0 V to 42 V; got -21"),
        ("42, 21,", "42, 0,", "row 5: the slew rate must be above 0"),
        ("3.5", "-3.5", "row 5: the hold time must be at least 0 us; got -3.5"),
        ("3.5", "long", "row 5: the hold time must be a finite number; got 'long'"),
        ("21, 3.5", "21", "row 5: a segment has four numbers"),
        ("Seg1 = 42", "Seg0 = 42", "row 6: segment 0 is there twice"),
    ],
)
def test_segments_that_do_not_fit_are_refused_by_their_row(tmp_path, old, new, said):
    (tmp_path / "w.txt").write_text(PULSE.replace(old, new, 1))
    with pytest.raises(CampaignError, match=f"w.txt, {said}"):
        read_drive(tmp_path / "w.txt")


def test_segments_are_written_as_they_are_read(tmp_path):
    rng = np.random.default_rng(1)
    for _ in range(50):
        values = [rng.uniform(0, 100), -rng.uniform(0, 100), *rng.uniform(1e-7, 2e-5, 5)]
        time_s, drive_V = Waveform(*values).knots()
        write_segments(tmp_path / "w.ini", time_s, drive_V)
        read = read_drive(tmp_path / "w.ini")
        np.testing.assert_allclose(read.time_s, time_s, rtol=0, atol=1e-16)
        np.testing.assert_allclose(read.drive_V, drive_V, rtol=1e-11)


def test_a_jump_cannot_be_written_as_a_segment(tmp_path):
    with pytest.raises(ValueError, match="jumps from 0 V to 50 V at 0 us"):
        write_segments(tmp_path / "w.ini", *Waveform(50.0, -50.0, 0.0, 1e-6, 1e-6, 1e-6, 1e-6).knots())
    assert not (tmp_path / "w.ini").exists()


def test_a_refusal_is_one_line_whatever_a_file_is_called(tmp_path):
    file = tmp_path / "a\nb\x1b[2J.csv"
    file.write_text("x")
    with pytest.raises(CampaignError) as refusal:
        read_drive(file)
    assert str(refusal.value).isprintable()
