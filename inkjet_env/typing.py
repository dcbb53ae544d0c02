"""Types shared by signatures."""

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
"""An array of doubles; the docstring that uses it gives shape and unit."""
