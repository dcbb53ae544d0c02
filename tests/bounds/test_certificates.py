"""A sound certificate of a lower bound is accepted; what is removed, added or changed is refused."""

import json
import lzma
import math

import numpy as np
import pytest

from inkjet_env.experiments.bounds.verification import checking, walking
from inkjet_env.experiments.bounds.verification.__main__ import main
from inkjet_env.experiments.bounds.verification.checking import check
from inkjet_env.experiments.bounds.verification.reading import CertificateError
from tests.bounds.verified_problem import HEAD, PROBLEM, TINY, least_cost, simulated

MIDDLE = np.array([98.5, 98.5, 1.08, 10.49, 13.74, 9.81, 19.9])
HALF = np.array([1, 1, 0.05, 0.05, 0.05, 0.05, 0.05])


def tree(lower, upper, least, most, bound):
    """Bytes of a tree by greedy halving, with the bound that is verified."""
    centre, radius = (lower + upper) / 2, (upper - lower) / 2
    scaled = radius * np.array([0.03, 0.03, 1, 1, 1, 1, 1])
    if scaled.max() <= 0.1 and least_cost(centre, radius, least, most) >= bound:
        return b"\x07"
    side = int(np.argmax(scaled))
    high, low = upper.copy(), lower.copy()
    high[side] = low[side] = centre[side]
    return bytes([side]) + tree(lower, high, least, most, bound) + tree(low, upper, least, most, bound)


def write(folder, trees, parts, bound=-24.0, **changed):
    folder.mkdir(exist_ok=True)
    lower, upper = MIDDLE - HALF, MIDDLE + HALF
    head = {"a0": HEAD.a0, "a1": HEAD.a1, "b1": HEAD.b1, "coefficients": list(HEAD.coefficients), "full_scale_V": 180.0}
    box = {
        "lower": [lower[0], -upper[1], *(lower[2:] * 1e-6)],
        "upper": [upper[0], -lower[1], *(upper[2:] * 1e-6)],
    }
    problem = {
        "name": "reduced",
        "printhead": head,
        "cost": {"A": -5.0, "B": 5.0, "effective": "largest"},
        "bounds": box,
        "initial_state": "periodic",
        "window_s": 0.00035,
    }
    problem.update(changed)
    whole = {"format": "lower-bound/1", "problem": problem, "bound_V": bound, "parts": parts}
    (folder / "certificate.json").write_text(json.dumps(whole))
    for i, data in enumerate(trees):
        (folder / f"part-{i:02}.xz").write_bytes(lzma.compress(data))
    return folder


PARTS = [[4.5, 7.0], [7.0, 40.0]]


@pytest.fixture(scope="module")
def trees():
    lower, upper = MIDDLE - HALF, MIDDLE + HALF
    box = [list(map(float, end)) for end in (lower * [1, 1, *[1e-6] * 5], upper * [1, 1, *[1e-6] * 5])]
    exact = [np.array([*end[:2], *(1e6 * t for t in end[2:])]) for end in box]
    return [tree(*exact, *part, -24.0) for part in PARTS]


@pytest.fixture
def folder(tmp_path, trees):
    return write(tmp_path / "certificate", trees, PARTS)


