"""What a diagnosis is given besides its campaign: a head, effects, random numbers, workers, progress."""

import numpy as np
import pytest

from inkjet_env.mismatch import diagnose
from inkjet_env.storage import json_text
from tests.mismatch.diagnoses import LOOKED_FOR, ids


def test_without_a_printhead_it_is_identified(recorded, head, effects):
    looked_for = [effects[name] for name in LOOKED_FOR]
    found = diagnose(recorded("feedthrough"), None, looked_for, workers=1)
    assert (found.verdict, ids(found)) == ("named", ["feedthrough"])
    assert found.printhead.frequency_Hz == pytest.approx(head.frequency_Hz, rel=1e-3)
    assert found.base_printhead.frequency_Hz == pytest.approx(head.frequency_Hz, rel=1e-3)


def test_a_given_printhead_is_where_the_fit_begins_and_not_where_it_ends(recorded, head, effects):
    looked_for = [effects["feedthrough"]]
    off = head.varied(head.frequency_Hz * 1.01, head.damping_ratio * 1.1)
    found = diagnose(recorded(), off, looked_for, workers=1)
    assert found.verdict == "none"
    assert found.printhead.frequency_Hz == pytest.approx(head.frequency_Hz, rel=1e-3)


def without_clock(diagnosis):
    written = diagnosis.as_json()
    del written["seconds"]
    return json_text(written)


def test_the_same_numbers_drawn_give_the_same_diagnosis_on_any_number_of_workers(recorded, head, effects):
    campaign, looked_for = recorded("feedthrough"), [effects[name] for name in LOOKED_FOR]
    told = [
        without_clock(diagnose(campaign, head, looked_for, rng, workers=workers))
        for rng, workers in ((5, 1), (np.random.default_rng(5), 1), (5, 2))
    ]
    assert told[0] == told[1] == told[2]


def test_no_effects_to_look_for_leaves_none_or_unknown(recorded, head):
    assert diagnose(recorded(), head, [], workers=1).verdict == "none"
    found = diagnose(recorded("quadratic_damping"), head, [], workers=1)
    assert (found.verdict, found.attributions) == ("unknown", ())


def test_what_is_being_done_is_told(recorded, head, effects):
    told = []
    diagnose(recorded("feedthrough"), head, [effects["feedthrough"]], workers=1, progress=told.append)
    assert "fitting the base model" in told
    assert "score test of feedthrough (1 of 2)" in told
    assert told[-3:] == [
        "fitting the remainder",
        "designing the next experiment",
        "drawing heads that the recordings leave possible",
    ]
