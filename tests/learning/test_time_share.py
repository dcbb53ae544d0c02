"""Share of a learning agent's time that the environment takes."""

import json

import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra learning")

from inkjet_env.experiments.learning import time_share


@pytest.mark.parametrize("batch", time_share.BATCHES)
def test_every_step_of_an_environment_is_timed(batch):
    envs = time_share.timed(time_share.batch_of(batch, 3, 0))
    envs.reset()
    before_s = envs.taken_s
    assert before_s > 0
    envs.step([envs.action_space.sample() for _ in range(3)])
    assert envs.taken_s > before_s


def test_the_environment_takes_part_of_the_time_and_the_steps_are_those_asked_for(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(time_share, "AGENT_HEADS", {"PPO": 8, "SAC": 2})
    time_share.main(["--steps", "80", "--json", str(tmp_path / "found.json")])
    found = json.loads((tmp_path / "found.json").read_text())["agents"]
    for algorithm, steps in (("PPO", 80), ("SAC", 8)):
        for one in found[algorithm].values():
            assert one["steps"] == steps
            assert 0 < one["environment_s"] < one["whole_s"]
            assert one["share"] == pytest.approx(one["environment_s"] / one["whole_s"])
    assert "PPO, 8 heads one after another" in capsys.readouterr().out
