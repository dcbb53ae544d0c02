"""The loop with late readings: what is told when, and what is lost."""

import numpy as np
import pytest

from inkjet_env import optimizers
from inkjet_env.experiments.benchmark.late_benches import LateBenches
from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.optimizers.asynchronous import LostReadingsError, Reading, minimise_late
from inkjet_env.optimizers.base import Optimizer
from inkjet_env.optimizers.loop import NonFiniteCostError, minimise
from inkjet_env.optimizers.testing import Bowl


class Line(Optimizer):
    """Asks for 0, 0.01, 0.02 …, in batches of 4 or one by one, and keeps what it is told."""

    name = "line"

    def __init__(self, budget, in_any_order):
        super().__init__(1, budget, 0)
        self.in_any_order, self.told, self.asked, self.closed = in_any_order, [], 0, False

    def propose(self):
        self.asked += 4
        return 0.01 * np.arange(self.asked - 4, self.asked)[:, None]

    def propose_another(self):
        self.asked += 1
        return [0.01 * (self.asked - 1)]

    def learn(self, points, costs, gradients):
        self.told.append(costs.tolist())

    def learn_another(self, point, cost):
        self.told.append(cost)

    def close(self):
        self.closed = True


class Scripted:
    """Gives readings in the order of a script, whose entries are numbers, or (number, cost)."""

    def __init__(self, *script):
        self.script, self.started, self.most = list(script), [], 0

    def start(self, number, point):
        assert point == pytest.approx(0.01 * number)
        self.started.append(number)

    def wait(self):
        entry = self.script.pop(0)
        return Reading(*entry) if isinstance(entry, tuple) else Reading(entry, 10.0 + entry)


def test_one_that_takes_any_order_is_told_each_reading_at_once_and_no_slot_stays_free():
    benches, optimizer = Scripted(1, 2, 0, 4, 3), Line(5, True)
    run = minimise_late(benches, optimizer, 5, slots=3)
    assert benches.started == [0, 1, 2, 3, 4]  # the fourth as soon as one slot is free
    assert optimizer.told == [11.0, 12.0, 10.0, 14.0]  # nothing after the last
    assert run.points[:, 0].tolist() == [0.01, 0.02, 0.0, 0.04, 0.03]  # in the order in which the readings came
    assert run.costs.tolist() == [11.0, 12.0, 10.0, 14.0, 13.0]
    assert run.history == [[1, 11.0], [3, 10.0], [5, 10.0]]
    assert optimizer.closed


def test_one_that_takes_batches_is_told_when_the_last_of_a_batch_is_there():
    optimizer = Line(6, False)
    minimise_late(Scripted(2, 1, 0, 3, 5, 4), optimizer, 6, slots=3)
    assert optimizer.told == [[10.0, 11.0, 12.0, 13.0]]  # in the order in which they were asked for


def test_a_lost_reading_is_taken_again_and_at_last_counts_as_the_worst_that_was_read():
    nan = float("nan")
    benches = Scripted((0, nan), 1, (0, nan), 2, (3, nan), (0, nan), 3)
    run = minimise_late(benches, Line(4, True), 4, slots=2)
    assert benches.started == [0, 1, 0, 2, 0, 3, 3]
    assert run.costs.tolist() == [11.0, 12.0, 12.0, 13.0]
    assert run.lost.tolist() == [False, False, True, False]
    assert run.best_point.tolist() == [0.01]
    with pytest.raises(LostReadingsError, match="evaluation 0 was started 2 times, and nothing has been read yet"):
        minimise_late(Scripted((0, nan), (0, nan)), Line(4, True), 4, slots=1, attempts=2)


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="a reading came of evaluation 7, which is not under way"):
        minimise_late(Scripted((7, 1.0)), Line(4, True), 4, slots=2)
    with pytest.raises(NonFiniteCostError, match="got inf at evaluation 1"):
        minimise_late(Scripted((1, float("inf"))), Line(4, True), 4, slots=2)
    with pytest.raises(ValueError, match="needs gradients"):
        minimise_late(Scripted(), optimizers.make("lbfgsb-multistart", budget=4), 4, slots=2)
    with pytest.raises(ValueError, match="must be fresh and have the budget of the run, 5"):
        minimise_late(Scripted(), Line(4, True), 5, slots=2)


@pytest.mark.parametrize("name", ["random", "sobol", "pso", "pso-printed", "nevergrad-TwoPointsDE"])
def test_with_one_instrument_that_loses_nothing_it_finds_as_much_as_the_loop_that_waits(name):
    class Prompt:
        def start(self, number, point):
            self.next = Reading(number, float(Bowl().evaluate(point[None])[0]))

        def wait(self):
            return self.next

    late, waits = (
        np.median([of(optimizers.make(name, budget=600, seed=seed)) for seed in range(5)])
        for of in (
            lambda optimizer: minimise_late(Prompt(), optimizer, 600, slots=1).best_cost,
            lambda optimizer: minimise(Bowl(), optimizer, 600).best_cost,
        )
    )
    assert late < 2 * waits + 0.1


def test_instruments_are_at_work_while_any_order_will_do_and_wait_for_a_batch_otherwise():
    shares = []
    for by_batch in (False, True):
        optimizer = optimizers.make("pso", budget=400, seed=1)
        benches = LateBenches(Problem("nominal"), seed=2)
        run = minimise_late(benches, optimizer, 400, slots=8, by_batch=by_batch)
        assert 0 < np.isnan([reading.cost for reading in run.readings]).sum() < 60  # 5 % are lost, and taken again
        shares.append(benches.busy_s / (8 * benches.now_s))
    assert shares[0] > 0.9
    assert shares[1] < 0.85


def test_the_times_of_simulated_readings_are_those_that_were_asked_for():
    benches = LateBenches(Problem("nominal"), 3, reading_s=2.0, spread=0.3, lost=0.1, patience_s=50.0)
    for number in range(400):
        benches.start(number, np.zeros(7))
    readings, times_s = [], []
    for _ in range(400):
        readings.append(benches.wait())
        times_s.append(benches.now_s)
    read = ~np.isnan([reading.cost for reading in readings])
    assert 0.06 < 1 - read.mean() < 0.14
    assert np.median(np.array(times_s)[read]) == pytest.approx(2.0, rel=0.1)
    assert np.log(np.array(times_s)[read]).std() == pytest.approx(0.3, rel=0.15)
    assert {reading.cost for reading in readings if reading.cost == reading.cost} == {
        float(Problem("nominal").evaluate(np.zeros(7))[0])
    }
    with pytest.raises(ValueError, match="lost must be a share below 1"):
        LateBenches(Problem("nominal"), lost=1.0)
