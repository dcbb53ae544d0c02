"""The reward with a reference waveform: minus the regret."""

import gymnasium
import numpy as np
import pytest

import inkjet_env
from inkjet_env.envs import make_task
from inkjet_env.printhead import Bounds, Printhead, Waveform

BEST = (100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)


def test_on_a_fixed_head_the_reference_itself_has_no_regret():
    env = gymnasium.make(inkjet_env.ENV_ID, reference=BEST)
    env.reset(seed=0)
    _, reward, _, _, info = env.step(Bounds().to_unit(BEST).astype(np.float32))
    assert reward == pytest.approx(0.0, abs=1e-4)
    assert info["cost"] == pytest.approx(-22.83, abs=0.01)
    env.reset()
    nothing = np.array([-1, 1, 0, 0, 0, 0, 0], np.float32)
    assert env.step(nothing)[1] == pytest.approx(-22.83, abs=0.01)


def test_on_a_drawn_head_it_is_stretched_in_proportion_to_the_period():
    env = gymnasium.make(inkjet_env.ENV_ID, context="random", reference=BEST)
    wide = Bounds(upper=(100, 0, *[60e-6] * 5))
    stretched_freely = gymnasium.make(inkjet_env.ENV_ID, context="random", reference=BEST, bounds=wide)
    for seed in range(5):
        for each, box in ((env, Bounds()), (stretched_freely, wide)):
            each.reset(seed=seed)
            head = each.unwrapped.printhead
            factor = Printhead.published().frequency_Hz / head.frequency_Hz
            waveform = np.clip([*BEST[:2], *np.multiply(BEST[2:], factor)], box.lower, box.upper)
            _, reward, _, _, info = each.step(np.zeros(7, np.float32))
            wanted = head.respond(Waveform.from_array(waveform)).cost() - info["cost"]
            assert reward == pytest.approx(wanted, abs=1e-9)


def test_the_reference_is_not_read_with_errors():
    with_reference, without = (
        gymnasium.make(inkjet_env.ENV_ID, noise=0.2, **options) for options in ({"reference": BEST}, {})
    )
    differences = []
    for seed in range(20):
        rewards = []
        for env in (with_reference, without):
            env.reset(seed=seed)
            rewards.append(env.step(np.zeros(7, np.float32))[1])
        differences.append(rewards[0] - rewards[1])
    assert len(set(rewards)) == 2
    np.testing.assert_allclose(differences, make_task(reference=BEST).references_V(np.zeros((1, 4)))[0], atol=1e-9)


def test_what_is_no_reference_is_refused():
    for reference, sentence in (
        ([1, 2, 3], "reference: "),
        ([BEST, BEST], "reference must be one waveform"),
        ([100, -100, -1e-6, 1e-6, 1e-6, 1e-6, 1e-6], "reference: "),
    ):
        with pytest.raises(ValueError, match=sentence):
            gymnasium.make(inkjet_env.ENV_ID, reference=reference)
    with pytest.raises(ValueError, match="reference cannot be given: the reward of a try"):
        gymnasium.make(inkjet_env.TUNE_ID, reference=BEST)


def test_the_published_head_is_solved_at_nine_tenths_of_the_best_known_reward():
    assert gymnasium.spec(inkjet_env.ENV_ID).reward_threshold == pytest.approx(0.9 * 22.832, abs=0.1)
