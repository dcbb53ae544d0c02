"""A waveform as a press engineer judges it: figures of merit of one drop, and scans of width, voltage and frequency."""

from inkjet_env.jetting.figures_of_merit import Jetting, jetting
from inkjet_env.jetting.scans import Curve, RobustnessMap, Scan, scan

__all__ = ["Curve", "Jetting", "RobustnessMap", "Scan", "jetting", "scan"]
