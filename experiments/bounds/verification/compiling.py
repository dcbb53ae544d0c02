"""How functions that only compiled functions call are compiled: without what Python needs to call them.

Numba compiles a function once more for each constant that is handed to it. Where that would take long, the constant is
written as ``np.int64(0)`` or as a comparison.
"""

from __future__ import annotations

from typing import Any

from numba import njit

_options: dict[str, Any] = {"nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
inner: Any = njit(**_options)
