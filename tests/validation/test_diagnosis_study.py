"""The cases of the study of the diagnosis on its own plant."""

import pytest

from experiments.validation.diagnosis_study import Case, cases, recorded


@pytest.mark.parametrize(("part", "count"), [("null", 100), ("single", 40), ("pairs", 20), ("withheld", 20)])
def test_every_part_has_its_cases_each_of_its_own_name(part, count):
    names = [case.name for case in cases(part, 1)]
    assert len(names) == len(set(names)) == count


def test_pairs_are_of_different_stages():
    from experiments.validation.synthetic_campaigns import effect_named

    for case in cases("pairs", 1):
        assert len({effect_named(name).stage for name in case.effects}) == 2


def test_nothing_is_planted_where_nothing_is_to_be():
    campaign, planted = recorded(Case("null", (), "none", 0))
    assert planted == []
    assert len(campaign.recordings) == 29


def test_what_is_planted_changes_the_recordings():
    campaign, planted = recorded(Case("single", ("feedthrough",), "medium", 0))
    plain, _ = recorded(Case("null", (), "none", 0))
    assert [effect.id for effect, _ in planted] == ["feedthrough"]
    fast = [i for i, r in enumerate(plain.recordings) if r.channel == "self_sensing" and r.excitation != "zero"]
    assert all((campaign.recordings[i].sensor != plain.recordings[i].sensor).any() for i in fast)
