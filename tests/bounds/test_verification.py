"""The verification's response and bounds agree with the simulator, with which they share no code."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

from inkjet_env.experiments.bounds import verification
from inkjet_env.experiments.bounds.verification import enclosing, walking
from tests.bounds.verified_problem import (
    BEST,
    HEAD,
    LOWER,
    PROBLEM,
    UPPER,
    followed,
    least_cost,
    random_waveforms,
    simulated,
)

ALLOWED = ("numpy", "numba", "scipy", "inkjet_env.progress", "inkjet_env.storage", verification.__name__)


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
