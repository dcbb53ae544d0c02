import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inkjet_env.experiments.benchmark.regret_figure import draw_regrets, spread

HEIGHTS = st.lists(st.floats(0, 1), min_size=1, max_size=12).map(sorted)


@settings(deadline=None)  # the first loads SciPy
@given(HEIGHTS)
def test_labels_keep_their_order_and_distance(heights):
    moved = spread(heights, 0.1)
    assert np.all(np.diff(moved) >= 0.1 - 1e-12)


@settings(deadline=None)  # the first loads SciPy
@given(HEIGHTS)
def test_labels_move_on_the_average_by_nothing_and_where_there_is_room_not_at_all(heights):
    moved = spread(heights, 0.1)
    assert np.mean(moved) == pytest.approx(np.mean(heights))
    if len(heights) == 1 or np.diff(heights).min() >= 0.1:
        np.testing.assert_allclose(moved, heights, atol=1e-12)


def test_two_labels_at_one_height_move_apart_by_equal_parts():
    assert spread([0.0, 0.0, 1.0], 0.5).tolist() == [-0.25, 0.25, 1.0]


def test_every_curve_is_named_at_its_own_end():
    budgets = np.array([50.0, 150.0, 2000.0])
    curves = {
        "long": np.array([budgets, [0.8, 0.3, 0.02], [0.9, 0.4, 0.03], [1.0, 0.5, 0.04]]),
        "short": np.array([budgets[:2], [0.8, 0.3], [0.9, 0.41], [1.0, 0.5]]),
    }
    axes = draw_regrets(curves).axes[0]
    assert {text.get_text(): text.xy for text in axes.texts} == {"long": (2000.0, 0.03), "short": (150.0, 0.41)}
    assert [label.get_text() for label in axes.get_xticklabels()] == ["50", "150", "2,000"]
