"""What each effect would add: scores under noise, their chance, and starts ranked by them."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.selection.score_test import Signatures, signatures, superposed
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete

SETTINGS = DiagnosisSettings()

LOOKED_FOR = ("feedthrough", "cubic_stiffness", "second_mode", "sensor_bandwidth")


@pytest.fixture(scope="module")
def plain(recorded, fitted):
    return fitted(recorded())


@pytest.fixture(scope="module")
def found(plain, effects):
    return signatures(plain, [effects[name] for name in LOOKED_FOR], FitContext(ProcessPool(1)))


def left_of(joint):
    return np.concatenate([joint.base.residuals[o.name][: o.fitted] for o in joint.seen])


def redrawn(joint, rng):
    """The same recordings with other noise, refitted."""
    clean = {o.name: joint.start.plant().signal(o.excitation) for o in joint.observed}
    observed = []
    for o in joint.observed:
        rms = joint.noise.models[o.noise_key].rms
        observed.append(replace(o, measured=clean[o.name] + rms * rng.standard_normal(o.excitation.samples)))
    return OutputErrorFit(observed, joint.noise, joint.start, SETTINGS)


def test_every_start_has_a_unit_column_that_the_base_cannot_say(plain, found, effects):
    excitations = [o.excitation for o in plain.seen]
    starts = [s for name in LOOKED_FOR for s in effects[name].starts(plain.base.head.printhead, excitations)]
    assert list(found.starts) == starts
    np.testing.assert_allclose(np.linalg.norm(found.columns, axis=0), 1.0)
    assert np.abs(plain.basis[0].T @ found.columns).max() < 1e-9
    for k in (0, 3):
        whole = plain.signature(found.effects[k], found.starts[k])
        q, _ = plain.basis
        np.testing.assert_allclose(found.columns[:, k] * found.sizes[k], whole - q @ (q.T @ whole), atol=1e-9)


def test_scores_are_standard_normal_where_the_base_model_is_right(plain, found):
    """Over campaigns with other noise, each refitted."""
    rng = np.random.default_rng(11)
    scores = np.array([found.scores(left_of(redrawn(plain, rng))) for _ in range(40)])
    size = np.std(scores, axis=0)
    assert np.all(np.abs(scores.mean(axis=0)) < 4.5 / np.sqrt(40))
    assert np.all((size > 0.6) & (size < 1.5))
    assert np.sqrt(np.mean(scores**2)) == pytest.approx(1.0, abs=0.15)


def made_up(columns, sizes=None):
    columns = columns / np.linalg.norm(columns, axis=0)
    k = columns.shape[1]
    return Signatures((None,) * k, ({},) * k, np.ones(k) if sizes is None else sizes, columns)


@pytest.mark.parametrize("kind", ["apart", "alike", "few"])
def test_the_chance_of_a_score_is_how_often_noise_gives_it(kind):
    rng = np.random.default_rng(12)
    columns = {
        "apart": rng.standard_normal((300, 30)),
        "alike": rng.standard_normal((300, 1)) + 0.1 * rng.standard_normal((300, 30)),
        "few": rng.standard_normal((300, 1)),
    }[kind]
    table = made_up(columns)
    largest = np.array([np.abs(table.scores(rng.standard_normal(300))).max() for _ in range(8000)])
    for share in (0.5, 0.2, 0.05, 0.02):
        score = float(np.quantile(largest, 1 - share))
        error = math.sqrt(share / 2000 + share / 8000)
        assert table.p_value(score, np.random.default_rng(1), 2000) == pytest.approx(share, abs=4.5 * error)


def test_in_the_tail_the_chance_is_bonferronis_and_falls_with_the_score():
    rng = np.random.default_rng(13)
    table = made_up(rng.standard_normal((500, 12)))
    scores = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 8.0, 30.0)
    p_values = [table.p_value(score, np.random.default_rng(1), 2000) for score in scores]
    assert p_values[0] == 1.0
    assert all(a >= b for a, b in itertools.pairwise(p_values))
    assert p_values[5] == pytest.approx(12 * math.erfc(5 / math.sqrt(2)))
    assert 0 < p_values[6] < 1e-13
    assert table.p_value(-5.0, np.random.default_rng(1), 2000) == p_values[5]


def test_nothing_to_look_for_is_found_by_chance_always():
    empty = Signatures((), (), np.zeros(0), np.zeros((10, 0)))
    assert empty.p_value(99.0, np.random.default_rng(1), 2000) == 1.0
    assert empty.best(np.ones(10)) == {}


def test_beside_more_columns_only_what_they_cannot_say_is_left():
    rng = np.random.default_rng(14)
    q, _ = np.linalg.qr(rng.standard_normal((200, 5)))
    mixed = np.column_stack([q[:, 0], q[:, 0] + 1e-6 * q[:, 1], 3 * q[:, 2] + 4 * q[:, 3]])
    table = replace(made_up(mixed, np.array([1.0, 2.0, 10.0])), starts=({"a": 0}, {"a": 1}, {"a": 2}))
    beside = table.beside(q[:, [0, 2]])
    assert beside.starts == ({"a": 2},)  # the other two are the base's own, or too nearly
    assert beside.sizes == pytest.approx([8.0])
    assert np.abs(beside.scores(5 * q[:, 3] + 2 * q[:, 2])) == pytest.approx([5.0])
    assert beside.gram == pytest.approx(np.ones((1, 1)))


def test_scores_beside_further_columns_are_those_of_what_is_left_of_each_signature():
    rng = np.random.default_rng(15)
    basis, _ = np.linalg.qr(rng.standard_normal((300, 7)))
    table, residuals = made_up(rng.standard_normal((300, 9)) + basis[:, :1]), rng.standard_normal(300)
    left = table.columns - basis @ (basis.T @ table.columns)
    left /= np.linalg.norm(left, axis=0)
    beside = table.beside(basis)
    np.testing.assert_allclose(beside.scores(residuals), left.T @ residuals, atol=1e-12)
    np.testing.assert_allclose(beside.gram, left.T @ left, atol=1e-12)
    for k in range(9):
        np.testing.assert_allclose(beside.column(k), left[:, k], atol=1e-12)
        np.testing.assert_array_equal(table.column(k), table.columns[:, k])
    again = beside.beside(basis[:, :3])  # all that may adapt is given each time
    np.testing.assert_allclose(again.scores(residuals), table.beside(basis[:, :3]).scores(residuals), atol=1e-12)


def test_the_effect_that_is_there_scores_highest(recorded, fitted, effects):
    joint = fitted(recorded("feedthrough"))
    table = signatures(joint, [effects[name] for name in LOOKED_FOR], FitContext(ProcessPool(1)))
    best = table.best(left_of(joint))
    assert max(best, key=best.get) == "feedthrough"
    assert best["feedthrough"] > 15
    assert table.p_value(best["feedthrough"], np.random.default_rng(0), 2000) < 1e-40


def test_a_start_is_scaled_to_what_the_recordings_show(recorded, fitted, effects, values):
    joint, effect = fitted(recorded("feedthrough")), effects["feedthrough"]
    table = signatures(joint, [effect], FitContext(ProcessPool(1)))
    ranked = table.ranked(effect, left_of(joint))
    assert len(ranked) == 2
    assert abs(ranked[0][0]) >= abs(ranked[1][0])
    score, start = ranked[0]
    begin = next(s for s in table.starts if (s["lossy"] == 0) == (start["lossy"] == 0))
    k = table.starts.index(begin)
    factor = min(max(abs(score / table.sizes[k]), 0.05), 3.0)
    name = "capacitive_s" if begin["lossy"] == 0 else "lossy"
    assert abs(start[name]) == pytest.approx(factor * abs(begin[name]))
    assert np.sign(start[name]) == np.sign(values("feedthrough")[name])


def test_a_frequency_is_not_scaled_to_the_size_that_the_recordings_show(recorded_as, fitted, effects):
    """A ring of another frequency has another shape, not another size: its best start is the nearest one."""
    effect, truth_Hz = effects["drive_resonance"], 580e3
    joint = fitted(recorded_as("drive_resonance", frequency_Hz=truth_Hz, damping_ratio=0.1))
    table = signatures(joint, [effect], FitContext(ProcessPool(1)))
    ranked = table.ranked(effect, left_of(joint))
    assert all(start in table.starts for _, start in ranked)
    assert ranked[0][1]["frequency_Hz"] == pytest.approx(truth_Hz, rel=0.13)
    assert ranked[0][1]["damping_ratio"] == 0.1


def test_of_starts_that_look_alike_only_the_one_of_the_right_size_is_tried(recorded_as, fitted, effects):
    """Limits beyond every edge leave a lag alone, whose start may be far too long."""
    effect = effects["slew_limit"]
    joint = fitted(recorded_as("slew_limit", slew_rate_V_s=1.5e7, lag_s=5e-8))
    table = signatures(joint, [effect], FitContext(ProcessPool(1)))
    left = left_of(joint)
    every, apart = table.ranked(effect, left), table.ranked(effect, left, 0.99)
    assert len(apart) < len(every)
    scores = table.scores(left)
    kept = table.columns[:, [int(np.argmin(np.abs(scores - score))) for score, _ in apart]]
    for score, _ in every:
        k = int(np.argmin(np.abs(scores - score)))
        assert np.abs(kept.T @ table.columns[:, k]).max() > 0.97  # like one that is kept


def test_of_two_starts_alike_the_one_whose_own_size_the_recordings_show_is_kept():
    """The other one scores higher, but scaled by a 25th it is not that effect any more."""
    one, turned, other = np.eye(3)
    effect = SimpleNamespace(id="made up", scaled=lambda values, factor: values)
    columns = np.column_stack([one, one + 0.05 * turned, other])
    starts = ({"start": 0.0}, {"start": 1.0}, {"start": 2.0})
    table = replace(made_up(columns, np.array([4.0, 100.0, 1.0])), effects=(effect,) * 3, starts=starts)
    residuals = 4 * one + 0.5 * turned + 2 * other
    assert [start["start"] for _, start in table.ranked(effect, residuals)] == [1.0, 0.0, 2.0]
    assert [start["start"] for _, start in table.ranked(effect, residuals, 0.99)] == [0.0, 2.0]


def test_a_reciprocal_strength_keeps_its_sign_and_its_bounds(recorded, fitted, effects):
    joint, effect = fitted(recorded("sensor_bandwidth")), effects["sensor_bandwidth"]
    table = signatures(joint, [effect], FitContext(ProcessPool(1)))
    low, high = next((p.low, p.high) for p in effect.parameters if p.name == "bandwidth_Hz")
    for _, start in table.ranked(effect, -1e6 * left_of(joint)):
        assert 0 < start["bandwidth_Hz"] <= high
        assert start["bandwidth_Hz"] >= low


def test_an_effect_that_cannot_be_simulated_or_shows_nothing_has_no_signature(plain, effects):
    class Raises(type(effects["feedthrough"])):
        id = "raises"

        def sensing(self, values, signal, drive_V, printhead, excitation):
            if values["capacitive_s"]:
                raise FloatingPointError("grows without bound")
            return signal

    class Silent(type(effects["feedthrough"])):
        id = "silent"

        def sensing(self, values, signal, drive_V, printhead, excitation):
            return signal

    class Offset(type(effects["feedthrough"])):
        id = "offset"  # which the base model fits itself

        def sensing(self, values, signal, drive_V, printhead, excitation):
            return signal + values["lossy"] * (excitation.channel == "self_sensing")

    found = signatures(plain, [Raises(), Silent(), Offset(), effects["cubic_stiffness"]], FitContext(ProcessPool(1)))
    assert {e.id for e in found.effects} <= {"raises", "cubic_stiffness"}
    assert sum(e.id == "cubic_stiffness" for e in found.effects) == 2


def test_what_is_being_looked_for_is_told(plain, effects):
    told = []
    signatures(plain, [effects["cubic_stiffness"]], FitContext(progress=told.append))
    assert told == ["score test of cubic_stiffness (1 of 2)", "score test of cubic_stiffness (2 of 2)"]


def test_two_workers_find_what_one_does(plain, found, effects):
    again = signatures(plain, [effects[name] for name in LOOKED_FOR], FitContext(ProcessPool(2)))
    np.testing.assert_array_equal(again.columns, found.columns)
    assert again.starts == found.starts


def test_the_whole_law_may_begin_where_its_signature_looks_most_like_the_residual(recorded, fitted, effects, head):
    """Waves between two ends, which a fit of a single return does not lead to."""
    echo = effects["wave_echo"]
    period_s = 1 / head.frequency_Hz
    truth = {
        "delay_s": 1.07 * period_s,
        "second_delay_s": 1.81 * period_s,
        "reflection": 0.6,
        "second_reflection": -0.7,
    }
    joint = fitted(recorded())
    plant = joint.base.head.plant([(echo, complete(echo, strength=0.05, **truth))])
    observed = [replace(o, measured=plant.signal(o.excitation)) if o.excitation.fast else o for o in joint.observed]
    joint = OutputErrorFit(observed, joint.noise, joint.base.head, SETTINGS)
    starts = superposed(joint, echo, left_of(joint), joint.basis[0])
    ends = [joint.fit(ActiveEffects.of([(echo, start)]), most_steps=6, whole=True) for start in starts]
    best = min(ends, key=lambda fit: fit.nll)
    ((_, found),) = best.active.pairs
    for name, value in truth.items():
        assert found[name] == pytest.approx(value, rel=0.01), name
    plain = joint.fit(ActiveEffects.of([(echo, complete(echo, delay_s=truth["delay_s"], strength=0.05))]))
    assert best.nll < 0.1 * plain.nll
