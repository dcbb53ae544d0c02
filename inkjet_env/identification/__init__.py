"""From recordings to a printhead with intervals: hysteresis, resonator and gains of all channels together."""

from inkjet_env.estimate import Estimate
from inkjet_env.identification.convention import in_convention
from inkjet_env.identification.degree import DegreeChoice
from inkjet_env.identification.errors import UnidentifiableError
from inkjet_env.identification.evaluate import Evaluation, evaluate
from inkjet_env.identification.identification import Identification
from inkjet_env.identification.identify import identify
from inkjet_env.identification.modelled_recording import ModelledRecording
from inkjet_env.identification.noise import NoiseModel

__all__ = [
    "DegreeChoice",
    "Estimate",
    "Evaluation",
    "Identification",
    "ModelledRecording",
    "NoiseModel",
    "UnidentifiableError",
    "evaluate",
    "identify",
    "in_convention",
]
