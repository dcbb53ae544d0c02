import numpy as np
import pytest

from inkjet_env.experiments.benchmark.studies.figure7 import (
    CLAIMS,
    GENERATIONS,
    Reproduction,
    effective_and_later,
    reproduce,
    table,
)
from inkjet_env.experiments.benchmark.suite import problem
from inkjet_env.printhead import Waveform


@pytest.fixture(scope="module")
def runs():
    return [reproduce(seed) for seed in range(8)]


def test_most_runs_raise_the_effective_peak_and_silence_the_one_after_it(runs):
    found = [run.claims() for run in runs]
    for claim in ("higher", "unrivalled after", "settled"):
        assert sum(f[claim] for f in found) >= 5, claim


def test_in_some_run_every_claim_of_the_figure_holds(runs):
    assert any(all(run.claims().values()) for run in runs)


def test_cost_never_rises_from_generation_to_generation(runs):
    for run in runs:
        assert run.costs.shape == (GENERATIONS,)
        assert (np.diff(run.costs) <= 0).all()
        assert run.response(GENERATIONS).cost() == pytest.approx(run.costs[-1], abs=1e-7)


def test_a_run_that_stands_still_fails_no_claim_but_those_about_change():
    solved = problem("nominal")
    calm = np.tile(solved.bounds.to_unit(solved.best_known.waveform), (GENERATIONS, 1))
    found = Reproduction(0, solved, calm, np.full(GENERATIONS, -22.8)).claims()
    assert [name for name, holds in found.items() if not holds] == ["rivalled before"]


def test_a_late_move_is_not_settled():
    solved = problem("nominal")
    points = np.tile(solved.bounds.to_unit(solved.best_known.waveform), (GENERATIONS, 1))
    points[-3, 4] -= 0.2
    assert not Reproduction(0, solved, points, np.zeros(GENERATIONS)).claims()["settled"]


def test_effective_peak_and_those_after_it_are_read_in_time_order():
    solved = problem("nominal")
    response = solved.printhead.respond(Waveform(100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6))
    np.testing.assert_allclose(effective_and_later(response, solved.cost), [6.945, 0.655, 1.904], atol=1e-3)


def test_table_names_every_claim_and_every_seed(runs):
    text = table(runs[:3])
    assert all(sentence in text for sentence in CLAIMS.values())
    assert text.count("of 3:") == len(CLAIMS) + 1
