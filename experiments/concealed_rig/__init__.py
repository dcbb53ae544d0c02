"""The sceptic's rig: campaigns of an independent plant in which an effect is concealed, and the truth about them.

It shares no equation with what looks for the effect: nothing but NumPy, SciPy and Numba is imported here.
"""

from experiments.concealed_rig.case import Case
from experiments.concealed_rig.concealed import Concealed, build

__all__ = ["Case", "Concealed", "build"]
