"""The verification's tables are below what the rest of a waveform costs."""

import math
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest

from inkjet_env.experiments.bounds.verification import arriving, enclosing, walking
from inkjet_env.experiments.bounds.verification.tables import Resolution, table_maker
from tests.bounds.verified_problem import BEST, LOWER, PROBLEM, TINY, UPPER, followed, random_waveforms, simulated

RUNNING = np.zeros(1, np.int64)
NUMBERS = (PROBLEM.k, PROBLEM.law, PROBLEM.sup1, PROBLEM.sup2)


def made(lower, resolution, ends):
    """Tables for ranges of the largest |extremum| between ``ends``."""
    maker = table_maker(*NUMBERS, float(PROBLEM.peak_V), tuple(lower), tuple(UPPER), resolution)
    found = {limits: maker.part_tables() for limits in pairwise(ends)}
    with ThreadPoolExecutor(1) as pool:
        submitted = list(maker.fill_base(RUNNING, pool))
        for limits, own in found.items():
            submitted += maker.fill_part(own, *limits, RUNNING, pool)
    for future in submitted:
        future.result()
    return found


@pytest.fixture(scope="module")
def tables():
    """Tables for ranges that cover all values."""
    return made(LOWER, TINY, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 7.5, 9.0, 12.0, 25.0])


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
                dwell, centre, radius, least, most, *NUMBERS, of_part, *memory[:12], *memory[18:]
            )
            within = [cost for cost, largest in found if least <= largest <= most]
            assert all(bound <= cost + 1e-6 for cost in within)
            shown += -20 < bound < math.inf
    assert shown > 20


@pytest.mark.parametrize(
    ("before", "most_below_V"),
    [(BEST[:6], 0.3), (np.array([98.41, 99.97, 1.8935, 10.4623, 13.4218, 18.2008]), 0.5)],
    ids=["best known", "nearly at rest before the last edge"],
)
def test_the_tables_are_close(before, most_below_V):
    """How often a leaf has to be halved further, and so how long a verification takes, depends on it."""
    memory = walking.memory()
    least = min(simulated(np.append(before, t5))[0] for t5 in [*np.linspace(1, 20, 400), BEST[6]])
    centre, radius = np.append(before, 10.5), np.array([1e-9] * 6 + [9.5])
    (of_part,) = made([*LOWER[:1], 98.0, *LOWER[2:]], Resolution(), [6.2, 7.2]).values()
    bound = arriving.arriving_cost(
        False, centre, radius, 6.2, 7.2, *NUMBERS, of_part, *memory[:12], *memory[18:]
    )  # fmt: skip
    assert least - most_below_V <= bound <= least
