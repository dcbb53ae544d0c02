import math
import re

import numpy as np
import pytest

from inkjet_env.experiments.benchmark import analysis
from inkjet_env.experiments.benchmark.analysis import Comparison
from inkjet_env.experiments.benchmark.conclusions import standings_sentences
from inkjet_env.experiments.benchmark.regret import scale_V
from inkjet_env.experiments.benchmark.run_files import RunKey, RunResult
from inkjet_env.experiments.benchmark.settings import BenchOutcome, BenchSettings
from inkjet_env.experiments.benchmark.suite import problem, suite

PROBLEMS = ("nominal", "stiff-head", "soft-head")


def an_outcome(tmp_path, curves, problems=PROBLEMS, budget=3):
    """Curves in the problem's scale: by optimiser and problem, one list of regrets a run."""
    repeats = len(next(iter(next(iter(curves.values())).values())))
    settings = BenchSettings(problems, tuple(curves), repeats=repeats, budget=budget)
    results = []
    for optimizer, by_problem in curves.items():
        for name, runs in by_problem.items():
            for repeat, regrets in enumerate(runs):
                costs = problem(name).best_known.cost + scale_V(name) * np.array(regrets)
                points = np.zeros((len(regrets), 7))
                results.append(RunResult.of(RunKey(optimizer, name, repeat), points, costs))
    return BenchOutcome(settings, tmp_path, results, {})


@pytest.fixture
def compared(tmp_path):
    good = {name: [[0.5, 0.005, 0.005], [0.5, 0.5, 0.002]] for name in PROBLEMS}
    bad = {name: [[0.9, 0.9, 0.8], [0.7, 0.6, 0.6]] for name in PROBLEMS}
    return Comparison(an_outcome(tmp_path, {"pso": bad, "cma-es": good}))


def test_a_problems_scale_is_what_fifty_random_waveforms_are_worse():
    points = np.random.default_rng(3).uniform(-1, 1, (50 * 400, 7))
    best = problem("nominal").evaluate(points).reshape(400, 50).min(axis=1)
    assert scale_V("nominal") == pytest.approx(best.mean() - problem("nominal").best_known.cost, rel=0.05)


def test_regrets_and_hits_are_in_that_scale(compared):
    np.testing.assert_allclose(compared.regrets("cma-es", "nominal", 2), [0.005, 0.5], atol=1e-6 / scale_V("nominal"))
    hits = compared.hits("cma-es", "nominal", [0.6, 0.01, 0.001])
    assert hits.tolist() == [[1, 2, math.inf], [1, 3, math.inf]]


def test_standings_rank_and_tell_how_sure(compared):
    found = compared.standings("all", 3)
    best, worst = found.rows
    assert (best.optimizer, best.rank, worst.optimizer, worst.rank) == ("cma-es", 1.0, "pso", 2.0)
    assert best.solved.value == 1.0
    assert best.quality.value == pytest.approx(0.0035, abs=1e-6)
    assert best.improvement.value == 1.0
    assert math.isnan(best.signed_rank.first)  # three problems are no sample of problems
    assert math.isnan(found.critical_difference)
    assert math.isnan(worst.improvement.value)
    assert found.problems == PROBLEMS


def test_three_sentences_say_what_one_may_conclude_each_with_its_interval(tmp_path):
    rng = np.random.default_rng(1)
    ends = {"pso": 0.6, "pso-printed": 0.9, "cma-es": 0.1, "lbfgsb-multistart": 0.01}
    problems = (*PROBLEMS, "damping-0.02", "damping-0.01")
    curves = {
        optimizer: {name: [[1.0, end + 0.05 * rng.random()] for _ in range(8)] for name in problems}
        for optimizer, end in ends.items()
    }
    del curves["lbfgsb-multistart"]["damping-0.02"]  # as if it could not be used there
    best, swarm, printed = standings_sentences(Comparison(an_outcome(tmp_path, curves, problems, 2)), "all", 2)
    assert best.startswith(
        "After 2 evaluations, cma-es has the best mean rank of those that can be used on all of these problems"
    )
    assert "its mean rank of 1.8 does not differ significantly from those of 3 of the other 3" in best
    assert "probability 1.00 (1.00 to 1.00)" in best
    assert "it is better than pso with posterior probability 1.00, equivalent with 0.00 and worse with 0.00" in best
    assert swarm.startswith("pso, the paper's particle swarm")
    assert "is number 3 of 4" in swarm
    assert re.search(r"regret of 0\.6\d? \(0\.6\d? to 0\.6\d?\)", swarm)
    assert "a lower cost than one of pso with probability 0.00 (0.00 to 0.00)" in printed


def test_one_problem_tells_nothing_of_others_and_who_is_level_is_told(tmp_path):
    level = {"nominal": [[1.0, 0.1, 0.1]] * 4}
    curves = {"pso": {"nominal": [[1.0, 0.6, 0.6]] * 4}, "pso-printed": level, "cma-es": level}
    said = standings_sentences(Comparison(an_outcome(tmp_path, curves, ("nominal",))), "all", 3)
    assert len(said) == 2  # of the printed swarm it is told in the first
    assert "pso-printed has the best mean rank (tied with cma-es). Its regret" in said[0]
    assert "a lower cost than one of pso with probability 1.00" in said[0]
    assert "problems of this kind" not in " ".join(said)
    assert "as a sample" not in " ".join(said)


