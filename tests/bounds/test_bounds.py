"""Lower bounds hold for every waveform of a box, and a proof covers the whole box of a problem."""

import json
import lzma
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.problem import Problem, Spread
from inkjet_env.experiments.bounds import search, summary
from inkjet_env.experiments.bounds.box_bound import NOTHING, WINDOW_COLUMNS, prefix_bound, whole_bound
from inkjet_env.experiments.bounds.cost_to_go import Grid, edge_table, ring_down
from inkjet_env.experiments.bounds.head_numbers import OMEGA, SIGMA, head_numbers, polynomial_range
from inkjet_env.experiments.bounds.table_cells import CELL_COLUMNS, DONE, LEVELS, look_up
from inkjet_env.experiments.bounds.tables import Tables, _levels, with_unions
from inkjet_env.experiments.bounds.task import Settings, parts_of, task_of
from inkjet_env.experiments.bounds.trajectory import NODE_COLUMNS, PARAMETERS, Y, follow
from inkjet_env.experiments.bounds.tree import PROVEN
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform

HEAD = Printhead.published()
ROW = head_numbers(HEAD)
WEIGHTS = (-5.0, 5.0)
LOWER, UPPER = np.array([0, 0, 1, 1, 1, 1, 1.0]), np.array([100, 100, 20, 20, 20, 20, 20.0])
BEST = np.array(
    [100, 100, 1.0000000109989415, 10.48994805910811, 13.743827858249958, 9.814569003260661, 19.958894154308322]
)
BEST_V = -22.832046
SMALL = Settings(width=0.5, voltages=(0.0, 0.5, 1.0), angles=64, turn=8, table_levels=1, table_step=0.5, pieces=3)


def response_to(point):
    return HEAD.respond(Waveform(point[0], -point[1], *(1e-6 * point[2:])))


def around(point, share):
    """A box around a waveform within those of the problem, so wide a share of them on either side."""
    reach = share * (UPPER - LOWER)
    return np.maximum(point - reach, LOWER), np.minimum(point + reach, UPPER)


def problem_of(low, high, **changes):
    bounds = Bounds((low[0], -high[1], *(1e-6 * low[2:])), (high[0], -low[1], *(1e-6 * high[2:])))
    return Problem("narrow", bounds=bounds, **changes)


def scratch():
    return (
        np.zeros((20000, NODE_COLUMNS)), np.zeros(1 + PARAMETERS, complex), np.zeros(2), np.zeros(3),
        np.zeros((80, WINDOW_COLUMNS)),
    )  # fmt: skip


def test_the_trajectory_is_that_of_the_simulator():
    rng = np.random.default_rng(0)
    nodes, end, reach, *_ = scratch()
    for _ in range(20):
        point = LOWER + (UPPER - LOWER) * rng.random(7)
        last = follow(ROW, 5, point, point, 0.02, 0.5, nodes, end, reach)
        assert reach[0] == 0
        response = response_to(point)
        # free after the drive: from z there follow all further peaks
        times = response.peak_times_s * 1e6 - point[2:].sum()
        later = times > 0
        z = end[0] * np.exp(complex(-ROW[SIGMA], ROW[OMEGA]) * times[later])
        np.testing.assert_allclose(z.imag, response.peaks_V[later], atol=1e-9)
        assert abs(nodes[: last + 1, Y]).max() <= abs(response.peaks_V).max() + 1e-9


def test_the_derivatives_at_the_end_are_differences():
    nodes, end, reach, *_ = scratch()
    rng = np.random.default_rng(1)
    for _ in range(5):
        point = LOWER + (UPPER - LOWER) * rng.uniform(0.1, 0.9, 7)
        follow(ROW, 5, point, point, 0.02, 0.5, nodes, end, reach)
        told = end.copy()
        for k in range(7):
            step = np.zeros(7)
            step[k] = 1e-5 * (UPPER - LOWER)[k]
            sides = []
            for sign in (-1, 1):
                follow(ROW, 5, point + sign * step, point + sign * step, 0.02, 0.5, nodes, end, reach)
                sides.append(end[0])
            np.testing.assert_allclose((sides[1] - sides[0]) / (2 * step[k]), told[1 + k], atol=1e-6)


def test_the_ring_down_counts_its_extrema():
    sigma, omega = ROW[SIGMA], ROW[OMEGA]
    ratio, upright = math.exp(-sigma * math.pi / omega), omega / math.hypot(sigma, omega)
    total, following, first, alone = ring_down(ROW, WEIGHTS, 100.0, 350.0)
    for phase in np.linspace(0, 2 * math.pi, 50, endpoint=False):
        soonest = (math.pi / 2 + math.atan2(sigma, omega) - phase) % math.pi / omega  # Im(λ z) = 0
        when = np.arange(soonest, 250.0, math.pi / omega)
        heights = np.abs((np.exp(1j * phase) * np.exp(complex(-sigma, omega) * when)).imag)
        assert heights[0] >= first == pytest.approx(upright * ratio)
        assert heights.sum() >= total
        assert 5 * heights[0] + heights[1:].sum() >= following
        assert -5 * heights[0] + 5 * heights[1] + heights[2:].sum() >= alone * heights[0] - 1e-12
    assert total > 0.95 * heights.sum() * ratio


