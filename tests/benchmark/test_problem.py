import json
import math
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from inkjet_env.experiments.benchmark.data import data_file
from inkjet_env.experiments.benchmark.grey_level import grey_level
from inkjet_env.experiments.benchmark.problem import BEST_KNOWN_FILE, Problem, Spread
from inkjet_env.experiments.benchmark.single_run import Optimisation
from inkjet_env.experiments.benchmark.suite import VERSION, families
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Bounds, DriverLimits, PeakCost, Printhead, Waveform, batch
from inkjet_env.printhead.response import Response

POINTS = np.random.default_rng(0).uniform(-1, 1, (40, 7))
SHORT = Bounds(upper=(100, 0, *[1e-5] * 5))
LIMITED = Problem("limited", bounds=Bounds(limits=DriverLimits(-50, 60, 20, 15, 0.1, longest_us=40, bits=10)))
TRAIN = Problem("train", bounds=SHORT, jetting_Hz=20e3)
GREY = Problem("grey", bounds=SHORT, jetting_Hz=20e3, pulses=4)
LOT = Problem("lot", spread=Spread(0.05, 8, "worst"))


def test_a_train_costs_what_its_steady_drop_does():
    waveforms = [Waveform.from_array(row) for row in SHORT.from_unit(POINTS)]
    steady = [TRAIN.printhead.respond(waveform, period_s=50e-6).cost() for waveform in waveforms]
    np.testing.assert_allclose(TRAIN.evaluate(POINTS), steady, atol=1e-8)


def test_a_grey_level_costs_what_its_drops_do_in_one_drive_with_all_its_waveforms():
    for point in POINTS[:10]:
        times_s, drive_V = Waveform.from_array(SHORT.from_unit(point)).knots()
        begins_s = 50e-6 * np.arange(4)
        knots_s, knots_V = (begins_s[:, None] + times_s).ravel(), np.tile(drive_V, 4)
        whole = Response(GREY.printhead, knots_s, knots_V, "periodic", 150e-6 + GREY.window_s)
        ends_s = [*begins_s[1:], np.inf]
        drops = [
            whole.peaks_V[(whole.peak_times_s >= begin_s) & (whole.peak_times_s < end_s)]
            for begin_s, end_s in zip(begins_s, ends_s, strict=True)
        ]
        heights_V = np.array([np.abs(peaks_V).max() for peaks_V in drops])
        after_last_V = replace(GREY.cost, A=0.0)(drops[-1])
        shortfall_V = max(0.0, (heights_V[:-1] - heights_V[1:]).max())
        wanted_V = -5 * heights_V.sum() + after_last_V + 5 * shortfall_V
        assert GREY.evaluate(point)[0] == pytest.approx(wanted_V, abs=1e-6)


def test_a_grey_level_of_one_drop_is_a_peak_cost():
    weighted, unweighted = np.array([[[-3.0]]]), np.array([[[2.0]]])
    assert grey_level(weighted, unweighted, 1.0).item() == -3.0


def test_the_first_drop_of_a_train_is_a_single_one_and_a_late_one_is_settled():
    waveform = Waveform.from_array(SHORT.from_unit(POINTS[0]))
    head = GREY.printhead
    first = head.respond(waveform, period_s=50e-6, earlier_drops=0)
    np.testing.assert_allclose(first.peaks_V, head.respond(waveform).peaks_V, rtol=1e-12)
    settled = head.respond(waveform, period_s=50e-6).peaks_V
    late = head.respond(waveform, window_s=50e-6, period_s=50e-6, earlier_drops=60).peaks_V
    np.testing.assert_allclose(late, settled, rtol=1e-9)


def test_a_train_on_a_head_with_effects_costs_what_its_steady_drop_does():
    train = replace(TRAIN, printhead=AugmentedPrinthead(TRAIN.printhead, ()))
    np.testing.assert_allclose(np.sort(np.abs(train.evaluate(POINTS) - TRAIN.evaluate(POINTS)))[:-4], 0.0, atol=0.05)


def test_a_lot_of_heads_is_judged_by_the_worst_or_by_the_mean():
    heads = LOT.spread.around(LOT.printhead)
    each = [Problem("one", head).evaluate(POINTS) for head in heads]
    np.testing.assert_allclose(LOT.evaluate(POINTS), np.max(each, axis=0), rtol=1e-12)
    mean = replace(LOT, spread=Spread(0.05, 8, "mean"))
    np.testing.assert_allclose(mean.evaluate(POINTS), np.mean(each, axis=0), rtol=1e-12)


def test_a_lot_holds_the_nominal_head_and_stays_within_its_spread():
    nominal = Printhead.published()
    heads = Spread(0.05, 16).around(nominal)
    assert heads[1].frequency_Hz == pytest.approx(nominal.frequency_Hz)
    assert heads[1].coefficients == pytest.approx(nominal.coefficients)
    for name in ("frequency_Hz", "damping_ratio", "b1"):
        part = np.array([getattr(head, name) / getattr(nominal, name) for head in heads])
        assert abs(part - 1).max() <= 0.05 + 1e-12
        assert part.max() - part.min() > 0.08


