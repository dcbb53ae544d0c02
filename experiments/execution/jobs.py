"""What processes on this machine and workers of a cluster have in common."""

from __future__ import annotations

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""Environment of a worker: linear algebra uses one thread, since each core has a worker."""
TRIES = 5
"""Number of times that a job is started before it is taken to kill its workers."""


class ClusterError(ValueError):
    """The workers cannot do the work; finished jobs are kept."""


class WorkLostError(RuntimeError):
    """A process was killed from outside; its work must be repeated."""