@pytest.mark.parametrize("share", [1e-6, 0.01, 0.2])
def test_no_waveform_of_a_box_costs_less_than_its_bound(share):
    rng = np.random.default_rng(2)
    ring = ring_down(ROW, WEIGHTS, 100.0, 350.0)
    room = scratch()
    gaps = []
    for trial in range(60):
        middle = BEST if trial % 4 == 0 else LOWER + (UPPER - LOWER) * rng.random(7)
        low, high = around(middle, share)
        bound = whole_bound(ROW, WEIGHTS, ring, (0.0, 100.0), 1e9, low, high, (0.02, 0.5), *room)
        costs = [response_to(low + (high - low) * rng.random(7)).cost() for _ in range(5)]
        assert bound <= min(costs) + 1e-9
        if middle is BEST:
            gaps.append(min(costs) - bound)
    if share == 1e-6:
        assert max(gaps) < 0.01


def test_limits_of_the_largest_extremum_leave_out_only_others():
    rng = np.random.default_rng(3)
    ring = ring_down(ROW, WEIGHTS, 100.0, 350.0)
    room, left_out = scratch(), 0
    for _ in range(100):
        low, high = around(LOWER + (UPPER - LOWER) * rng.random(7), 0.01)
        inside = [response_to(low + (high - low) * rng.random(7)) for _ in range(5)]
        largest = float(np.abs(inside[0].peaks_V).max())
        for limits in ((0.9 * largest, 1.1 * largest), (1.3 * largest, 1.4 * largest)):
            bound = whole_bound(ROW, WEIGHTS, ring, limits, 1e9, low, high, (0.02, 0.5), *room)
            for one in inside:
                if limits[0] <= np.abs(one.peaks_V).max() <= limits[1]:
                    assert bound <= one.cost() + 1e-9
            left_out += bound > 1e200
    assert left_out > 50


@pytest.mark.parametrize("longest_us", [20.0, 40.0])
def test_nothing_after_the_dwell_costs_less_than_its_table(longest_us):
    rng = np.random.default_rng(4)
    ring, grid = ring_down(ROW, WEIGHTS, 80.0 + longest_us, 350.0), Grid(64, 8, largest=30.0)
    shape, shortest_us = (grid.angles, grid.step(ROW), grid.smallest), longest_us - 2.0
    table, inner = np.full((grid.labels(ROW), grid.angles, 3), np.inf), np.zeros(3)
    edge_table(
        ROW, WEIGHTS, ring, 49.0, 51.0, (shortest_us, longest_us), 2, 0.35, shape, (0.0, 100.0), (DONE, DONE), table,
        inner,
    )  # fmt: skip
    nodes, end, reach = scratch()[:3]
    cells, shares = np.zeros((10, CELL_COLUMNS)), []
    for _ in range(50):
        point = LOWER + (UPPER - LOWER) * rng.random(7)
        point[1], point[6] = rng.uniform(49.0, 51.0), rng.uniform(shortest_us, longest_us)
        follow(ROW, 4, point, point, 0.02, 0.5, nodes, end, reach)
        assert look_up(ROW, (table,) * LEVELS, inner, shape, end[0], 1e-9, 12.0, cells, np.int64(0)) >= 1
        found = response_to(point)
        paid = np.abs(found.peaks_V[1e6 * found.peak_times_s > point[2:6].sum()]).sum()
        assert cells[0, 3 + DONE] <= paid + 1e-9
        shares.append(cells[0, 3 + DONE] / paid)
    assert np.median(shares) > 0.5


def test_unions_have_the_least_of_their_ranges():
    values = np.random.default_rng(5).normal(size=(5, 3))
    found = with_unions(values)
    assert len(found) == 5 + 3 + 2 + 1
    np.testing.assert_array_equal(found[:5], values)
    np.testing.assert_array_equal(found[5:8], [values[:2].min(axis=0), values[2:4].min(axis=0), values[4]])
    np.testing.assert_array_equal(found[8:], [values[:4].min(axis=0), values[4], values.min(axis=0)])


