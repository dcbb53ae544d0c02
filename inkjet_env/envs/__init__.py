"""The printhead as a Gymnasium environment: single, vectorised, and for Stable-Baselines3 (`inkjet_env.envs.sb3`)."""

from inkjet_env.envs.bipolar_waveform import BipolarWaveformEnv
from inkjet_env.envs.task import WaveformTask, make_task
from inkjet_env.envs.tune_waveform import TuneWaveformEnv, TuneWaveformVectorEnv
from inkjet_env.envs.vector import BipolarWaveformVectorEnv

__all__ = [
    "BipolarWaveformEnv",
    "BipolarWaveformVectorEnv",
    "TuneWaveformEnv",
    "TuneWaveformVectorEnv",
    "WaveformTask",
    "make_task",
]
