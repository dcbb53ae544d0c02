"""Types that signatures share."""

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
"""An array of doubles; its shape and unit stand in the docstring."""