def test_no_waveform_of_a_box_costs_less_than_tables_tell(tmp_path):
    rng = np.random.default_rng(6)
    settings = replace(SMALL, voltages=(0.0, 0.2, 0.4, 0.6, 0.8, 0.99, 1.0), angles=128, turn=12, table_levels=3)
    ready = Tables(task_of(problem_of(LOWER, UPPER)), settings, 2)
    ready.prepare(tmp_path)
    tables, limits, gaps = ready.for_part((0.0, 100.0)), (0.0, 100.0), []
    room, cells, told = scratch(), np.zeros((5000, CELL_COLUMNS)), 0
    for trial in range(40):
        segments, share = 3 + trial % 2, (1e-6, 0.01, 0.1)[trial % 3]
        at_best = trial in (0, 6, 9, 24)
        low, high = around(BEST if at_best else LOWER + (UPPER - LOWER) * rng.random(7), share)
        if trial % 4 == 0:  # U2 over several ranges
            low[1], high[1] = (30 + trial, 100) if at_best else np.sort(rng.uniform(0, 100, 2))
        low[2 + segments :], high[2 + segments :] = LOWER[2 + segments :], UPPER[2 + segments :]
        bound = prefix_bound(
            ROW, WEIGHTS, limits, 1e9, np.int64(segments), low, high, (0.05, 0.5), tables[segments - 3],
            tables[segments - 1], ready.low_b, ready.high_b, ready.shape, 12.0, *room, cells,
        )  # fmt: skip
        costs = [response_to(low + (high - low) * rng.random(7)).cost() for _ in range(20)]
        assert bound <= min(costs) + 1e-9
        told += bound > NOTHING
        if at_best:
            assert bound <= BEST_V + 1e-6
        if at_best and trial % 4:
            gaps.append(BEST_V - bound)
    assert told > 35
    assert len(gaps) == 2
    assert max(gaps) < 0.5


@pytest.mark.parametrize("number", [1, 2, 5, 8, 9])
def test_a_box_looks_up_the_tables_of_its_ranges_of_u2_and_of_no_other(number):
    grid = Grid(64, 8, largest=task_of(problem_of(LOWER, UPPER)).highest)
    ends = np.linspace(0.0, 100.0, number + 1)
    size = (grid.labels(ROW), grid.angles, 3)
    room, cells = scratch(), np.zeros((5000, CELL_COLUMNS))

    def bound_with(values, low, high):
        """With tables that hold the same value for all states."""
        tables = _levels(np.array([np.full(size, value, np.float32) for value in values]))
        inner = with_unions(np.repeat(values[:, None], 3, axis=1))
        return prefix_bound(
            ROW, WEIGHTS, (0.0, 100.0), 1e9, np.int64(3), low, high, (0.2, 1.0), tables, inner, ends[:-1].copy(),
            ends[1:].copy(), (grid.angles, grid.step(ROW), grid.smallest), 12.0, *room, cells,
        )  # fmt: skip

    for first in range(number):
        for last in range(first, number):
            low, high = around(BEST, 1e-3)
            low[1], high[1] = ends[first] + 1.0, ends[last + 1] - 1.0
            within = np.zeros(number, bool)
            within[first : last + 1] = True
            nothing = bound_with(np.zeros(number), low, high)
            assert bound_with(np.where(within, 0.0, -50.0), low, high) == nothing
            for one in np.flatnonzero(within):
                low_there = np.where(np.arange(number) == one, -50.0, 0.0)
                assert bound_with(low_there, low, high) < nothing - 40.0


@pytest.mark.parametrize("growth", [1.0, 1.3])
def test_parts_reach_from_where_nothing_can_cost_less_to_the_highest_extremum(growth):
    task = task_of(problem_of(LOWER, UPPER))
    parts = parts_of(task, -24.0, 0.1, growth)
    assert parts[0][0] == pytest.approx(24.0 / 5, abs=1e-12)
    assert parts[-1][1] == task.highest
    widths = [math.log(high / low) for low, high in parts]
    np.testing.assert_allclose(np.divide(widths[1:], widths[:-1]), growth)
    assert 0.05 < widths[0] <= 0.1 + 1e-12
    assert all(one[1] == other[0] for one, other in pairwise(parts))
    assert parts_of(task, -5.01 * task.highest, 0.1, growth) == []


def test_a_polynomial_lies_within_its_range():
    rng = np.random.default_rng(4)
    for _ in range(50):
        law = rng.normal(size=6)
        low, high = np.sort(rng.random(2))
        least, most = polynomial_range(law, low, high)
        values = np.polynomial.polynomial.polyval(np.linspace(low, high, 101), law)
        assert least <= values.min()
        assert values.max() <= most


def trees(folder):
    header = json.loads((folder / "certificate.json").read_text())
    files = [folder / f"part-{k:02}.xz" for k in range(len(header["parts"]))]
    return header, [lzma.decompress(file.read_bytes()) for file in files]


