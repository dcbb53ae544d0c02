"""A fit that did not converge: its estimates have no intervals, and that is said."""

import importlib
import json
import math
from dataclasses import replace

import pytest

from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.evidence import NOT_CONVERGED
from inkjet_env.storage import json_text
from tests.mismatch.diagnoses import ids


@pytest.fixture
def never_converging(diagnosed, monkeypatch):
    """From here on, every fit that a diagnosis ends with says that it has not converged; and one from before."""
    usual = diagnosed("quadratic_damping")
    module = importlib.import_module("inkjet_env.mismatch.diagnose")
    polished = module._Work.polished

    def unfinished(self, *given):
        joint, chosen = polished(self, *given)
        joint.base = replace(joint.base, converged=False)
        return joint, replace(chosen, fit=replace(chosen.fit, converged=False))

    monkeypatch.setattr(module._Work, "polished", unfinished)
    return usual


def test_an_effect_whose_fit_did_not_converge_is_named_without_intervals_and_that_is_said(
    never_converging, recorded, head, effects
):
    campaign, looked_for = recorded("quadratic_damping"), [effects["feedthrough"], effects["quadratic_damping"]]
    found = diagnose(campaign, head, looked_for, 0, workers=1)
    assert (found.verdict, ids(found)) == ("named", ["quadratic_damping"])
    (named,) = found.effects
    (usual,) = never_converging.effects
    assert named.parameters.keys() == usual.parameters.keys()
    estimates = [*named.parameters.values(), *found.dynamics.values()]
    assert {e.high for e in estimates} == {math.inf}
    assert all(math.isfinite(e.value) and e.low <= 0 for e in estimates)
    assert named.sentence == f"{usual.sentence} {NOT_CONVERGED}"
    assert named.sentence in found.headline
    (note,) = found.notes
    assert note.startswith("The fit of quadratic damping did not converge")
    written = json.loads(json_text(found.as_json()))
    assert written["notes"] == [note]
    assert written["effects"][0]["sentence"] == named.sentence
    for number in written["effects"][0]["parameters"].values():
        assert (number["low"], number["high"]) == (None, None)


def test_a_base_model_whose_fit_did_not_converge_has_no_intervals_and_that_is_said(
    never_converging, recorded, head, effects
):
    found = diagnose(recorded("wave_echo"), head, [effects["feedthrough"]], 0, workers=1)
    assert found.verdict == "unknown"
    assert {e.high for e in found.dynamics.values()} == {math.inf}
    assert any(note.startswith("The fit of the base model did not converge") for note in found.notes)
