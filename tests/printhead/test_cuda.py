"""The kernel for graphics processors, in numba's simulator: the costs of the scalar path."""

import os
import subprocess
import sys

import pytest

SCRIPT = """
import numpy as np
from inkjet_env.printhead import Bounds, PeakCost, Printhead, batch, cuda

rows = Bounds().from_unit(np.random.default_rng(0).uniform(-1, 1, (30, 7)))
head = Printhead.published()
table = batch.varied_head_table(head, np.linspace(35e3, 70e3, 30), 0.05, 1.1, 0.9)
for heads in (head, table):
    for settings in (
        {}, {"initial_state": "demagnetised"}, {"hysteresis": "one_point"}, {"cost": PeakCost(-5, 1, "first")},
        {"cost": PeakCost(-5, 5, 2.0, 4.0), "window_s": 60e-6}, {"window_s": 5e-3},
    ):
        difference = np.abs(cuda.costs(rows, heads, **settings) - batch.costs(rows, heads, **settings)).max()
        assert difference < 1e-9, (settings, difference)
assert cuda.costs(rows[:0], head).shape == (0,)
print("equal")
"""
ENVIRONMENT = """
import gymnasium, numpy as np
import inkjet_env
from inkjet_env.printhead import cuda as on_device

fired, fire = [], on_device.fire
on_device.fire = lambda waveforms, *others: (fired.append(len(waveforms)), fire(waveforms, *others))
scalar, cuda = (
    gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=20, context="random", simulator=name) for name in ("scalar", "cuda")
)
assert np.array_equal(scalar.reset(seed=1)[0], cuda.reset(seed=1)[0])
actions = np.random.default_rng(0).uniform(-1, 1, (20, 7)).astype(np.float32)
_, rewards, *_, infos = cuda.step(actions)
assert fired == [20]
assert np.abs(rewards - scalar.step(actions)[1]).max() < 1e-9
assert np.array_equal(rewards, -infos["cost"])
print("equal")
"""
WITHOUT = """
from inkjet_env.printhead import Printhead, cuda
try:
    cuda.costs([[100, -100, 1e-6, 1e-5, 1e-5, 1e-5, 1e-5]], Printhead.published())
except RuntimeError as error:
    print(error)
from inkjet_env.envs.vector import BipolarWaveformVectorEnv
try:
    BipolarWaveformVectorEnv(2, simulator="cuda")
except RuntimeError as error:
    print(error)
"""


def run(script, **environment):
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ | environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_costs_are_those_of_the_scalar_path():
    assert run(SCRIPT, NUMBA_ENABLE_CUDASIM="1") == "equal\n"


def test_the_vector_environment_gets_the_same_costs_from_it():
    assert run(ENVIRONMENT, NUMBA_ENABLE_CUDASIM="1") == "equal\n"


def test_without_a_graphics_processor_one_sentence_says_so():
    from numba import cuda

    if cuda.is_available():
        pytest.skip("there is a graphics processor")
    lines = run(WITHOUT).splitlines()
    assert len(lines) == 2
    for line in lines:
        assert line.startswith("no CUDA device is found: inkjet_env.printhead.cuda needs an NVIDIA driver")