def leaves_of(tree, low, high):
    """The leaves of a tree in preorder, each with its corners."""
    stack, leaves = [(low, high)], []
    for symbol in tree:
        low, high = stack.pop()
        if symbol == PROVEN:
            leaves.append((low, high))
            continue
        middle = 0.5 * (low[symbol] + high[symbol])
        below, above = high.copy(), low.copy()
        below[symbol] = above[symbol] = middle
        stack += [(above, high), (low, below)]
    assert not stack
    return leaves


@pytest.fixture(scope="module")
def proven(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bound")
    low, high = around(BEST, 0.03)
    search.Search(folder, problem_of(low, high), -24.5, 2, SMALL).run()
    return folder, low, high


def test_a_proof_covers_every_waveform(proven):
    folder, low, high = proven
    header, found = trees(folder)
    ends = np.array(header["parts"])
    assert ends[0, 0] == pytest.approx(header["bound_V"] / -5)
    assert (ends[1:, 0] == ends[:-1, 1]).all()
    assert ends[-1, 1] >= HEAD.b1 / HEAD.frequency_Hz / 2 / math.pi * 400 * 0.5
    volume = np.prod(high - low)
    rng = np.random.default_rng(5)
    for tree in found:
        leaves = leaves_of(tree, low, high)
        assert sum(np.prod(above - below) for below, above in leaves) == pytest.approx(volume)
    for _ in range(20):
        assert response_to(low + (high - low) * rng.random(7)).cost() >= header["bound_V"]
    assert {len(tree) for tree in found} != {15}, "one part at least must be divided further than into its pieces"


def test_a_proof_that_is_interrupted_goes_on_and_is_the_same(proven, tmp_path, monkeypatch):
    folder, low, high = proven

    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(search.Search, "_join", stopped)
        with pytest.raises(KeyboardInterrupt):
            search.Search(tmp_path, problem_of(low, high), -24.5, 1, SMALL).run()
    assert len(list((tmp_path / "part-00").glob("*.xz"))) == 8
    (tmp_path / "part-00" / "0003.xz").unlink()
    search.Search(tmp_path, problem_of(low, high), -24.5, 1, SMALL).run()
    assert trees(tmp_path) == trees(folder)
    with pytest.raises(ValueError, match="another problem, bound or division"):
        search.Search(tmp_path, problem_of(low, high), -23.0, 1, SMALL)


def test_what_a_proof_took_is_told(proven, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(summary, "best_known_cost", {"narrow": -22.832}.get)
    folder, _, _ = proven
    summary.main([str(folder), "--json", str(tmp_path / "bounds.json")])
    told = [cell.strip() for cell in capsys.readouterr().out.splitlines()[-1].strip("|").split("|")]
    _, found = trees(folder)
    boxes = sum(map(len, found))
    assert told[2:6] == ["-24.5", "1.668", str(len(found)), f"{boxes:,}"]
    (kept,) = json.loads((tmp_path / "bounds.json").read_text())["bounds"]
    assert kept["boxes"] == boxes
    searched_s = sum(json.loads(file.read_text())["seconds"] for file in folder.glob("part-*.json"))
    tables_s = json.loads((folder / "tables.json").read_text())["seconds"]
    assert 3600 * kept["hours"] == pytest.approx(searched_s + tables_s)
    assert min(searched_s, tables_s) > 0


def test_an_unfinished_proof_has_no_summary(tmp_path, capsys):
    with pytest.raises(SystemExit):
        summary.main([str(tmp_path)])
    assert "certificate.json: there is no such file. Let the search end first." in capsys.readouterr().err
    (tmp_path / "certificate.json").write_text('{"parts": 3}')
    with pytest.raises(SystemExit):
        summary.main([str(tmp_path)])
    assert "its files are not those of a search" in capsys.readouterr().err


def test_a_bound_above_the_least_cost_is_not_proven(tmp_path):
    low, high = around(BEST, 0.02)
    with pytest.raises(ValueError, match=r"-22\.802 V is not proven: .*100.*Give a lower bound"):
        search.Search(tmp_path, problem_of(low, high), BEST_V + 0.03, 1, replace(SMALL, deepest=40)).run()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"jetting_Hz": 5e3}, "follow one another"),
        ({"spread": Spread()}, "several heads"),
        ({"cost": PeakCost(effective="first")}, "not the largest"),
        ({"cost": PeakCost(B=0.5)}, "weights"),
        ({"cost": PeakCost(target_height_V=4.0)}, "target height"),
        ({"window_s": 50e-6}, "window"),
        ({"printhead": replace(HEAD, coefficients=(2.0, -2.5, 0.8, 0.0))}, "falls"),
    ],
)
def test_what_no_bound_is_for_is_refused(changes, why):
    with pytest.raises(ValueError, match=why):
        task_of(problem_of(LOWER, UPPER, **changes))
