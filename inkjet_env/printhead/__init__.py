"""Physics of one waveform: no files other than the printhead's own, no plots, no Gymnasium."""

from inkjet_env.naming import check_name, nearest_name
from inkjet_env.printhead.cost import PeakCost
from inkjet_env.printhead.driver_limits import DriverLimits
from inkjet_env.printhead.hysteresis import BranchLaw, PlayOperators
from inkjet_env.printhead.lumped import LumpedElements
from inkjet_env.printhead.printhead import Printhead, QuasiStaticPrinthead, UnknownDynamicsError
from inkjet_env.printhead.response import Response
from inkjet_env.printhead.sampled import SampledResponse, respond_sampled
from inkjet_env.printhead.waveform import Bounds, Waveform, as_waveform_array

__all__ = [
    "Bounds",
    "BranchLaw",
    "DriverLimits",
    "LumpedElements",
    "PeakCost",
    "PlayOperators",
    "Printhead",
    "QuasiStaticPrinthead",
    "Response",
    "SampledResponse",
    "UnknownDynamicsError",
    "Waveform",
    "as_waveform_array",
    "check_name",
    "nearest_name",
    "respond_sampled",
]
