"""Effects beside the named ones: those of overwhelming evidence complete the model, and no others."""

import pytest

from inkjet_env.experiments.validation.synthetic_campaigns import record_synthetic
from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.selection.hypotheses import base_hypothesis, settled
from inkjet_env.mismatch.selection.minor_effects import held_out_gain, with_minor_effects
from inkjet_env.mismatch.selection.score_test import signatures
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete
from inkjet_env.reporting.diagnosis_report import diagnosis_html

LOOKED_FOR = ("quadratic_damping", "feedthrough", "sensor_bandwidth")


@pytest.fixture(scope="module")
def both(effects, values, head):
    """A quiet campaign with much quadratic damping and a little feedthrough."""
    from tests.mismatch.conftest import campaign_lines

    little = {name: 0.2 * value for name, value in values("feedthrough").items() if name == "capacitive_s"}
    planted = [
        (effects["quadratic_damping"], values("quadratic_damping")),
        (effects["feedthrough"], complete(effects["feedthrough"], **little)),
    ]
    return record_synthetic(head, planted, 3, 70.0, lines=campaign_lines())


def test_a_minor_effect_completes_the_model_and_is_told(both, head, effects):
    found = diagnose(both, head, [effects[name] for name in LOOKED_FOR], workers=1)
    assert [e.effect.id for e in found.effects] == ["quadratic_damping"]
    assert [e.effect.id for e in found.minor] == ["feedthrough"]
    assert found.as_json()["minor"][0]["id"] == "feedthrough"
    assert "Minor, but beyond doubt: feedthrough." in found.headline
    assert [e["id"] for e in found.augmented_json()["effects"]] == ["quadratic_damping", "feedthrough"]
    assert "<code>feedthrough</code>, a minor effect" in diagnosis_html(found)


def test_where_nothing_else_is_nothing_is_added(fitted, recorded, effects, values):
    joint = fitted(recorded("quadratic_damping"))
    looked_for, context = [effects[name] for name in LOOKED_FOR], FitContext(ProcessPool(1))
    found = signatures(joint, looked_for, context)
    begun = ActiveEffects.of([(effects["quadratic_damping"], values("quadratic_damping"))])
    chosen = settled(joint, joint.fit(begun))
    assert with_minor_effects(chosen, looked_for, found, context) is chosen
    gain, error = held_out_gain(base_hypothesis(joint), chosen)
    assert gain > 10 * error > 0
