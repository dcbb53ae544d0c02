"""The optimiser comparison, learning over heads, validation studies, the blind proof, and the complete command line."""

import os

# Matrices here have seven rows, and OpenBLAS threads only wait for each other (L-BFGS-B becomes 40 times slower).
# OpenBLAS reads this variable once, when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
