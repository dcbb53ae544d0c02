import numpy as np
import pytest

from inkjet_env.estimate import Estimate
from inkjet_env.experiments.benchmark import mean_ranks
from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.conclusions import ranking_sentences
from inkjet_env.experiments.benchmark.regret import regret_quartiles_V
from inkjet_env.experiments.benchmark.run_files import RunKey, RunResult
from inkjet_env.experiments.benchmark.settings import BenchOutcome, BenchSettings
from inkjet_env.experiments.benchmark.suite import problem


def a_result(optimizer, regrets, repeat, name="nominal"):
    best = problem(name).best_known.cost
    return RunResult.of(RunKey(optimizer, name, repeat), np.zeros((len(regrets), 7)), best + np.array(regrets))


def an_outcome(tmp_path, by_optimizer, name="nominal"):
    """An outcome of one problem whose final regrets are those given, by optimiser."""
    repeats = len(next(iter(by_optimizer.values())))
    settings = BenchSettings((name,), tuple(by_optimizer), repeats=repeats, budget=1)
    results = [
        a_result(optimizer, [regret], repeat)
        for optimizer, regrets in by_optimizer.items()
        for repeat, regret in enumerate(regrets)
    ]
    return BenchOutcome(settings, tmp_path, results, {})


def test_ranks_are_those_worked_out_by_hand():
    medians = [[0.0, 3.0], [1.0, 2.0], [5.0, 2.0]]
    np.testing.assert_allclose(mean_ranks.mean_ranks(medians), [(1 + 3) / 2, (2 + 1.5) / 2, (3 + 1.5) / 2])


def test_less_than_a_microvolt_does_not_decide_a_rank():
    np.testing.assert_allclose(mean_ranks.mean_ranks([[1e-9], [0.0], [1e-3]]), [1.5, 1.5, 3])


def test_median_interval_of_equal_runs_is_a_point_and_of_one_run_unknown():
    rng = np.random.default_rng(0)
    assert mean_ranks.median_interval([2.0, 2.0, 2.0], rng) == Estimate(2.0, 2.0, 2.0)
    assert np.isnan(mean_ranks.median_interval([2.0], rng).low)


def test_median_interval_covers_the_true_median_about_as_often_as_it_says():
    rng = np.random.default_rng(1)
    intervals = [mean_ranks.median_interval(rng.standard_normal(25), rng) for _ in range(150)]
    covered = np.mean([i.low <= 0 <= i.high for i in intervals])
    assert 0.88 <= covered <= 1.0
    assert np.mean([i.high - i.low for i in intervals]) < 1.5  # not by being endless


def test_best_so_far_quartiles_are_those_of_the_running_minimum():
    runs = [a_result("pso", costs, i) for i, costs in enumerate([[5, 7, 1], [9, 2, 4], [6, 6, 6]])]
    found = regret_quartiles_V(runs, [1, 2, 3])
    np.testing.assert_allclose(found[1], [6, 5, 2], atol=1e-9)  # medians of 5 9 6, 5 2 6, 1 2 6
    np.testing.assert_allclose(found[0], [5.5, 3.5, 1.5], atol=1e-9)


def test_equal_optimisers_are_never_told_apart():
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(12):
        regrets = {name: rng.exponential(size=(3, 15)) for name in "abcd"}
        wrong += sum(not rank.tied_with_winner for rank in mean_ranks.mean_rank_intervals(regrets, rng).values())
    assert wrong <= 1


def test_a_better_optimiser_is_told_from_a_worse_one():
    rng = np.random.default_rng(3)
    regrets = {"bad": 5 + rng.exponential(size=(3, 15)), "good": rng.exponential(size=(3, 15))}
    found = mean_ranks.mean_rank_intervals(regrets, rng)
    assert (found["good"].estimate, found["good"].tied_with_winner) == (Estimate(1.0, 1.0, 1.0), True)
    assert (found["bad"].estimate, found["bad"].tied_with_winner) == (Estimate(2.0, 2.0, 2.0), False)


def test_nemenyi_difference_is_the_tabulated_one():
    # Demšar 2006, table 5: q_0.05 = 2.343 for three classifiers.
    medians = np.random.default_rng(0).random((3, 10))
    _, difference = mean_ranks.friedman_and_nemenyi(medians)
    assert difference == pytest.approx(2.343 * np.sqrt(3 * 4 / (6 * 10)), abs=1e-3)


def test_sentences_say_which_optimisers_are_level(tmp_path):
    rng = np.random.default_rng(4)
    even = np.linspace(0, 1, 15)
    regrets = {
        "pso-printed": 9 + rng.random(15),
        "pso": 5 + rng.random(15),
        "sobol": 0.05 + rng.permutation(even),  # worse than random, by a tenth of what single runs differ by
        "random": rng.permutation(even),
    }
    said = ranking_sentences(Comparison(an_outcome(tmp_path, regrets)))
    assert "random has the best mean rank (1.00 of 4)" in said[0]
    assert said[1] == (
        "On these problems sobol does not differ significantly from it; all others rank significantly lower (95 %)."
    )


def test_few_runs_are_not_called_a_proof(tmp_path):
    said = ranking_sentences(Comparison(an_outcome(tmp_path, {"random": [1.0, 2.0], "sobol": [5.0, 6.0]})))
    assert "So few runs cannot distinguish the optimisers" in said[1]


def test_a_comparison_in_which_nothing_ran_is_refused(tmp_path):
    outcome = BenchOutcome(BenchSettings(("nominal",), ("pso",)), tmp_path, [], {"pso": "broken"})
    with pytest.raises(ValueError, match=r"no optimiser of .* could be run"):
        Comparison(outcome)


def test_the_ranking_and_the_standings_are_one(tmp_path):
    """Medians of two runs, where rounding to a microvolt before the median would rank otherwise than after it."""
    regrets = {"pso": [0.4e-6, 1.4e-6], "cma-es": [1.0e-6, 1.0e-6], "random": [1.0, 2.0]}
    compared = Comparison(an_outcome(tmp_path, regrets))
    rows = compared.standings("all", 1).rows
    assert compared.ranking.optimizers == tuple(row.optimizer for row in rows)
    assert {row.optimizer: row.rank for row in rows} == {"pso": 1.5, "cma-es": 1.5, "random": 3.0}
    assert all(compared.ranking.mean_ranks[row.optimizer].estimate.value == row.rank for row in rows)
