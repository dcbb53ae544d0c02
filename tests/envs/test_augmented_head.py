"""The environments on a printhead with effects."""

import gymnasium
import numpy as np
import pytest

import inkjet_env
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import PeakCost, Printhead, Waveform

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
AUGMENTED = AugmentedPrinthead(HEAD, ((EFFECTS["sensor_saturation"], {"limit": 5.0, "hardness": 20.0}),))
ACTIONS = np.random.default_rng(3).uniform(-1, 1, (4, 7)).astype(np.float32)


def test_the_reward_is_minus_the_cost_of_what_the_head_with_effects_shows(tmp_path):
    AUGMENTED.to_json(tmp_path / "head.json")
    for head in (AUGMENTED, tmp_path / "head.json"):
        env = gymnasium.make(inkjet_env.ENV_ID, printhead=head, cost={"A": -4, "B": 3})
        env.reset(seed=0)
        _, reward, *_, info = env.step(ACTIONS[0])
        response = AUGMENTED.respond(Waveform.from_array(info["waveform"]))
        assert -reward == info["cost"] == response.cost(PeakCost(-4, 3))
        assert reward != -HEAD.respond(Waveform.from_array(info["waveform"])).cost(PeakCost(-4, 3))
        assert env.unwrapped.printhead.printhead == HEAD


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_many_environments_equal_single_ones(noise):
    envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=4, printhead=AUGMENTED, noise=noise)
    envs.reset(seed=7)
    _, rewards, *_, infos = envs.step(ACTIONS)
    for i, action in enumerate(ACTIONS):
        env = gymnasium.make(inkjet_env.ENV_ID, printhead=AUGMENTED, noise=noise)
        env.reset(seed=7 + i)
        _, reward, *_, info = env.step(action)
        assert (reward, info["cost"]) == (rewards[i], infos["cost"][i])
        assert (reward == -info["cost"]) == (noise == 0)


def test_stable_baselines_sees_the_same():
    from inkjet_env.envs.sb3 import BipolarWaveformVecEnv

    vector = BipolarWaveformVecEnv(4, printhead=AUGMENTED)
    vector.reset()
    _, rewards, dones, infos = vector.step(ACTIONS)
    assert dones.all()
    expected = AUGMENTED.costs([info["waveform"] for info in infos])
    assert rewards == pytest.approx(-expected, rel=1e-6)


def test_the_picture_shows_it():
    env = gymnasium.make(inkjet_env.ENV_ID, printhead=AUGMENTED, render_mode="rgb_array")
    env.reset(seed=0)
    empty = env.render()
    env.step(ACTIONS[0])
    assert (env.render() != empty).any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"context": "random"}, 'varies a printhead without effects; this one has sensor_saturation.*context="fixed"'),
        ({"window_s": np.inf}, "an infinite window needs a printhead without effects"),
        ({"hysteresis": "one_point"}, "must be one of full_memory"),
    ],
)
def test_what_a_head_with_effects_cannot_do_is_refused_when_made(options, message):
    with pytest.raises(ValueError, match=message):
        gymnasium.make(inkjet_env.ENV_ID, printhead=AUGMENTED, **options)
