"""Verification of certificates of a lower bound of the cost: its formulas, its bounds, and what it refuses."""

import ast
import json
import lzma
import math
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from inkjet_env.experiments.bounds import verification
from inkjet_env.experiments.bounds.verification import arriving, checking, courses, enclosing, walking
from inkjet_env.experiments.bounds.verification.__main__ import main
from inkjet_env.experiments.bounds.verification.checking import check
from inkjet_env.experiments.bounds.verification.reading import Certificate, CertificateError
from inkjet_env.experiments.bounds.verification.tables import Resolution, table_maker
from inkjet_env.printhead import Printhead, Waveform

HEAD = Printhead.published()
BEST = np.array(
    [100, 100, 1.0000000109989415, 10.48994805910811, 13.743827858249958, 9.814569003260661, 19.958894154308322]
)
LOWER = np.array([0, 0, 1, 1, 1, 1, 1], float)
UPPER = np.array([100, 100, 20, 20, 20, 20, 20], float)
MIDDLE = np.array([98.5, 98.5, 1.08, 10.49, 13.74, 9.81, 19.9])
HALF = np.array([1, 1, 0.05, 0.05, 0.05, 0.05, 0.05])
ALLOWED = ("numpy", "numba", "scipy", "inkjet_env.progress", "inkjet_env.storage", verification.__name__)


def certificate(lower=LOWER, upper=UPPER, bound=-24.0, parts=((0.0, 40.0),)):
    numbers = (HEAD.a0, HEAD.a1, HEAD.b1, tuple(HEAD.coefficients), HEAD.full_scale_V, -5.0, 5.0)
    return Certificate(*numbers, tuple(lower), tuple(upper), 350.0, bound, tuple(parts))


PROBLEM = checking.problem_of(certificate())


def simulated(p):
    response = HEAD.respond(Waveform(p[0], -p[1], *(1e-6 * p[2:])))
    return response.cost(), np.abs(response.peaks_V).max(), response


def least_cost(centre, radius, least=0.0, most=40.0):
    memory = walking.memory()
    numbers = (PROBLEM.k, PROBLEM.law, PROBLEM.sup1, PROBLEM.sup2)
    return courses.least_cost(centre, radius, least, most, *numbers, *memory[:12])


def followed(p, ring_us=40.0):
    z, dz, rest, seconds, cell = walking.memory()[:5]
    numbers = (PROBLEM.k, PROBLEM.law, PROBLEM.sup1, PROBLEM.sup2, ring_us)
    z[0], dz[0], rest[0] = 0.0, 0.0, 0.0
    n = enclosing.follow(0, 5, enclosing.CELL_US, np.array(p, float), np.zeros(7), *numbers, z, dz, rest, seconds, cell)
    return z[: n + 1].copy(), dz[: n + 1].copy(), seconds[:n, 0], rest[: n + 1].copy()


def random_waveforms(number, seed=0):
    rng = np.random.default_rng(seed)
    return LOWER + (UPPER - LOWER) * rng.random((number, 7))


