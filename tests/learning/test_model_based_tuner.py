"""The tuner that plays by a model: what it concludes from readings, and what it gains by it."""

import numpy as np
import pytest

from inkjet_env.envs.given_heads import GivenHeads
from inkjet_env.envs.task import Readings, make_task
from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.experiments.learning import possible_heads
from inkjet_env.experiments.learning.benches import heads_on_the_bench
from inkjet_env.experiments.learning.few_shot_tuners import kept_costs_V
from inkjet_env.experiments.learning.heads import descended
from inkjet_env.experiments.learning.model_based_tuner import PLAIN, ExpectedKept, ModelBasedTuner
from inkjet_env.experiments.learning.possible_heads import DrawnHeads, ListedHeads, Try, flattened
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.printhead import Printhead

SEED, NOISE_V = 5, 0.05
BASE = Printhead.published()
MODE = next(effect for effect in catalogue() if effect.id == "second_mode")
WITH_MODE = AugmentedPrinthead(BASE, ((MODE, MODE.example_values(BASE)),))
POSSIBLE = HeadEnsemble((BASE, WITH_MODE, BASE.varied(48e3)), (0.98, 0.01, 0.01))
TASK = make_task(context="random")
WAVEFORM = TASK.bounds.from_unit(np.array([0.9, -0.8, -0.5, 0.1, 0.2, -0.3, 0.4]))


def read_on(head, noise_V, seed=0):
    """A try of `WAVEFORM` on a head."""
    task = make_task(head, noise=noise_V)
    readings = task.read(WAVEFORM[None, :], task.heads([]), [np.random.default_rng(seed)])
    heights_V, times_s = readings.first(8)
    return Try(WAVEFORM, heights_V[0], times_s[0])


def test_misfits_are_squares_of_errors_in_standard_deviations():
    one = Try(WAVEFORM, np.array([5.0, -3.0, 0.0]), np.array([10e-6, 20e-6, 0.0]))
    predicted = Readings(
        np.array([[10e-6, 20e-6], [10e-6, 20.2e-6]]),
        np.array([[5.0, -3.0], [5.3, 9.9]]),
        np.array([2, 1]),
        np.zeros(2),
        np.zeros(2),
    )
    at_heights, at_times = np.hypot(0.1, possible_heads.HEIGHT_TOLERANCE_V), possible_heads.TIME_TOLERANCE_S
    second = ((0.3 / at_heights) ** 2 + (3.0 / at_heights) ** 2) + (20e-6 / at_times) ** 2  # its second peak is missing
    assert one.misfits(predicted, 0.1) == pytest.approx([0.0, second])
    assert one.numbers == 4


def test_weights_are_flattened_until_enough_of_them_count_and_no_more():
    log_weights = -(np.linspace(0, 1000, 200) ** 2)
    log_weights[7] = -np.inf
    power, weights = flattened(log_weights)
    assert 0 < power < 1
    assert weights.sum() == pytest.approx(1)
    assert weights[7] == 0
    assert 1 / (weights**2).sum() == pytest.approx(possible_heads.EFFECTIVE * 200, rel=1e-6)
    power, weights = flattened(np.log(np.linspace(1, 2, 200)))
    assert power == 1
    np.testing.assert_allclose(weights, np.linspace(1, 2, 200) / 300)


def test_of_listed_heads_the_one_that_predicts_the_readings_remains_even_if_it_was_unlikely():
    for number, head in enumerate(POSSIBLE.heads):
        listed = ListedHeads(GivenHeads(POSSIBLE), NOISE_V)
        assert listed.heads(16).weights == POSSIBLE.weights
        listed.observe(read_on(head, NOISE_V))
        assert listed.heads(16).heads == (POSSIBLE.heads[number],)


