"""What numbers depend on besides their settings."""

import pytest

from inkjet_env.experiments.execution.provenance import code_digest, first_difference


def test_first_difference_names_the_place():
    assert first_difference({"a": {"b": [1, 2]}}, {"a": {"b": [1, 3]}}) == "a b is 1, 2 there and 1, 3 here"
    assert first_difference({"a": 1}, {"a": 1, "c": 2}) == "c is new here"
    assert first_difference({"a": 1}, {"a": 1}) == ""


def test_a_pattern_that_matches_no_file_is_named():
    with pytest.raises(ValueError, match=r"the pattern 'optimizers/no_such\*\.py' matches no file"):
        code_digest(["optimizers/*.py", "optimizers/no_such*.py"])
