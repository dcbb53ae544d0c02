"""The measures and tests of the comparison against the programs and definitions that they come from."""

import math

import baycomp
import numpy as np
import pytest
import scikit_posthocs
from scipy.stats import mannwhitneyu, trim_mean

from inkjet_env.experiments.benchmark import mean_ranks, metrics

RUNS, EVALUATIONS = 9, 300


@pytest.fixture(scope="module")
def curves():
    """Best regrets so far of nine runs that come to different depths, shape (runs, evaluations)."""
    rng = np.random.default_rng(1)
    falls = rng.exponential(1.2, (RUNS, EVALUATIONS)).cumsum(axis=1) * rng.uniform(0.005, 0.03, (RUNS, 1))
    return 10 ** (1 - falls)


def write_coco(folder, curves):
    """The runs in COCO's format of logs: an index, and each improvement with its evaluation."""
    (folder / "data_f1").mkdir()
    for ending in ("dat", "tdat"):
        with open(folder / "data_f1" / f"bbobexp_f1_DIM7.{ending}", "w", encoding="utf-8") as file:
            for curve in curves:
                file.write("% f evaluations | g evaluations | best noise-free fitness - Fopt (0.0e+00) + sum g_i+ |\n")
                for k, regret in enumerate(curve):
                    file.write(f"{k + 1} 0" + f" {regret:+.12e}" * 3 + "\n")
    ends = ", ".join(f"{k + 1}:{EVALUATIONS}|{curve[-1]:.12e}" for k, curve in enumerate(curves))
    (folder / "bbobexp_f1.info").write_text(
        "suite = 'bbob', funcId = 1, DIM = 7, Precision = 1.000e-08, algId = 'x', coco_version = '2.6', "
        f"logger = 'bbob', data_format = 'bbob-new2'\n% x\ndata_f1/bbobexp_f1_DIM7.dat, {ends}\n",
        encoding="utf-8",
    )
    return str(folder)


def test_expected_running_time_is_that_of_coco(cocopp, curves, tmp_path):
    targets = [10 ** (k / 5) for k in range(4, -40, -1)]  # cocopp keeps five to a decade
    read = cocopp.pproc.DataSetList([write_coco(tmp_path, curves)])
    theirs = read[0].detERT([target * (1 + 1e-9) for target in targets])
    hits = metrics.first_hits(curves, targets)
    ours = metrics.expected_running_time(hits.T, EVALUATIONS)
    assert (np.isfinite(hits).sum(axis=0) == 1).any()
    assert (np.isfinite(hits).sum(axis=0) < RUNS).any()
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)


def test_simulated_restarts_are_distributed_as_those_of_coco(cocopp, curves):
    hits = metrics.first_hits(curves, [1e-4])[:, 0]
    reached = np.isfinite(hits)
    assert 2 <= reached.sum() <= RUNS - 2
    percentiles = [10, 25, 50, 75, 90]
    spent = np.full(int((~reached).sum()), float(EVALUATIONS))
    theirs, _ = cocopp.toolsstats.drawSP(hits[reached], spent, percentiles, samplesize=20_000)
    drawn = metrics.simulated_restarts(hits, EVALUATIONS, np.random.default_rng(2), draws=20_000)
    # a quantile of a distribution of few values may fall on either side of a jump
    low, high = np.percentile(drawn, [np.subtract(percentiles, 1), np.add(percentiles, 1)])
    assert (low <= theirs).all()
    assert (np.asarray(theirs) <= high).all()
    assert np.mean(drawn) == pytest.approx(metrics.expected_running_time(hits, EVALUATIONS), rel=0.02)


@pytest.mark.parametrize(("runs", "instances"), [(25, 26), (7, 3), (5, 5)])
def test_aggregates_are_those_that_rliable_defines(runs, instances):
    """rliable 1.2.0, metrics.py: the definitions, since it does not run beside a current pandas."""
    rng = np.random.default_rng(runs)
    first, second = rng.lognormal(0.0, 1.0, (2, runs, instances)).round(1)
    assert metrics.interquartile_mean(first) == pytest.approx(
        trim_mean(first, proportiontocut=0.25, axis=None), rel=1e-12
    )
    # theirs is for scores of which more is better
    chances = [
        mannwhitneyu(-first[:, k], -second[:, k], alternative="greater").statistic / runs**2 for k in range(instances)
    ]
    assert metrics.probability_of_improvement(first, second) == pytest.approx(np.mean(chances), rel=1e-12)
    levels = np.linspace(0.0, 4.0, 9)
    theirs = [np.mean(np.mean(-first >= -level, axis=0)) for level in levels]
    np.testing.assert_allclose(metrics.performance_profile(first, levels), theirs, rtol=1e-12)


def test_stratified_intervals_are_those_that_rliable_draws():
    """Its bootstrap draws runs anew for every task, independently, and takes percentiles."""
    scores = np.random.default_rng(3).lognormal(0.0, 1.0, (25, 26))
    found = metrics.stratified_bootstrap(metrics.interquartile_mean, [scores], np.random.default_rng(4), 4000)
    rng = np.random.default_rng(5)
    drawn = []
    for _ in range(4000):
        picked = np.column_stack([rng.choice(scores[:, task], 25) for task in range(26)])
        drawn.append(trim_mean(picked, 0.25, axis=None))
    low, high = np.percentile(drawn, [2.5, 97.5])
    width = high - low
    assert found.low == pytest.approx(low, abs=0.05 * width)
    assert found.high == pytest.approx(high, abs=0.05 * width)


@pytest.mark.parametrize(("better_by", "alike"), [(0.0, 0.05), (0.1, 0.05), (0.1, 0.3), (-0.05, 0.1)])
def test_the_bayesian_signed_rank_agrees_with_baycomp(better_by, alike):
    """By the test's authors; theirs is of scores of which more is better, and names the right-hand one last."""
    rng = np.random.default_rng(9)
    second = rng.random(22)
    first = second - better_by + 0.3 * rng.standard_normal(22)
    found = metrics.bayesian_signed_rank(first, second, alike, rng, draws=40_000)
    theirs = baycomp.SignedRankTest.probs(first, second, rope=alike, nsamples=40_000, random_state=2)
    assert (found.second, found.alike, found.first) == pytest.approx(theirs, abs=0.01)
    assert 0.02 < max(theirs) <= 1.0


def test_friedman_and_the_critical_difference_agree_with_scikit_posthocs():
    """Two optimisers differ by more than the critical difference just where its Nemenyi p value is below 5 %."""
    rng = np.random.default_rng(6)
    medians = rng.normal(0.0, 1.0, (8, 24)) + np.linspace(0.0, 1.5, 8)[:, None]
    medians -= medians.min()
    p, difference = mean_ranks.friedman_and_nemenyi(medians)
    ranks = mean_ranks.mean_ranks(medians)
    theirs = scikit_posthocs.posthoc_nemenyi_friedman(medians.T).to_numpy()
    apart = np.abs(ranks[:, None] - ranks[None, :]) > difference
    told = theirs < 0.05
    np.fill_diagonal(told, val=False)
    assert 4 < apart.sum() < 52
    assert np.array_equal(apart, told)
    assert 0.0 <= p < 0.05
    assert math.isfinite(difference)