@pytest.mark.parametrize(
    "problem", [TRAIN, GREY, LOT, replace(LOT, spread=Spread(0.05, 8, "mean"))], ids=["train", "grey", "worst", "mean"]
)
def test_gradients_of_several_drops_or_heads_equal_differences(problem):
    costs, gradients = problem.evaluate_with_gradient(POINTS)
    np.testing.assert_allclose(costs, problem.evaluate(POINTS), atol=1e-9)
    size, right = 1e-6, []
    for point, gradient in zip(POINTS, gradients, strict=True):
        inside = np.clip(point, -0.99, 0.99)
        if (inside != point).any():
            continue
        up = problem.evaluate(point + size * np.eye(7))
        down = problem.evaluate(point - size * np.eye(7))
        right.append(np.allclose((up - down) / (2 * size), gradient, rtol=1e-3, atol=1e-3))
    assert len(right) > 20
    assert np.mean(right) > 0.9  # where a peak appears, or another drop or head becomes the worse one, the cost breaks


@pytest.mark.parametrize(
    "problem", [Problem("one"), TRAIN, LOT, replace(LOT, spread=Spread(0.05, 8, "mean"))], ids=lambda p: p.name
)
def test_outside_the_box_the_cost_and_its_gradient_are_those_of_the_clipped_point(problem):
    rng = np.random.default_rng(1)
    outside = np.where(rng.random(POINTS.shape) < 0.4, np.sign(POINTS) * rng.uniform(1.01, 3, POINTS.shape), POINTS)
    clipped = np.clip(outside, -1, 1)
    costs, gradients = problem.evaluate_with_gradient(outside)
    np.testing.assert_array_equal(problem.evaluate(outside), problem.evaluate(clipped))
    np.testing.assert_array_equal(costs, problem.evaluate_with_gradient(clipped)[0])
    assert (gradients[outside != clipped] == 0).all()
    size, right = 1e-6, []
    for point, gradient in zip(outside, gradients, strict=True):
        ups, downs = (problem.evaluate(point + sign * size * np.eye(7)) for sign in (1, -1))
        right.append(np.allclose((ups - downs) / (2 * size), gradient, rtol=1e-3, atol=1e-3))
    assert np.mean(right) > 0.9  # as above: elsewhere the cost breaks
    one = problem.evaluate_with_gradient(outside[0])
    np.testing.assert_array_equal(one[1][0], gradients[0])


def test_on_a_face_of_the_box_the_gradient_is_that_of_the_inside():
    face = np.clip(POINTS * [1, 1, 1, 1, 1e6, 1, 1], -1, 1)
    _, gradients = Problem("one").evaluate_with_gradient(face)
    inner = face - 1e-6 * np.sign(face) * np.eye(7)[4]
    change = (Problem("one").evaluate(face) - Problem("one").evaluate(inner)) / 1e-6 * np.sign(face[:, 4])
    assert np.mean(np.isclose(change, gradients[:, 4], rtol=1e-3, atol=1e-3)) > 0.9
    assert (gradients[:, 4] != 0).mean() > 0.9


def test_a_reading_hangs_on_the_run_and_the_number_of_the_evaluation_alone():
    noisy = Problem("noisy", measurement_noise_V=0.2)
    together = noisy.read(POINTS, seed=5)
    apart = np.concatenate([noisy.read(POINTS[:7], 5), noisy.read(POINTS[7:], 5, first=7)])
    assert (together == apart).all()
    assert (noisy.read(POINTS, seed=6) != together).all()
    assert (noisy.evaluate(POINTS) == Problem("nominal").evaluate(POINTS)).all()


def test_readings_and_an_optimizer_of_the_same_seed_draw_different_numbers():
    seen = []

    class Seen:
        def measure(self, waveforms, heads, generators):
            seen.extend(generator.random() for generator in generators)
            return (np.zeros(len(waveforms)),)

        def heads(self, drawn):
            return drawn

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("inkjet_env.envs.task.make_task", lambda *given, **named: Seen())
        Problem("noisy", measurement_noise_V=0.2).read(POINTS[:3], seed=5)
    assert not set(seen) & set(np.random.default_rng(5).random(100))


def test_readings_scatter_about_the_cost_as_the_errors_of_the_peaks_do():
    """Peaks far above the noise: the effective one weighs 5, the next 5, the others 1 each."""
    noisy = Problem("noisy", cost=PeakCost(-5, 5, "first"), measurement_noise_V=1e-3, window_s=60e-6)
    point = noisy.bounds.to_unit([100, -100, 1e-6, 12e-6, 5e-6, 12e-6, 5e-6])
    peaks = noisy.respond(point).peaks_V
    assert np.abs(peaks).min() > 0.1
    read = noisy.read(np.tile(point, (4000, 1)), seed=1) - noisy.evaluate(point)
    wanted = 1e-3 * math.sqrt(25 + 25 + peaks.size - 2)
    assert abs(read.mean()) < 4 * wanted / math.sqrt(4000)
    assert read.std() == pytest.approx(wanted, rel=0.05)