def test_it_imports_no_simulator_and_no_search():
    names = set()
    for file in Path(verification.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0
                names.add(node.module)
    outside = [name for name in names if not name.startswith(ALLOWED)]
    assert [name for name in outside if name.split(".")[0] not in sys.stdlib_module_names] == []


def law_at(x):
    """The branch law by its definition, straight beyond the full scale."""
    law = np.array(HEAD.coefficients)
    inside = np.minimum(x, 1.0)
    return np.polyval(law, inside) + (x - inside) * np.polyval(np.polyder(law), 1.0)


def test_the_hysteretic_drive_agrees_with_the_simulator():
    scale = HEAD.full_scale_V
    for p in [BEST, *random_waveforms(10, 6)]:
        a, b = p[:2]
        ends = np.concatenate([[0], np.cumsum(p[2:])])
        f = np.linspace(0, 1, 7)
        response = simulated(p)[2]
        edges = [
            (0, law_at((b + a * f) / scale)),
            (2, -law_at((a + b) * f / scale)),
            (4, law_at(b * f / scale)),
        ]
        for part, expected in edges:
            v = response.hysteretic_V(1e-6 * (ends[part] + p[2 + part] * f))
            assert v - v[0] == pytest.approx(scale * (expected - expected[0]), abs=1e-9)


def test_the_response_agrees_with_the_simulator():
    for p in [BEST, *random_waveforms(30)]:
        z, _, steps, _ = followed(p)
        times = np.concatenate([[0], np.cumsum(steps)])
        assert simulated(p)[2].sensor_V(1e-6 * times) == pytest.approx(z.imag, abs=1e-9)


def test_the_response_after_the_drive_is_exact():
    sigma, omega = PROBLEM.k[enclosing.SIGMA], PROBLEM.k[enclosing.OMEGA]
    lam = complex(-sigma, omega)
    for p in random_waveforms(30, 1):
        z, _, steps, _ = followed(p, 1.0)
        times = np.concatenate([[0], np.cumsum(steps)])
        end = z[np.argmin(abs(times - p[2:].sum()))]
        response = simulated(p)[2]
        late = 1e6 * response.peak_times_s > p[2:].sum() + 1e-6
        free = (end * np.exp(lam * (1e6 * response.peak_times_s[late] - p[2:].sum()))).imag
        assert free == pytest.approx(response.peaks_V[late], abs=1e-9)


def test_the_derivatives_agree_with_differences():
    for p in random_waveforms(5, 2):
        z, dz, _, _ = followed(p, 5.0)
        for j in range(7):
            step = np.zeros(7)
            step[j] = 1e-5
            up, down = followed(p + step, 5.0)[0], followed(p - step, 5.0)[0]
            if len(up) == len(down) == len(z):
                assert dz[:, j] == pytest.approx((up - down) / 2e-5, abs=1e-6)


def test_second_derivatives_are_bounded():
    rng = np.random.default_rng(3)
    memory = walking.memory()
    compared = 0
    for p in random_waveforms(40, 3):
        radius = np.array([2, 2, 0.2, 0.2, 0.2, 0.2, 0.2])
        z, dz, rest, seconds, cell = memory[:5]
        numbers = (PROBLEM.k, PROBLEM.law, PROBLEM.sup1, PROBLEM.sup2, 5.0)
        centre = np.clip(p, LOWER + radius, UPPER - radius)
        if centre[0] + centre[1] + 4 > HEAD.full_scale_V:
            continue  # the nodes of two waveforms are at different places
        z[0], dz[0], rest[0] = 0.0, 0.0, 0.0
        way = (0, 5, enclosing.CELL_US)
        n = enclosing.follow(*way, centre, radius, *numbers, z, dz, rest, seconds, cell)
        for _ in range(20):
            off = radius * rng.uniform(-1, 1, 7)
            other, parts = np.zeros_like(z), np.empty_like(cell)
            scratch = (other, dz.copy(), rest.copy(), seconds.copy(), parts)
            here = enclosing.follow(*way, centre + off, radius, *numbers, *scratch)
            if here == n and np.array_equal(cell[:n], parts[:n]):
                compared += 1
                assert np.all(abs(other[: n + 1] - z[: n + 1] - dz[: n + 1] @ off) <= rest[: n + 1] + 1e-12)
    assert compared > 10


def test_bounds_are_below_the_costs_of_sampled_waveforms():
    rng = np.random.default_rng(4)
    for i in range(40):
        size = 10 ** rng.uniform(-3, 0.8)
        radius = np.minimum(size * np.array([2, 2, 0.07, 0.07, 0.07, 0.07, 0.07]) * rng.random(7), (UPPER - LOWER) / 2)
        centre = random_waveforms(1, 100 + i)[0]
        if i % 3 == 0:
            centre = BEST + rng.normal(size=7) * radius
        if i % 5 == 0:
            centre[:2] = rng.choice([0.0, 1.0, 20.0, 79.0], 2)
        centre = np.clip(centre, LOWER + radius, UPPER - radius)
        samples = [centre + radius * np.clip(rng.uniform(-1.4, 1.4, 7), -1, 1) for _ in range(9)]
        found = [simulated(p)[:2] for p in samples]
        assert least_cost(centre, radius) <= min(cost for cost, _ in found) + 1e-6
        middle = np.median([largest for _, largest in found])
        for least, most in ((0.0, middle), (middle, 40.0), (0.9 * middle, 1.1 * middle)):
            within = [cost for cost, largest in found if least <= largest <= most]
            bound = least_cost(centre, radius, least, most)
            assert all(bound <= cost + 1e-6 for cost in within)


def test_the_bound_is_close_where_the_box_is_small():
    cost = simulated(BEST)[0]
    assert cost == pytest.approx(-22.832046, abs=1e-6)
    assert cost - 0.25 < least_cost(BEST, np.zeros(7)) <= cost
    radius = 0.3 * np.array([2, 2, 0.07, 0.07, 0.07, 0.07, 0.07])
    assert least_cost(np.clip(BEST, LOWER + radius, UPPER - radius), radius) > -24


def test_no_response_is_above_the_bound_of_the_largest():
    assert max(simulated(p)[1] for p in random_waveforms(100, 5)) < PROBLEM.peak_V


TINY = Resolution(angles=64, height=0.074, core_V=0.5, step_V=25.0, levels=3)
RUNNING = np.zeros(1, np.int64)


@pytest.fixture(scope="module")
def tables():
    """Tables for ranges of the largest |extremum|, which cover all values."""
    numbers = (PROBLEM.k, PROBLEM.law, PROBLEM.sup1, PROBLEM.sup2, float(PROBLEM.peak_V))
    made = table_maker(*numbers, tuple(LOWER), tuple(UPPER), TINY)
    with ThreadPoolExecutor(1) as pool:
        for future in list(made.fill_base(RUNNING, pool)):
            future.result()
    ends = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 7.5, 9.0, 12.0, 25.0]
    return {(least, most): made.for_part(least, most, RUNNING) for least, most in pairwise(ends)}


