"""The two swarms against their equations, written down a second time."""

import numpy as np
import pytest

from inkjet_env import optimizers
from inkjet_env.optimizers.loop import minimise


class Ripples:
    def evaluate(self, points):
        return ((points - 0.4) ** 2).sum(axis=1) + 0.3 * np.sin(8 * points).sum(axis=1)


def swarm(seed, budget, particles, pull, draws):
    """Every point of a swarm by its equations, particle by particle."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (particles, 7))
    v = 0.5 * (rng.uniform(-1, 1, (particles, 7)) - x)
    own, own_cost, visited = x.copy(), np.full(particles, np.inf), []
    while len(visited) < budget:
        for i, cost in enumerate(Ripples().evaluate(x)):
            visited.append(x[i].copy())
            if cost < own_cost[i]:
                own[i], own_cost[i] = x[i], cost
        leader = own[np.argmin(own_cost)].copy()
        r = rng.random((2, particles, 7)) if draws else np.ones((2, particles, 7))
        for i in range(particles):
            v[i] = 0.7298 * v[i] + pull * r[0, i] * (own[i] - x[i]) + pull * r[1, i] * (leader - x[i])
            for k in range(7):
                x[i, k] += v[i, k]
                if abs(x[i, k]) > 1:
                    x[i, k], v[i, k] = np.sign(x[i, k]), 0.0
    return np.array(visited[:budget])


@pytest.mark.parametrize(("name", "pull", "draws"), [("pso", 1.49618, True), ("pso-printed", 0.74809, False)])
def test_a_swarm_visits_the_points_that_its_equations_say(name, pull, draws):
    run = minimise(Ripples(), optimizers.make(name, budget=130, seed=11, particles=12), 130)
    np.testing.assert_allclose(run.points, swarm(11, 130, 12, pull, draws), rtol=0, atol=1e-12)


def test_a_generation_is_the_whole_swarm():
    assert optimizers.make("pso").ask().shape == (40, 7)
    assert optimizers.make("pso", particles=9).ask().shape == (9, 7)


def test_the_printed_swarm_draws_nothing_after_its_start():
    optimizer = optimizers.make("pso-printed", budget=400, seed=2)
    optimizer.ask()
    state = optimizer.rng.bit_generator.state
    while optimizer.remaining:
        points = optimizer.ask()
        optimizer.tell(points, Ripples().evaluate(points))
    assert optimizer.rng.bit_generator.state == state


def test_the_usual_swarm_draws_every_generation():
    optimizer = optimizers.make("pso", budget=400, seed=2)
    points = optimizer.ask()
    state = optimizer.rng.bit_generator.state
    optimizer.tell(points, Ripples().evaluate(points))
    assert optimizer.rng.bit_generator.state != state