def test_where_no_listed_head_predicts_the_readings_the_nearest_ones_remain():
    above, far, below = BASE.varied(52e3), BASE.varied(40e3), BASE.varied(49.9e3)
    listed = ListedHeads(GivenHeads([above, far, below]), NOISE_V)
    listed.observe(read_on(BASE.varied(50.95e3), NOISE_V))
    assert listed.misfits.min() > 10 * listed.numbers  # none of them predicts what was read,
    assert abs(listed.misfits[0] - listed.misfits[2]) > 100  # and taken at their word, one of the two would be excluded
    assert set(listed.heads(16).heads) == {above, below}


@pytest.mark.parametrize("context", [(0.4, -0.6, 0.3, 0.8), (-0.97, 0.9, -0.5, -0.9), (1.4, -0.6, 0.3, 1.2)])
def test_a_cloud_of_heads_settles_on_the_one_on_the_bench_even_beyond_the_ranges(context):
    head = TASK.head(context)
    drawn = DrawnHeads(TASK, NOISE_V, np.random.default_rng(0))
    spreads = []
    for seed in range(2):
        drawn.observe(read_on(head, NOISE_V, seed))
        mean = drawn.weights @ drawn.contexts
        spread = np.sqrt(drawn.weights @ (drawn.contexts - mean) ** 2)
        assert (np.abs(mean - context) < 4 * spread).all()
        spreads.append(spread)
    assert spreads[0][0] < 0.02  # the resonance
    assert (spreads[1] < spreads[0]).all()
    remaining = drawn.heads(16)
    assert sum(remaining.weights) == pytest.approx(1)
    assert all(one.frequency_Hz == pytest.approx(head.frequency_Hz, rel=0.01) for one in remaining.heads)


def test_what_is_minimised_is_the_mean_of_what_is_kept():
    points = np.random.default_rng(0).uniform(-1, 1, (6, 7))
    heads = HeadEnsemble((BASE, BASE.varied(48e3)), (3.0, 1.0))
    costs = heads.costs(TASK.bounds.from_unit(points))
    kept_V = float(np.median(costs))
    expected = 0.75 * np.minimum(costs[0], kept_V) + 0.25 * np.minimum(costs[1], kept_V)
    found = ExpectedKept(heads, TASK, kept_V).evaluate(points)
    np.testing.assert_allclose(found, (1 - PLAIN) * expected + PLAIN * (0.75 * costs[0] + 0.25 * costs[1]))


def test_three_tries_come_close_to_the_best_and_a_head_is_tuned_as_it_would_be_alone():
    tuner = ModelBasedTuner(0, budget=300)
    kept = kept_costs_V(tuner, 4, 3, SEED)
    heads = heads_on_the_bench(4, SEED)
    best_V = np.array([descended(heads.one(k), 10, k)[1] for k in range(4)])
    assert np.median(kept[:, 2] / best_V) > 0.85
    assert (kept_costs_V(tuner, 4, 3, SEED) == kept).all()  # the next episode begins with nothing known
    assert (kept_costs_V(ModelBasedTuner(0, budget=300), 1, 3, SEED) == kept[:1]).all()


def test_a_corrected_head_among_rivals_is_recognised_and_tuned():
    options = {"heads": POSSIBLE, "noise": 0.1, "peaks": 6}
    seed = next(s for s in range(1000) if _drawn(s, options) is WITH_MODE)
    tuner = ModelBasedTuner(0, budget=60, **options)
    kept = kept_costs_V(tuner, 1, 3, seed, **options)[0]
    assert tuner.possible[0].heads(16).heads == (WITH_MODE,)
    assert kept[2] < kept[0] < 0


def test_a_law_that_the_model_cannot_simulate_is_refused():
    with pytest.raises(ValueError, match="hysteresis of a model-based tuner must be one of full_memory"):
        ModelBasedTuner(0, hysteresis="one_point")


def _drawn(seed, options):
    envs = TuneWaveformVectorEnv(1, **options)
    envs.reset(seed=seed)
    return envs.tuning.head(0)
