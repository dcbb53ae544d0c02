"""Problems, the optimiser comparison, its report, the figures, and the command line."""

import os

# Matrices here have seven rows: threads of OpenBLAS only wait for each other (L-BFGS-B becomes 40 times slower).
# It reads this once, when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
