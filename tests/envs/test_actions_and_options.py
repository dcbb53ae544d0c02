"""What is refused, and in which words."""

import gymnasium
import numpy as np
import pytest

import inkjet_env
from inkjet_env.printhead import Bounds, PeakCost, Printhead


def make(**options):
    env = gymnasium.make(inkjet_env.ENV_ID, **options)
    env.reset(seed=0)
    return env


def action_with(index, value, dtype=np.float32):
    action = np.zeros(7, dtype=dtype)
    action[index] = value
    return action


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (action_with(1, 1.5), r"action U2 must be within \[-1, 1\]; got 1.5. Scale it, or pass clip_actions=True"),
        (action_with(6, -np.inf), r"action t5 must be within \[-1, 1\]; got -inf"),
        (action_with(0, np.float32(1 + 5 * 2**-23)), r"action U1 .*got 1.0000006"),
        (action_with(2, np.nan), r"action t1 must be a number; got nan"),
        (np.zeros(6), r"action must have shape \(7,\).*got shape \(6,\)"),
        (np.zeros((1, 7)), r"action must have shape \(7,\).*got shape \(1, 7\)"),
        ("high", r"action must be numbers of shape \(7,\)"),
    ],
)
@pytest.mark.parametrize("wrapped", [True, False])
def test_a_bad_action_is_refused(action, message, wrapped):
    env = make()
    if wrapped:  # past the passive checker's own look at the first step
        env.step(np.zeros(7, dtype=np.float32))
        env.reset()
    with pytest.raises(ValueError, match=message):
        (env if wrapped else env.unwrapped).step(action)


def test_a_bad_action_of_many_is_named_with_its_row():
    envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=3)
    envs.reset(seed=0)
    actions = np.zeros((3, 7), dtype=np.float32)
    actions[2, 4] = -2
    with pytest.raises(ValueError, match=r"action t3 must be within \[-1, 1\]; got -2 in row 2"):
        envs.step(actions)
    with pytest.raises(ValueError, match=r"shape \(3, 7\).*got shape \(7,\)"):
        envs.step(actions[0])


def test_clipping_takes_the_nearest_waveform_in_the_box_but_no_nan():
    env = make(clip_actions=True)
    info = env.step(np.array([3, 0, -1.5, 0, 0, 0, np.inf], dtype=np.float32))[4]
    np.testing.assert_array_equal(info["waveform"], Bounds().from_unit([1, 0, -1, 0, 0, 0, 1]))
    env.reset()
    with pytest.raises(ValueError, match="action U2 must be a number; got nan"):
        env.step(np.array([3, np.nan, 0, 0, 0, 0, 0], dtype=np.float32))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"context": "randm"}, "context must be one of fixed, random; got 'randm'. Did you mean 'random'"),
        ({"hysteresis": "onepoint"}, "hysteresis must be one of .*Did you mean 'one_point'"),
        ({"initial_state": "demagnetized"}, "initial_state .*Did you mean 'demagnetised'"),
        ({"cost": {"efective": "first"}}, "a key of cost .*Did you mean 'effective'"),
        ({"cost": {"effective": "frist"}}, "effective must be .*Did you mean 'first'"),
        ({"cost": -5}, "cost must be a PeakCost, a dict or None; got -5"),
        ({"bounds": {"low": 0}}, "a key of bounds must be one of lower, upper"),
        ({"noise": -0.1}, "noise must be a standard deviation of 0 to 1e6 V; got -0.1"),
        ({"noise": float("nan")}, "noise must be"),
        ({"noise": "loud"}, "noise must be"),
        ({"window_s": 0}, "window_s must be a time above 0 s"),
        ({"clip_actions": "no"}, "clip_actions must be True or False; got 'no'"),
        ({"printhead": 3}, "printhead must be a Printhead, the path"),
        ({"printhead": "missing.json"}, "missing.json: cannot be read"),
    ],
)
def test_an_option_that_is_not_offered_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        gymnasium.make(inkjet_env.ENV_ID, **options)
    with pytest.raises(ValueError, match=message):
        gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=2, **options)


