"""An inkjet printhead to simulate and to optimise.

Importing this package registers its Gymnasium environments; everything expensive (Gymnasium, compiler, plots) is
imported on use.
"""

import sys
from importlib.util import find_spec

__version__ = "0.1.0"
ENV_ID = "inkjet_env/BipolarWaveform-v0"
TUNE_ID = "inkjet_env/TuneWaveform-v0"
_CLASSES: dict = {
    ENV_ID: ("bipolar_waveform:BipolarWaveformEnv", "vector:BipolarWaveformVectorEnv", 20.5),
    TUNE_ID: ("tune_waveform:TuneWaveformEnv", "tune_waveform:TuneWaveformVectorEnv", None),
}
"""Classes of each environment, and the reward from which it counts as solved: for the published head nine tenths of the
best known, 22.83 V."""


def _register():
    import gymnasium

    for name, (single, vector, reward_threshold) in _CLASSES.items():
        if name not in gymnasium.registry:
            # No max_episode_steps: an episode terminates by itself, and a TimeLimit would report it as truncated too.
            gymnasium.register(
                name,
                entry_point=f"inkjet_env.envs.{single}",
                vector_entry_point=f"inkjet_env.envs.{vector}",
                reward_threshold=reward_threshold,
            )


class _RegisterOnImport:
    """Registers the environments when Gymnasium, which takes longer to import than this package, is imported."""

    def find_spec(self, fullname, path=None, target=None):
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module):
                execute(module)
                _register()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


if "gymnasium" in sys.modules:
    _register()
else:
    sys.meta_path.insert(0, _RegisterOnImport())
