"""An inkjet printhead to simulate and to optimise.

Importing this package registers its Gymnasium environment; everything that costs (compiler, plots) is imported on use.
"""

import gymnasium

ENV_ID = "inkjet_env/BipolarWaveform-v0"

if ENV_ID not in gymnasium.registry:
    # No max_episode_steps: an episode terminates by itself, and a TimeLimit would report it as truncated too.
    gymnasium.register(
        ENV_ID,
        entry_point="inkjet_env.envs.bipolar_waveform:BipolarWaveformEnv",
        vector_entry_point="inkjet_env.envs.vector:BipolarWaveformVectorEnv",
    )