@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes.*")
def test_a_render_mode_that_is_not_offered_is_refused():
    with pytest.raises(ValueError, match=r"render_mode must be one of human, rgb_array; got 'rgb_aray'. Did you mean"):
        gymnasium.make(inkjet_env.ENV_ID, render_mode="rgb_aray")
    with pytest.raises(ValueError, match="vector environment must be 'rgb_array' or None"):
        gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=2, render_mode="human")


@pytest.mark.parametrize(
    ("name", "misspelt", "told"),
    [
        (
            inkjet_env.ENV_ID,
            "contxt",
            "'contxt': .* has no option of this name. Did you mean 'context'. Its options are render_mode, .*noise",
        ),
        (inkjet_env.TUNE_ID, "peeks", "'peeks': .* Did you mean 'peaks'. Its options are tries, peaks, noise"),
        (inkjet_env.ENV_ID, "max_episode_step", "Did you mean 'max_episode_steps'"),
        (inkjet_env.TUNE_ID, "qqq", "'qqq': the environment has no option of this name. Its options are"),
    ],
)
def test_a_misspelt_option_is_told_with_the_nearest_and_the_list(name, misspelt, told):
    with pytest.raises(ValueError, match=told):
        gymnasium.make(name, **{misspelt: 1})
    with pytest.raises(ValueError, match=told.replace("are render_mode", "are num_envs, render_mode").replace(
        "are tries", "are num_envs, tries")):  # fmt: skip
        gymnasium.make_vec(name, num_envs=2, **{misspelt: 1})


def test_a_misspelt_option_of_the_vector_form_is_told_with_the_nearest():
    for misspelt, nearest in (("autoreset", "autoreset_mode"), ("thread", "threads"), ("num_env", "num_envs"),
                              ("vectorisation_mode", "vectorization_mode")):  # fmt: skip
        with pytest.raises(ValueError, match=f"Did you mean '{nearest}'"):
            gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=2, **{misspelt: 1})
    for options, sentence in (
        ({"autoreset_mode": "SameStp"}, "autoreset_mode must be one of .*Did you mean 'SameStep'"),
        ({"threads": 0}, "threads must be a whole number of at least 1, or None for the number of cores; got 0"),
    ):
        with pytest.raises(ValueError, match=sentence):
            gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=2, **options)


def test_an_unknown_option_can_be_tried_and_taken_back():  # as TorchRL does, by error and words
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        gymnasium.make(inkjet_env.ENV_ID, frameskip=1)


def test_an_unknown_reset_option_is_refused():
    with pytest.raises(ValueError, match="reset takes no options; got 'context'"):
        make().reset(options={"context": "random"})


@pytest.mark.parametrize("seed", [[1, 2], [1, 2, 3, 4]])
def test_seeds_are_one_or_as_many_as_heads(seed):
    envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=3)
    with pytest.raises(ValueError, match="seed must be a number, or 3 of them"):
        envs.reset(seed=seed)


@pytest.mark.parametrize(("seed", "error"), [(-1, gymnasium.error.Error), (0.5, TypeError), ([1, "2"], TypeError)])
def test_a_seed_is_a_whole_number_from_zero_on(seed, error):
    envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=2)
    with pytest.raises(error):
        envs.reset(seed=seed)


@pytest.mark.parametrize("num_envs", [0, 2.5, True])
def test_the_number_of_heads_is_a_whole_positive_one(num_envs):
    with pytest.raises(ValueError, match="num_envs must be a whole number of at least 1"):
        gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=num_envs)


def test_a_printhead_file_is_read(tmp_path):
    head = Printhead.published().varied(frequency_Hz=60e3, gain=1.1)
    head.to_json(tmp_path / "printhead.json")
    action = np.full(7, 0.3, dtype=np.float32)
    from_file = make(printhead=tmp_path / "printhead.json", cost=PeakCost(-4, 4)).step(action)
    assert from_file[1] == make(printhead=head, cost={"A": -4, "B": 4}).step(action)[1] != make().step(action)[1]


def test_a_fixed_head_shows_its_own_numbers_within_the_space_even_outside_the_drawn_ranges():
    observation, _ = make().reset()
    np.testing.assert_allclose(observation, [-0.046, -0.3245, 0, 0], atol=1e-3)
    outside = make(printhead=Printhead.published().varied(frequency_Hz=105e3))
    observation, _ = outside.reset()
    assert observation[0] == 3
    assert observation in outside.observation_space
    assert (outside.observation_space.low == -1).all()