def cell_of(grid, ends, z, b):
    """Range of b, row and column by the definition of the cells; no row for the core."""
    lam = complex(-PROBLEM.k[enclosing.SIGMA], PROBLEM.k[enclosing.OMEGA])
    angle = np.angle(lam * z) % (2 * np.pi)
    u = np.log(abs(z)) - lam.real / lam.imag * angle
    row, col = int((grid.top - u) / grid.height), int(angle / (2 * np.pi) * grid.angles)
    return int(np.clip(np.searchsorted(ends, b) - 1, 0, len(ends) - 2)), row, col


def table_values(found, dwell, z, b):
    grid = found.grid
    which, row, col = cell_of(grid, found.ends, z, b)
    base, base_core, own, own_core = (*found[5:7], *found[9:11]) if dwell else (*found[3:5], *found[7:9])
    if row >= grid.rows:
        return own_core[which, 0], *base_core[which]
    i = (which * grid.rows + row) * grid.angles + col
    return own[i, 0], *base[i]


def test_tables_are_below_the_costs_to_go(tables):
    compared = 0
    close = []
    for i, p in enumerate([BEST, *random_waveforms(100, 7)]):
        if i > 50:
            p[:2] *= 0.2
        z, _, steps, _ = followed(p, 0.1)
        times = np.concatenate([[0], np.cumsum(steps)])
        response = simulated(p)[2]
        at_us, heights = 1e6 * response.peak_times_s, abs(response.peaks_V)
        largest = heights.max()
        found = next(found for (least, most), found in tables.items() if least <= largest <= most)
        for dwell, junction in ((True, p[2:5].sum()), (False, p[2:6].sum())):
            if abs(at_us - junction).min() < 1e-6:
                continue
            state = z[np.argmin(abs(times - junction))]
            rest = heights[at_us > junction]
            to_come, passed, over = table_values(found, dwell, state, p[1])
            assert over <= rest.sum() + 1e-9
            assert passed <= rest.sum() + 4 * rest[0] + 1e-9
            close.append(rest.sum() - over)
            e = int(np.argmax(rest))
            if rest[e] == largest:
                compared += 1
                assert to_come <= rest.sum() - 6 * rest[e] + 4 * rest[e + 1] + 1e-9
    assert compared > 40
    assert np.median(close) < 15


def test_bounds_up_to_the_tables_are_below_the_costs_of_sampled_waveforms(tables):
    rng = np.random.default_rng(8)
    memory = walking.memory()
    numbers = (PROBLEM.k, PROBLEM.law, PROBLEM.sup1, PROBLEM.sup2)
    shown = 0
    for i in range(40):
        size = 10 ** rng.uniform(-3, 0.3)
        radius = size * np.array([2, 2, 0.2, 0.2, 0.2, 0.2, 0.2]) * rng.random(7)
        dwell = i % 2 == 0
        radius[5 if dwell else 6 :] = 9.5
        centre = random_waveforms(1, 200 + i)[0]
        if i % 3 == 0:
            centre = BEST + rng.normal(size=7) * radius
        if i % 5 == 0:
            centre[:2] = rng.choice([0.0, 1.0, 20.0, 79.0], 2)
        centre = np.clip(centre, LOWER + radius, UPPER - radius)
        found = [simulated(centre + radius * np.clip(rng.uniform(-1.4, 1.4, 7), -1, 1))[:2] for _ in range(10)]
        for (least, most), of_part in tables.items():
            bound = arriving.arriving_cost(
                dwell, centre, radius, least, most, *numbers, of_part, *memory[:12], *memory[18:]
            )
            within = [cost for cost, largest in found if least <= largest <= most]
            assert all(bound <= cost + 1e-6 for cost in within)
            shown += -20 < bound < math.inf
    assert shown > 20


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
    counted, part = [], checking._Part
    monkeypatch.setattr(checking, "_Part", lambda *given: counted.append(part(*given)) or counted[-1])
    assert check(wide(tmp_path / "c", -26.0), resolution=TINY, workers=2).whole
    assert sum(one.counted for one in counted)[3] > 0
    monkeypatch.setattr(walking, "BOXES_MOST", 50)
    with pytest.raises(CertificateError, match="the claim of leaf 1 of part 0 could not be shown"):
        check(wide(tmp_path / "false", -15.0, [[2.9, 7.0], [7.0, 40.0]]), resolution=TINY)


@pytest.mark.parametrize("part", [0, 1])
def test_a_missing_byte_is_refused(tmp_path, trees, part, capsys):
    cut = [data[:-1] if i == part else data for i, data in enumerate([b"\x00\x07\x07"] * 2)]
    refused(write(tmp_path / "c", cut, PARTS), f"part-{part:02}.xz: its tree ends before its last box", capsys)


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
