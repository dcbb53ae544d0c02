"""The noise is what it is said to be: an error of each peak's reading, with that peak's weight in the cost."""

import gymnasium
import numpy as np
import pytest

import inkjet_env
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform

# Rings loudly: within the window every peak is far above the noise, so that magnitudes are read without bias.
WAVEFORM = Waveform(60.0, -30.0, 5e-6, 3e-6, 8e-6, 12e-6, 4e-6)
WINDOW_S = 120e-6
NOISE = 0.02
READINGS = 20000


def readings(noise, effective="first", waveform=WAVEFORM, window_s=WINDOW_S):
    envs = gymnasium.make_vec(
        inkjet_env.ENV_ID,
        num_envs=READINGS,
        noise=noise,
        cost=PeakCost(-5, 3, effective),
        window_s=window_s,
        bounds=Bounds(waveform.to_array(), waveform.to_array()),
    )
    envs.reset(seed=1)
    _, rewards, _, _, infos = envs.step(np.zeros((READINGS, 7), dtype=np.float32))
    return -rewards, infos["cost"]


def test_noise_spreads_the_cost_by_the_peaks_weights_and_leaves_its_mean():
    response = Printhead.published().respond(WAVEFORM, window_s=WINDOW_S)
    assert np.abs(response.peaks_V).min() > 20 * NOISE
    cost = PeakCost(-5, 3, "first")
    spread = NOISE * np.linalg.norm(cost.weights(response.peaks_V))
    read, clean = readings(NOISE)
    assert np.unique(clean).size == 1
    assert clean[0] == pytest.approx(response.cost(cost), rel=1e-9)
    # Of 20,000 readings the mean is known to spread / 141 and the standard deviation to 0.5 %.
    assert abs(read.mean() - clean[0]) < 4 * spread / np.sqrt(READINGS)
    assert read.std() == pytest.approx(spread, rel=0.02)


def test_twice_the_noise_spreads_twice():
    read, clean = readings(NOISE)
    louder, _ = readings(2 * NOISE)
    np.testing.assert_allclose(louder - clean, 2 * (read - clean), rtol=1e-6, atol=1e-9)


def test_the_effective_peak_is_chosen_among_the_readings():
    response = Printhead.published().respond(WAVEFORM, window_s=WINDOW_S)
    magnitude = np.abs(response.peaks_V)
    threshold = float(magnitude[0])  # the first peak is just at the threshold: half of its readings miss it
    assert (magnitude[1:3] > threshold + 20 * NOISE).all()
    read, _ = readings(NOISE, effective=threshold)
    as_second = -5 * magnitude[1] + 3 * magnitude[2] + magnitude[0] + magnitude[3:].sum()
    as_first = -5 * magnitude[0] + 3 * magnitude[1] + magnitude[2:].sum()
    assert abs(as_first - as_second) > 20 * NOISE
    nearer_second = np.abs(read - as_second) < np.abs(read - as_first)
    assert abs(nearer_second.mean() - 0.5) < 4 * 0.5 / np.sqrt(READINGS)


def test_a_cost_told_beside_a_noisy_reward_is_that_without_noise():
    rewards = {}
    for noise in (0.0, 0.5):
        env = gymnasium.make(inkjet_env.ENV_ID, context="random", noise=noise)
        env.action_space.seed(2)
        env.reset(seed=2)
        _, reward, _, _, info = env.step(env.action_space.sample())
        rewards[noise] = reward, info["cost"]
    assert rewards[0.0][1] == rewards[0.5][1] == -rewards[0.0][0] != -rewards[0.5][0]
