"""Verdicts held against what was hidden."""

import math

import pytest

from inkjet_env.experiments.validation.verdict_scores import VerdictRecord, confusion, f1, share


def told(truth, verdict, found=(), *groups):
    return VerdictRecord(frozenset(truth), verdict, frozenset(found), tuple(frozenset(group) for group in groups))


@pytest.mark.parametrize(
    ("one", "judged"),
    [
        (told((), "none"), "right"),
        (told((), "named", "a"), "wrong"),
        (told("a", "none"), "none"),
        (told("a", "named", "a"), "right"),
        (told("a", "named", "b"), "wrong"),
        (told("a", "named", "ab"), "partly"),
        (told("a", "set", "b", "ba"), "in the set"),
        (told("a", "set", "b", "bc"), "wrong"),
        (told("ab", "set", "bc", "ca"), "in the set"),
        (told("ab", "named", "b"), "partly"),
        (told("a", "unknown"), "unknown"),
        (told((), "unknown"), "unknown"),
        (told("a", "refused"), "refused"),
    ],
)
def test_a_verdict_is_judged_by_what_was_hidden(one, judged):
    assert one.judged == judged


def test_a_confusion_matrix_counts_every_campaign_once():
    these = [told("a", "named", "a"), told("a", "named", "b"), told("b", "set", "a", "ab"), told("b", "set", "a", "ac"),
             told((), "none"), told("a", "named", "ab"), told("b", "unknown"), told("ab", "named", "ab")]  # fmt: skip
    table = confusion(these, ("a", "b", "c"))
    assert table["a"] == {"a": 1, "b": 1, "c": 0, "none": 0, "set": 0, "wrong set": 0, "unknown": 0, "several": 1,
                          "refused": 0}  # fmt: skip
    assert (table["b"]["set"], table["b"]["wrong set"], table["b"]["unknown"]) == (1, 1, 1)
    assert table["nothing"]["none"] == 1
    assert sum(sum(row.values()) for row in table.values()) == 7


def test_f1_is_one_for_all_found_and_counts_misses_and_inventions():
    assert f1([told("ab", "named", "ab"), told("ab", "set", "ac", "cb")]) == 1.0
    assert f1([told("ab", "named", "a")]) == pytest.approx(2 * 1 * 0.5 / 1.5)
    assert f1([told("ab", "named", "abc")]) == pytest.approx(2 * (2 / 3) * 1 / (2 / 3 + 1))
    assert f1([told("ab", "unknown")]) == 0.0
    assert math.isnan(f1([]))


def test_a_share_lies_in_its_interval_which_narrows():
    value, low, high = share(8, 300)
    assert low < value == 8 / 300 < high
    wider = share(1, 30)
    assert wider[2] - wider[1] > high - low
    assert share(0, 100)[:2] == (0.0, 0.0)
    assert math.isnan(share(0, 0)[0])
