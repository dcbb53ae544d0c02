"""Odd campaigns end with a verdict or a refusal in words."""

import pytest

from inkjet_env.experiments.validation.odd_campaigns import is_sentence, main, outcome_of

ONCE_FAILED = (17, 42, 72, 102, 122, 221, 301)
"""Seeds that ended in a traceback or a warning once: silent sensors, rounding, a law that no drive left out fits, a fit
without any residual."""


@pytest.mark.parametrize("seed", ONCE_FAILED)
def test_a_campaign_that_once_failed_has_an_outcome_in_words(seed):
    outcome = outcome_of(seed)
    assert outcome.kind != "failed", outcome.told


def test_the_command_tells_each_outcome_and_counts_them(capsys):
    assert main(["--first", "2", "--count", "3"]) == 0
    *lines, counts = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert "refused: " in counts


@pytest.mark.parametrize("text", ["math domain error", "SVD did not converge", "", "operands could not be broadcast."])
def test_what_was_not_written_for_a_user_is_no_refusal(text):
    assert not is_sentence(text)
