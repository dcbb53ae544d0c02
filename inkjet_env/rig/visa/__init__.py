"""Instruments over VISA: a waveform generator and an oscilloscope as a `Rig`, to adapt to a lab's own."""

from inkjet_env.rig.visa.commands import GeneratorCommands, OscilloscopeCommands
from inkjet_env.rig.visa.generator import Generator
from inkjet_env.rig.visa.instrument import Instrument, InstrumentError
from inkjet_env.rig.visa.oscilloscope import Oscilloscope, ScopeInput
from inkjet_env.rig.visa.visa_rig import Demagnetisation, VisaRig

__all__ = [
    "Demagnetisation",
    "Generator",
    "GeneratorCommands",
    "Instrument",
    "InstrumentError",
    "Oscilloscope",
    "OscilloscopeCommands",
    "ScopeInput",
    "VisaRig",
]
