"""Tuning concealed heads from nothing: which heads, by which instruments, and how it is counted."""

import numpy as np
import pytest

from inkjet_env.experiments.proof.answering import ConcealedRig
from inkjet_env.experiments.proof.concealment import conceal, plant_of
from inkjet_env.experiments.proof.corpus import Draw
from inkjet_env.experiments.proof.tuning_study import head_row, heads
from inkjet_env.experiments.proof.waveform_gain import checked
from inkjet_env.experiments.tuning.check import CHECKED
from inkjet_env.printhead import Bounds, Printhead
from inkjet_env.rig import Request, default_battery


@pytest.fixture(scope="module")
def plant():
    draw = Draw(7, "effect", ("trigger_delay",), "strong", False, 3, "white")
    return plant_of(draw, conceal(draw, "head-0").attempt)


def test_heads_are_of_all_effects_in_turn():
    chosen = heads(2001, 20)
    assert len({draw.effects for draw in chosen}) == 20
    assert {draw.strength for draw in chosen} == {"strong"}
    assert not {draw.effects[0] for draw in chosen} & {"mains_hum", "crosstalk", "baseline_drift"}


def test_the_concealed_plant_records_any_request_with_its_own_noise(plant):
    rig = ConcealedRig(plant)
    battery = default_battery(50e3)
    for line in (battery[0], battery[-1]):
        request = Request(line.label, line.channel, line.initial_state, line.step_s, line.drive_V)
        first, same, other = (rig.record(request, order) for order in (1, 1, 2))
        assert np.array_equal(first.sensor, same.sensor)
        assert not np.array_equal(first.sensor, other.sensor)
        true = plant.response(line.drive_V, line.step_s, line.channel, line.initial_state)
        sigma = plant.setup.instruments.sigma[line.channel]
        assert 0.3 * sigma < np.std(first.sensor - true) < 3 * sigma


def test_each_waveform_is_recorded_and_the_true_cost_of_the_chosen_one_is_told(plant):
    data = Printhead.published().as_json(
        fit={"base_heldout_rms_V": 0.1, "augmented_heldout_rms_V": 0.1, "channels": {}}
    )
    rng = np.random.default_rng(0)
    points = dict(zip(("robust", "augmented", "base"), rng.uniform(-1, 1, (3, 7)), strict=True))
    found = checked(data, data, points, ConcealedRig(plant), len(plant.setup.rows) + 1)
    assert set(found["measured"]) - {"refined-1", "refined-2"} == set(points)
    assert found["cost"] == pytest.approx(plant.peak_cost(np.array(found["waveforms"][found["chosen"]])))
    for name, point in points.items():
        assert found["waveforms"][name] == pytest.approx(Bounds().from_unit(point))
    risks = {name: cost_V + CHECKED * (worst_V - cost_V) for name, (cost_V, _, worst_V) in found["measured"].items()}
    assert found["chosen"] == min(risks, key=risks.get)


def test_a_waveform_that_was_not_proposed_is_the_best_one_like_it():
    costs = {"robust": -20.0, "base": -10.0}
    row = head_row({"costs": costs, "chosen": "robust", "oracle": -21.0})
    assert row == {"base": -10.0, "augmented": -20.0, "robust": -20.0, "loop": -20.0, "oracle": -21.0}
    assert head_row({"costs": {"fit": -5.0}, "chosen": "fit", "oracle": -6.0})["base"] == -5.0