@pytest.mark.parametrize(
    "problem",
    [
        TRAIN,
        LOT,
        Problem("noisy", measurement_noise_V=0.1),
        Problem("drop", cost=PeakCost(-50, 5, target_height_V=4.0)),
        LIMITED,
        GREY,
    ],
    ids=lambda problem: problem.name,
)
def test_settings_rebuild_what_is_new_in_a_problem(problem):
    assert Problem.from_settings(problem.name, problem.settings()) == problem


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="does not fit into a period"):
        Problem("train", jetting_Hz=20e3)
    with pytest.raises(ValueError, match="cannot be combined"):
        replace(LOT, measurement_noise_V=0.1)
    with pytest.raises(ValueError, match="pulses must be at least 2, at a rate jetting_Hz; got 3 at 0 Hz"):
        Problem("grey", pulses=3)
    with pytest.raises(ValueError, match="earlier_drops must be a whole number"):
        GREY.printhead.respond(Waveform(1, 0, 1e-6, 0, 0, 0, 0), period_s=1e-4, earlier_drops=0.5)
    with pytest.raises(ValueError, match="noisy peak readings have no gradients"):
        Problem("noisy", measurement_noise_V=0.1).evaluate_with_gradient(POINTS)
    with pytest.raises(ValueError, match=r"Did you mean 'worst'\?"):
        Spread(judged="wurst")
    assert not Problem("noisy", measurement_noise_V=0.1).has_gradient
    assert TRAIN.has_gradient
    with pytest.raises(ValueError, match="within a driver's limits have no gradients"):
        LIMITED.evaluate_with_gradient(POINTS)
    assert not LIMITED.has_gradient


def test_a_driver_with_limits_is_judged_by_what_it_can_do():
    legal = LIMITED.bounds.from_unit(POINTS)
    assert all(not LIMITED.bounds.limits.excesses(*Waveform.from_array(row).knots()) for row in legal)
    np.testing.assert_array_equal(LIMITED.evaluate(POINTS), batch.costs(legal, LIMITED.printhead))
    np.testing.assert_array_equal(LIMITED.respond(POINTS[0]).knot_times_s, Waveform.from_array(legal[0]).knots()[0])


def test_a_long_box_fits_into_a_period_if_the_driver_s_longest_waveform_does():
    Problem("train", bounds=Bounds(limits=DriverLimits(longest_us=50)), jetting_Hz=20e3)
    with pytest.raises(ValueError, match="does not fit into a period"):
        Problem("train", bounds=Bounds(limits=DriverLimits(longest_us=51)), jetting_Hz=20e3)


def test_a_run_is_told_readings_and_goes_on_with_the_same_ones():
    noisy = Problem("noisy", measurement_noise_V=0.2)
    plan = Optimisation(noisy, "pso", 120, 3)
    whole = plan.carry_out()
    assert (whole.costs == noisy.read(whole.points, 3)).all()
    assert np.mean(whole.costs != noisy.evaluate(whole.points)) > 0.8  # no drive has no peaks to misread
    resumed = plan.carry_out((whole.points[:70], whole.costs[:70]))
    assert (resumed.points == whole.points).all()
    assert (resumed.costs == whole.costs).all()


def test_a_rig_that_reads_has_no_gradients():
    with pytest.raises(AttributeError):
        Problem("noisy", measurement_noise_V=0.2).as_measured(0).evaluate_with_gradient(POINTS)


def test_an_instance_does_not_change_without_another_version_of_the_suite():
    """A new version has new settings: raise VERSION, and tell its digests here. A new family adds one of its own."""
    added = {
        "greyscale": "46efbcda18fd35cd7e2d5aaad3bab189997115b3e98cb4fce491d8d6c24fa1f8",
        "late": "f57f56020df00be639111be0a68af2ba97815918ce364ad5048a28f968ef8bdb",
    }
    known = {2: "a81bd9e85bbda3ac2e412edf3bdf8cc605c47959fdd1af7ddcd27191f5d02be1"}
    first = [one for family, problems in families().items() if family not in added for one in problems]
    assert settings_digest(first) == known[VERSION]
    assert {family: settings_digest(families()[family]) for family in added} == added


def settings_digest(problems):
    settings = json.dumps({one.name: one.settings() for one in problems}, sort_keys=True)
    return sha256(settings.encode()).hexdigest()


def test_what_is_recorded_of_the_suite_is_of_this_version():
    comparison = Path(__file__).parents[2] / "docs" / "comparison"
    files = (data_file(BEST_KNOWN_FILE), comparison / "ranking.json", comparison / "beating.json")
    for file in files:
        assert json.loads(file.read_text(encoding="utf-8"))["suite"] == VERSION, file.name