def test_who_is_level_with_the_best_is_told_even_if_he_cannot_be_used_everywhere(tmp_path):
    problems = PROBLEMS[:2]
    curves = {
        "cma-es": {name: [[1.0, end]] * 4 for name, end in zip(problems, (0.5, 0.1), strict=True)},
        "lbfgsb-multistart": {problems[0]: [[1.0, 0.01]] * 4},
    }
    said = standings_sentences(Comparison(an_outcome(tmp_path, curves, problems, 2)), "all", 2)
    assert "cma-es has the best mean rank (tied with lbfgsb-multistart). Its regret" in said[0]


def test_who_is_level_with_the_swarm_is_told_with_its_place(tmp_path):
    level = {"nominal": [[1.0, 0.6]] * 4}
    curves = {"random": level, "cma-es": {"nominal": [[1.0, 0.1]] * 4}, "pso": level}
    said = standings_sentences(Comparison(an_outcome(tmp_path, curves, ("nominal",), 2)), "all", 2)
    assert "is number 2 of 3 (mean rank 2.5; tied with random), with" in said[1]


def test_who_is_told_from_all_others_is_told_so(tmp_path):
    problems = tuple(suite())[:16]
    ends = {"cma-es": 0.1, "random": 0.5, "sobol": 0.9}
    curves = {one: {name: [[1.0, end]] * 3 for name in problems} for one, end in ends.items()}
    first = standings_sentences(Comparison(an_outcome(tmp_path, curves, problems, 2)), "all", 2)[0]
    assert re.search(
        r"taken as a sample, its mean rank of 1\.\d differs significantly from those of the other 2 \(Nemenyi", first
    )


def test_dearer_gradients_shorten_the_runs_of_those_who_use_them(tmp_path):
    falling = [[1.0 - 0.1 * k for k in range(9)]] * 4
    curves = {
        "lbfgsb-multistart": dict.fromkeys(PROBLEMS, falling),
        "random": {name: [[0.5] * 9] * 4 for name in PROBLEMS},
    }
    first = standings_sentences(Comparison(an_outcome(tmp_path, curves, budget=9)), "all", 9)[0]
    assert "its mean rank of 1.0 would be 2.0 if that counted as 3" in first
    assert "and 2.0 if that counted as 8" in first


def test_regrets_within_a_microvolt_are_ties(tmp_path):
    one, other = 2.0 / scale_V("nominal"), 2.0000001 / scale_V("nominal")
    curves = {"pso": {"nominal": [[other]] * 3}, "cma-es": {"nominal": [[one]] * 3}}
    found = Comparison(an_outcome(tmp_path, curves, ("nominal",), 1)).standings("all", 1)
    assert next(row for row in found.rows if row.optimizer == "cma-es").improvement.value == 0.5


def test_a_problem_that_an_optimiser_cannot_be_used_on_counts_whole_as_missed(tmp_path):
    met = [[1e-9, 1e-9]] * 4
    curves = {"pso": dict.fromkeys(PROBLEMS, met), "lbfgsb-multistart": {"nominal": met}}
    compared = Comparison(an_outcome(tmp_path, curves, budget=2))
    assert compared.running_times("lbfgsb-multistart", "all", [2]) == pytest.approx([1 / 3])


def test_a_family_is_looked_at_by_itself(compared):
    assert compared.families == ("cost", "head")
    assert compared.in_family("head") == ("stiff-head", "soft-head")
    assert compared.standings("cost", 3).problems == ("nominal",)


def test_running_times_count_every_target_of_every_run(compared):
    share = compared.running_times("cma-es", "cost", [0, 1, 2, 3, 100])
    targets = np.array(analysis.TARGETS)
    first = np.mean(targets >= 0.5)
    assert share[0] == 0
    assert share[1] == pytest.approx(first)
    assert share[2] == pytest.approx((np.mean(targets >= 0.005) + first) / 2)
    assert share[4] == share[3] == pytest.approx((np.mean(targets >= 0.005) + np.mean(targets >= 0.002)) / 2)


def test_expected_time_counts_what_failed(tmp_path):
    runs = {"nominal": [[1.0, 0.5, 0.005], [1.0, 1.0, 1.0]]}
    compared = Comparison(an_outcome(tmp_path, {"pso": runs}, ("nominal",)))
    assert compared.expected_time("pso", "nominal", 0.01, np.random.default_rng(0)).value == 6
    assert compared.expected_time("pso", "nominal", 1e-9, np.random.default_rng(0)).value == math.inf


def test_what_cannot_be_used_somewhere_ranks_last_there_and_is_compared_where_it_can(tmp_path):
    def runs(level):
        return [[1.0, level, level]] * 4

    everywhere = {name: runs(0.5) for name in PROBLEMS}
    curves = {"pso": everywhere, "lbfgsb-multistart": {name: runs(0.1) for name in PROBLEMS[:2]}}
    found = Comparison(an_outcome(tmp_path, curves)).standings("all", 3)
    by_name = {row.optimizer: row for row in found.rows}
    lbfgs = by_name["lbfgsb-multistart"]
    assert lbfgs.applies == 2
    assert lbfgs.rank == pytest.approx((1 + 1 + 2) / 3)
    assert lbfgs.improvement.value == 1.0
    assert lbfgs.solved.value == 0.0


def test_budgets_are_those_that_the_runs_have(compared, tmp_path):
    assert compared.budgets == (3,)
    runs = {"nominal": [[1.0] * 160]}
    assert Comparison(an_outcome(tmp_path, {"pso": runs}, ("nominal",), 160)).budgets == (50, 150, 160)
