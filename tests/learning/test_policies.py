import itertools
import json

import numpy as np
import pytest

from inkjet_env.envs.sb3 import BipolarWaveformVecEnv
from inkjet_env.experiments.learning.policies import Policy, policy_of_sb3
from inkjet_env.storage import archive_bytes

OBSERVATIONS = np.random.default_rng(0).uniform(-1, 1, (9, 4)).astype(np.float32)


def a_policy(end="tanh"):
    rng = np.random.default_rng(1)
    sizes = (4, 12, 7)
    weights = tuple(rng.standard_normal((b, a)) for a, b in itertools.pairwise(sizes))
    return Policy(weights, tuple(rng.standard_normal(n) for n in sizes[1:]), end, {"by": "hand"})


@pytest.mark.parametrize("end", ["tanh", "clip"])
def test_a_policy_is_read_as_it_was_written(tmp_path, end):
    policy = a_policy(end)
    policy.save(tmp_path / "p.npz")
    again = Policy.load(tmp_path / "p.npz")
    assert (again.act(OBSERVATIONS) == policy.act(OBSERVATIONS)).all()
    assert (again.end, again.made) == (end, {"by": "hand"})
    assert np.abs(policy.act(OBSERVATIONS)).max() <= 1


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_a_policy_acts_as_the_agent_it_was_taken_from(algorithm):
    import stable_baselines3
    from torch import nn

    envs = BipolarWaveformVecEnv(4, context="random")
    options = {"net_arch": [16, 16], "activation_fn": nn.Tanh}
    model = getattr(stable_baselines3, algorithm)("MlpPolicy", envs, policy_kwargs=options, seed=0, device="cpu")
    wanted, _ = model.predict(OBSERVATIONS, deterministic=True)
    found = policy_of_sb3(model, {}).act(OBSERVATIONS)
    np.testing.assert_allclose(found, np.clip(wanted, -1, 1), atol=2e-6)


def test_other_activations_are_refused():
    from stable_baselines3 import SAC

    model = SAC("MlpPolicy", BipolarWaveformVecEnv(2, context="random"), device="cpu")
    with pytest.raises(ValueError, match="must use tanh"):
        policy_of_sb3(model, {})


def header(**changes):
    names = {"observation": ["frequency_Hz", "damping_ratio", "gain", "hysteresis_strength"]}
    action = {"action": ["U1", "U2", "t1", "t2", "t3", "t4", "t5"]}
    return {"format": "policy/1", **names, **action, "layers": [[7, 4]], "end": "clip", "made": {}} | changes


@pytest.mark.parametrize(
    ("changes", "arrays", "said"),
    [
        ({"format": "policy/9"}, {}, "its format is 'policy/9'"),
        ({"observation": ["colour"]}, {}, "made for other observations"),
        ({"layers": [[7, 99999]]}, {}, "its layers are"),
        ({"end": "relu"}, {}, "end must be one of"),
        ({}, {"weight0": np.ones((7, 3))}, "must map 4 numbers to 7"),
        ({}, {"weight0": np.full((7, 4), np.nan)}, "must be finite"),
        ({}, {"weight0": np.array([["a"]])}, "is not a policy"),
    ],
)
def test_a_file_that_is_no_policy_is_refused_in_one_sentence(tmp_path, changes, arrays, said):
    whole = {"header": np.array(json.dumps(header(**changes))), "weight0": np.ones((7, 4)), "bias0": np.zeros(7)}
    (tmp_path / "p.npz").write_bytes(archive_bytes(whole | arrays))
    with pytest.raises(ValueError, match=f"p.npz: is not a policy .*{said}|{said}.*p.npz|p.npz: {said}"):
        Policy.load(tmp_path / "p.npz")


def test_a_pickle_is_never_loaded(tmp_path):
    with open(tmp_path / "p.npz", "wb") as file:
        np.savez(file, header=np.array({"run": print}, dtype=object))
    with pytest.raises(ValueError, match="pickled objects, which are never loaded"):
        Policy.load(tmp_path / "p.npz")
    with pytest.raises(ValueError, match="there is no such file"):
        Policy.load(tmp_path / "none.npz")
