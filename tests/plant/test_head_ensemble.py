"""Risks over heads with weights, and the ensemble's entry in a printhead file."""

import numpy as np
import pytest

from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import TAIL, HeadEnsemble, ensemble_of
from inkjet_env.printhead import Bounds, Printhead, batch

HEAD = Printhead.published()
MODE = next(effect for effect in catalogue() if effect.id == "second_mode")
WITH_MODE = AugmentedPrinthead(HEAD, ((MODE, MODE.example_values(HEAD)),))
WAVEFORMS = Bounds().from_unit(np.random.default_rng(0).uniform(-1, 1, (5, 7)))
ENSEMBLE = HeadEnsemble((HEAD, WITH_MODE, HEAD.varied(48e3)), (2.0, 1.0, 1.0))


def test_costs_are_those_of_each_head():
    costs = ENSEMBLE.costs(WAVEFORMS)
    np.testing.assert_allclose(costs[0], batch.costs(WAVEFORMS, HEAD), rtol=1e-12)
    np.testing.assert_allclose(costs[1], WITH_MODE.costs(WAVEFORMS), rtol=1e-12)
    np.testing.assert_allclose(costs[2], batch.costs(WAVEFORMS, HEAD.varied(48e3)), rtol=1e-12)


def test_weights_are_scaled_to_a_sum_of_one():
    assert ENSEMBLE.weights == (0.5, 0.25, 0.25)


def test_risks_are_those_worked_out_by_hand():
    costs = np.array([[1.0], [5.0], [3.0]])
    assert ENSEMBLE.risk(costs, "mean") == pytest.approx([2.5])
    assert ENSEMBLE.risk(costs, "worst") == pytest.approx([5.0])
    assert ENSEMBLE.risk(costs, "cvar") == pytest.approx([5.0])  # the worst head alone weighs more than the tail
    tenth = HeadEnsemble((HEAD,) * 10, (1.0,) * 10)
    assert tenth.risk(np.arange(10.0)[:, None], "cvar") == pytest.approx([8.5])  # the worst two of ten
    split = HeadEnsemble((HEAD,) * 2, (0.05, 0.95))
    assert split.risk(np.array([[10.0], [0.0]]), "cvar") == pytest.approx([10.0 * 0.05 / TAIL])


def test_risks_are_ordered():
    costs = ENSEMBLE.costs(WAVEFORMS)
    mean, cvar, worst = (ENSEMBLE.risk(costs, kind) for kind in ("mean", "cvar", "worst"))
    assert (mean <= cvar + 1e-12).all()
    assert (cvar <= worst + 1e-12).all()


def test_a_quantile_is_the_cost_that_a_share_of_the_weights_does_not_exceed():
    costs = np.array([1.0, 5.0, 3.0])
    assert [ENSEMBLE.quantile(costs, share) for share in (0.05, 0.5, 0.51, 0.75, 0.76, 1.0)] == [1, 1, 3, 3, 5, 5]


def test_an_ensemble_is_read_as_it_is_written():
    again = ensemble_of({"ensemble": ENSEMBLE.as_json()})
    assert again.weights == ENSEMBLE.weights
    np.testing.assert_allclose(again.costs(WAVEFORMS), ENSEMBLE.costs(WAVEFORMS), rtol=1e-12)
    assert ensemble_of({}) is None


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ("heads", "ensemble must be a list"),
        ([{"weight": 1.0}], "ensemble must be a list"),
        ([{"weight": "1", "printhead": HEAD.as_json()}], "each weight of the ensemble must be a finite number"),
        ([{"weight": -1.0, "printhead": HEAD.as_json()}], "must be positive"),
        ([{"weight": 1.0, "printhead": {}}], "which a printhead/1 file needs"),
        ([], "an ensemble needs a weight for each of its heads"),
    ],
)
def test_what_is_no_ensemble_is_refused(entries, said):
    with pytest.raises(ValueError, match=said):
        ensemble_of({"ensemble": entries})


def test_an_unknown_risk_is_refused():
    with pytest.raises(ValueError, match="Did you mean 'cvar'"):
        ENSEMBLE.risk(np.zeros((3, 1)), "cvr")
