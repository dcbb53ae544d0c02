"""The peak cost, by hand and against its printed formula."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from inkjet_env.printhead import PeakCost

PEAKS = st.lists(st.floats(-20, 20), max_size=12)


@given(PEAKS)
def test_first_is_the_printed_formula(peaks):
    magnitude = [abs(p) for p in peaks]
    by_hand = sum(magnitude[2:]) + (-5 * magnitude[0] if peaks else 0) + (7 * magnitude[1] if len(peaks) > 1 else 0)
    assert PeakCost(-5, 7, "first")(peaks) == pytest.approx(by_hand, abs=1e-12)


def test_peaks_before_the_effective_one_count_with_weight_one():
    assert PeakCost(-5, 5, "largest")([1.0, -2.0, 6.0, -0.5, 0.25]) == 1 + 2 - 30 + 2.5 + 0.25


def test_the_earliest_of_equal_peaks_is_effective():
    assert PeakCost().effective_index([1.0, -3.0, 3.0]) == 1


def test_a_threshold_takes_the_first_peak_that_reaches_it():
    assert PeakCost(-5, 5, 2.0).effective_index([1.0, -2.0, 6.0]) == 1


def test_where_no_peak_reaches_the_threshold_all_have_weight_one():
    assert PeakCost(-5, 5, 9.0)([1.0, -2.0, 6.0]) == 9.0


def test_beyond_enough_the_effective_peak_counts_no_further():
    assert PeakCost(-50, 5, target_height_V=4.0)([1.0, -3.0, 0.5]) == 1 - 150 + 2.5
    assert PeakCost(-50, 5, target_height_V=4.0)([1.0, -6.0, 0.5]) == 1 - 200 + 2.5
    with pytest.raises(ValueError, match="target_height_V must be a magnitude above 0 V, or infinite; got 0"):
        PeakCost(target_height_V=0)


def test_no_peaks_cost_nothing():
    assert PeakCost()([]) == 0.0


@given(PEAKS)
def test_A_and_B_of_one_are_the_sum_of_all_peaks(peaks):
    assert PeakCost(1, 1, "largest")(peaks) == pytest.approx(sum(abs(p) for p in peaks))


def test_an_unknown_rule_is_refused_with_the_nearest_name():
    with pytest.raises(ValueError, match=r"got 'larges'\. Did you mean 'largest'\?"):
        PeakCost(effective="larges")
    with pytest.raises(ValueError, match="threshold of at least 0 V; got -1"):
        PeakCost(effective=-1)
    with pytest.raises(ValueError, match="A must be a number within"):
        PeakCost(A=float("nan"))