def refused(folder, match, capsys, *options):
    with pytest.raises(CertificateError, match=match):
        check(folder, part=int(options[1]) if options else None)
    assert main([str(folder), *options]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert match in said[-1]
    assert "Traceback" not in "".join(said)


def test_a_sound_certificate_is_accepted(folder, trees, capsys):
    summary = check(folder, workers=2)
    assert summary.whole
    assert summary.boxes == sum(map(len, trees))
    assert summary.leaves == sum(data.count(7) for data in trees)
    assert main([str(folder)]) == 0
    assert "no waveform of the problem costs less than -24 V" in capsys.readouterr().out
    assert main([str(folder), "--part", "1"]) == 0
    assert "NOT verified" in capsys.readouterr().out


def test_a_leaf_is_divided_further(tmp_path):
    assert check(write(tmp_path / "c", [b"\x07", b"\x07"], PARTS, bound=-23.2)).divisions > 0


def wide(folder, bound, parts=PARTS):
    """A certificate with leaves that leave t4 and t5 whole."""
    write(folder, [b"\x07"] * len(parts), parts, bound=bound)
    description = json.loads((folder / "certificate.json").read_text())
    for end, us in (("lower", 1e-6), ("upper", 2e-5)):
        description["problem"]["bounds"][end][5:] = [us, us]
    (folder / "certificate.json").write_text(json.dumps(description))
    return folder


def test_leaves_with_whole_durations_are_shown_by_tables(tmp_path, monkeypatch):
    summary = check(wide(tmp_path / "c", -26.0), resolution=TINY, workers=2)
    assert summary.whole
    assert summary.bounds[0] > 0
    monkeypatch.setattr(walking, "BOXES_MOST", 50)
    with pytest.raises(CertificateError, match="the claim of leaf 1 of part 0 could not be shown"):
        check(wide(tmp_path / "false", -15.0, [[2.9, 7.0], [7.0, 40.0]]), resolution=TINY)


@pytest.mark.parametrize("part", [0, 1])
def test_a_missing_byte_is_refused(tmp_path, trees, part, capsys):
    cut = [data[:-1] if i == part else data for i, data in enumerate([b"\x00\x07\x07"] * 2)]
    refused(write(tmp_path / "c", cut, PARTS), f"part-{part:02}.xz: its tree ends before its last box", capsys)


def test_damage_is_refused_before_the_long_work(tmp_path, monkeypatch):
    def begun(*_):
        raise AssertionError("The long work has begun.")

    monkeypatch.setattr(checking, "_table_maker", begun)
    with pytest.raises(CertificateError, match=r"part-01\.xz: its tree ends before its last box"):
        check(write(tmp_path / "c", [b"\x00\x07\x07", b"\x00\x07"], PARTS))


def test_bytes_after_the_tree_are_refused(tmp_path, capsys):
    refused(write(tmp_path / "c", [b"\x07\x07", b"\x07"], PARTS), "part-00.xz: something follows the end", capsys)


def test_other_bytes_are_refused(tmp_path, capsys):
    refused(write(tmp_path / "c", [b"\x00\x08\x07", b"\x07"], PARTS), "part-00.xz: byte 1 is none of 0 to 7", capsys)


def test_a_false_claim_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(walking, "BOXES_MOST", 50)
    lowest = min(simulated(MIDDLE + HALF * f)[0] for f in np.random.default_rng(0).uniform(-1, 1, (50, 7)))
    wrong = write(tmp_path / "c", [b"\x00\x07\x07", b"\x07"], PARTS, bound=min(0.0, lowest + 1.0))
    description = json.loads((wrong / "certificate.json").read_text())
    description["parts"] = [[0.1, 7.0], [7.0, 40.0]]
    (wrong / "certificate.json").write_text(json.dumps(description))
    refused(wrong, "part-00.xz: the claim of leaf 1 of part 0 could not be shown", capsys)


def test_a_gap_between_parts_is_refused(folder, trees, capsys):
    refused(write(folder, trees, [[4.5, 7.0], [7.1, 40.0]]), "no part covers", capsys)
    refused(write(folder, trees, [[4.9, 7.0], [7.0, 40.0]]), "no part covers", capsys)
    refused(write(folder, trees, [[4.5, 7.0]]), "no part covers", capsys)


def test_a_missing_part_is_refused(folder, capsys):
    (folder / "part-01.xz").unlink()
    refused(folder, "part-01.xz: is missing", capsys)
    refused(folder, "has no part 7", capsys, "--part", "7")


def test_rubbish_is_refused(folder, capsys):
    sound = (folder / "part-00.xz").read_bytes()
    (folder / "part-00.xz").write_bytes(b"rubbish, long enough for a header")
    refused(folder, "part-00.xz: is no sound xz file", capsys)
    (folder / "part-00.xz").write_bytes(sound[:-9])
    refused(folder, "part-00.xz: is", capsys)
    (folder / "part-00.xz").write_bytes(sound + b"more")
    refused(folder, "part-00.xz: something follows", capsys)
    (folder / "certificate.json").write_text("{")
    refused(folder, "certificate.json: is no JSON", capsys)
    (folder / "certificate.json").write_text('{"format": "lower-bound/2"}')
    refused(folder, "certificate.json: the certificate lacks", capsys)


def test_a_changed_printhead_is_refused(folder, trees, capsys):
    head = {"a0": HEAD.a0, "a1": HEAD.a1, "b1": HEAD.b1, "coefficients": list(HEAD.coefficients), "full_scale_V": 180.0}
    refused(write(folder, trees, PARTS, printhead=head | {"b1": 4 * HEAD.b1}), "no part covers", capsys)
    refused(write(folder, trees, PARTS, printhead=head | {"coefficients": [1.0, -3.0, 1.0, 0.0]}), "may fall", capsys)
    refused(write(folder, trees, PARTS, printhead=head | {"spread": 0.1}), "'spread', which", capsys)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"initial_state": "rest"}, "the initial state is not 'periodic'"),
        ({"cost": {"A": -5.0, "B": 5.0, "effective": "second"}}, "the effective extremum is not the 'largest'"),
        ({"cost": {"A": -5.0, "B": 0.5, "effective": "largest"}}, "B is below 1"),
        ({"jetting_Hz": 1e4}, "'jetting_Hz', which this verification does not cover"),
        ({"window_s": 5e-5}, "may be longer than the window"),
        ({"window_s": True}, "window_s is no number"),
    ],
)
def test_other_problems_are_refused(folder, trees, change, sentence, capsys):
    refused(write(folder, trees, PARTS, **change), sentence, capsys)


def test_ctrl_c_ends_with_130(folder, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(checking, "check_cover", interrupted)
    assert main([str(folder)]) == 130
    assert math.isfinite(PROBLEM.peak_V)
