import math

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, t

from inkjet_env.experiments.benchmark import metrics

RNG = np.random.default_rng


def test_running_time_is_infinite_where_nobody_arrives_and_the_mean_where_all_do():
    assert metrics.expected_running_time([math.inf, math.inf], 100) == math.inf
    assert metrics.expected_running_time([10, 20, 60], 100) == 30


def test_running_time_is_that_of_restarts_with_the_share_that_succeed():
    """Success in 1 of 4 runs of 100 after 40: 3 failures and a success on the average (COCO's ERT)."""
    hits = [40, math.inf, math.inf, math.inf]
    assert metrics.expected_running_time(hits, 100) == 340
    times = metrics.simulated_restarts(hits, 100, RNG(0), 40_000)
    assert times.mean() == pytest.approx(340, rel=0.02)
    assert set(np.unique((times - 40) % 100)) == {0.0}


def test_restarts_are_never_simulated_where_nobody_arrives():
    assert np.isinf(metrics.simulated_restarts([math.inf], 50, RNG(0), 3)).all()


def test_runs_may_have_had_different_budgets():
    assert metrics.expected_running_time([10, math.inf], [50, 200]) == 210


def test_the_distribution_of_running_times_counts_what_is_met_by_then():
    times = [[1.0, 5.0], [5.0, math.inf]]
    np.testing.assert_allclose(metrics.running_time_distribution(times, [0, 1, 4, 5, 1e9]), [0, 0.25, 0.25, 0.75, 0.75])


def test_interquartile_mean_is_the_mean_of_the_middle_half():
    values = RNG(1).permutation(np.concatenate([np.full(25, -1e6), np.arange(50), np.full(25, 1e6)]))
    assert metrics.interquartile_mean(values.reshape(20, 5)) == pytest.approx(24.5)


def test_probability_of_improvement_is_the_mean_mann_whitney_statistic():
    a, b = RNG(2).integers(0, 6, (15, 4)), RNG(3).integers(1, 7, (11, 4))
    by_scipy = [mannwhitneyu(b[:, k], a[:, k]).statistic / (15 * 11) for k in range(4)]
    assert metrics.probability_of_improvement(a, b) == pytest.approx(np.mean(by_scipy))
    assert metrics.probability_of_improvement(a, a) == 0.5


def test_intervals_resample_within_instances():
    """Instances differ by far more than runs; an interval that mixed them would be a hundred times wider."""
    scores = 100.0 * np.arange(8) + RNG(4).standard_normal((12, 8))
    found = metrics.stratified_bootstrap(lambda x: x.mean(axis=(-2, -1)), [scores], RNG(5))
    assert found.low < found.value < found.high
    assert found.high - found.low == pytest.approx(2 * 1.96 / math.sqrt(96), rel=0.3)


def test_intervals_cover_about_as_often_as_they_say():
    rng, covered = RNG(6), 0
    for _ in range(120):
        found = metrics.stratified_bootstrap(lambda x: x.mean(axis=(-2, -1)), [rng.standard_normal((15, 3))], rng, 400)
        covered += found.low <= 0 <= found.high
    assert 0.86 <= covered / 120 <= 1.0


def test_an_interval_over_rows_is_students_however_many_columns_repeat_it():
    """Rows that are alike in every column are a sample of their own number, not of all cells."""
    values = np.tile(RNG(9).standard_normal(8)[:, None], (1, 50))
    found = metrics.crossed_bootstrap(
        lambda rows, columns: values[np.ix_(rows, columns)].mean(), values.shape, RNG(10), 20_000
    )
    half = t.ppf(0.975, 7) * values[:, 0].std(ddof=1) / math.sqrt(8)
    assert found.value == pytest.approx(values.mean())
    assert found.high - found.low == pytest.approx(2 * half, rel=0.1)


def test_one_row_has_an_interval_over_columns():
    values = RNG(11).standard_normal((1, 60))
    found = metrics.crossed_bootstrap(
        lambda rows, columns: values[np.ix_(rows, columns)].mean(), values.shape, RNG(12), 4000
    )
    half = t.ppf(0.975, 59) * values.std(ddof=1) / math.sqrt(60)
    assert found.high - found.low == pytest.approx(2 * half, rel=0.1)


@pytest.mark.parametrize("spread", [0.3, 1.0])
def test_intervals_over_ten_trainings_and_forty_heads_cover_another_of_each(spread):
    rng, covered = RNG(13), 0
    for _ in range(100):
        noise = 0.5 * rng.standard_normal((10, 40))
        values = np.exp(spread * rng.standard_normal((10, 1)) + rng.standard_normal(40) + noise)
        found = metrics.crossed_bootstrap(
            lambda r, c, v=values: float(np.median(v[np.ix_(r, c)])), values.shape, rng, 600
        )
        covered += found.low <= 1.0 <= found.high
    assert covered >= 90


def test_an_interval_whose_resamples_may_fail_has_no_upper_end():
    hits = np.array([[30.0], [math.inf], [math.inf], [math.inf]])
    found = metrics.stratified_bootstrap(lambda h: metrics.expected_running_time(h[..., 0], 100), [hits], RNG(7), 500)
    assert found.high == math.inf
    assert found.low < found.value


def test_signed_rank_tells_a_clear_winner_and_leaves_equals_open():
    rng = RNG(8)
    other = rng.random(24)
    better = metrics.bayesian_signed_rank(other - 1, other, 0.01, rng)
    assert better.first > 0.999
    alike = metrics.bayesian_signed_rank(other + 1e-4 * rng.standard_normal(24), other, 0.01, rng)
    assert alike.alike > 0.999
    open_ = metrics.bayesian_signed_rank(other + rng.standard_normal(24), other, 0.0, rng)
    assert max(open_.first, open_.second) < 0.999
    assert open_.first + open_.alike + open_.second == pytest.approx(1)


def test_signed_rank_is_symmetric():
    a, b = RNG(9).random(10), RNG(10).random(10) + 0.1
    forth, back = (metrics.bayesian_signed_rank(*pair, 0.02, RNG(11)) for pair in ((a, b), (b, a)))
    assert (forth.first, forth.alike, forth.second) == pytest.approx((back.second, back.alike, back.first), abs=1e-12)


def test_measures_of_many_samples_at_once_are_those_of_each():
    a, b = RNG(13).random((6, 9, 4)), RNG(14).random((6, 7, 4))
    for measure, samples in (
        (metrics.interquartile_mean, (a,)),
        (metrics.probability_of_improvement, (a, b)),
        (lambda hits: metrics.expected_running_time(np.where(hits > 0.5, math.inf, hits), 1), (a[..., 0],)),
    ):
        np.testing.assert_allclose(measure(*samples), [measure(*(s[k] for s in samples)) for k in range(6)])


def test_three_instances_prove_nothing():
    found = metrics.bayesian_signed_rank([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 0.1, RNG(12))
    assert found.first < 0.995
