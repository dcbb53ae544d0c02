"""The printhead with the effects that its base model leaves out, on sampled signals."""

from inkjet_env.plant.echo import Echo
from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.effects import catalogue
from inkjet_env.plant.errors import EffectError, SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, compiled_force
from inkjet_env.plant.registry import register
from inkjet_env.plant.resonance import Mode, Resonance
from inkjet_env.plant.stages import Plant

__all__ = [
    "Echo",
    "Effect",
    "EffectError",
    "Excitation",
    "Force",
    "Mode",
    "Parameter",
    "Plant",
    "Resonance",
    "SimulationError",
    "Values",
    "catalogue",
    "compiled_force",
    "register",
]
