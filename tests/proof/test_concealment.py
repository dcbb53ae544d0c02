"""When a case is drawn again, and when not: only a strength out of reach is the draw's fault."""

import re

import pytest

from experiments.concealed_rig.strength import solved_strength
from inkjet_env.experiments.proof import concealment
from inkjet_env.experiments.proof.campaign_files import ProofError
from inkjet_env.experiments.proof.concealment import OUT_OF_REACH, conceal
from inkjet_env.experiments.proof.corpus import MOST_ATTEMPTS, Draw

DRAW = Draw(3, "effect", ("creep",), "strong", False, 1)


def jumping(strength):
    return 1.0 if strength < 1 else 4.0


@pytest.fixture
def refusals(monkeypatch):
    """Have the plant raise errors instead of being built; the attempts at which it was asked to."""
    attempts = []

    def raise_at_every_attempt(error):
        def refused(draw, attempt, rig):
            attempts.append(attempt)
            raise error

        monkeypatch.setattr(concealment, "plant_of", refused)
        return attempts

    return raise_at_every_attempt


@pytest.mark.parametrize(
    ("rho_of", "said"),
    [
        (lambda strength: 0.1 * strength, "creep (log) does not reach rho 2.0 within its bounds: 1 at its strongest."),
        (lambda strength: 9 + strength, "creep (log) cannot be as faint as rho 2.0: its weakest gives 9.1."),
        (jumping, "creep (log): no strength gives rho 2.0 within 1 %; it jumps there."),
    ],
)
def test_a_strength_that_no_parameter_gives_is_drawn_again(rho_of, said, refusals):
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        solved_strength(rho_of, 2.0, 0.5, 0.1, 10.0, "creep (log)")
    assert OUT_OF_REACH.search(said)
    attempts = refusals(caught.value)
    with pytest.raises(
        ProofError, match=rf"case 3 \(effect creep, strong\) was drawn 20 times without success: {re.escape(said)}"
    ):
        conceal(DRAW, "head-0")
    assert attempts == list(range(MOST_ATTEMPTS))


@pytest.mark.parametrize(
    "message",
    [
        "operands could not be broadcast together with shapes (3,) (4,)",
        "drive_V must be one finite row of two samples or more.",
    ],
)
def test_any_other_error_of_the_plant_is_not_hidden_by_drawing_again(message, refusals):
    attempts = refusals(ValueError(message))
    told = f"case 3 (effect creep, strong) cannot be built at attempt 0: {message}"
    with pytest.raises(RuntimeError, match=re.escape(told)):
        conceal(DRAW, "head-0")
    assert attempts == [0]


def test_a_case_that_no_plant_can_be_is_a_mistake_and_no_draw():
    with pytest.raises(RuntimeError, match=r"cannot be built at attempt 0: 'gremlins' is not of the family effect"):
        conceal(Draw(3, "effect", ("gremlins",), "strong", False, 1), "head-0")
