"""An inkjet printhead to simulate and to optimise.

Importing this package registers its Gymnasium environments; everything expensive (compiler, plots) is imported on use.
"""

import gymnasium

ENV_ID = "inkjet_env/BipolarWaveform-v0"
TUNE_ID = "inkjet_env/TuneWaveform-v0"

for _id, _single, _vector in (
    (ENV_ID, "bipolar_waveform:BipolarWaveformEnv", "vector:BipolarWaveformVectorEnv"),
    (TUNE_ID, "tune_waveform:TuneWaveformEnv", "tune_waveform:TuneWaveformVectorEnv"),
):
    if _id not in gymnasium.registry:
        # No max_episode_steps: an episode terminates by itself, and a TimeLimit would report it as truncated too.
        gymnasium.register(
            _id, entry_point=f"inkjet_env.envs.{_single}", vector_entry_point=f"inkjet_env.envs.{_vector}"
        )
