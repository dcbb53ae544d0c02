"""Compiled code on disk, kept only while it is what the sources say.

Products and sums are fused as the compiler sees fit, which hangs on the processor and on which functions were compiled
before: between machines, or after the code was deleted, last bits may differ.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from numba import njit


def discard_stale_code(file: str) -> None:
    """Delete the compiled code of a module where a source of the simulator, or one beside it, is newer.

    numba sees when the file of a function changes, but not when one changes that the function calls.
    """
    module = Path(file)
    sources = [module, *module.parent.glob("*.py"), *Path(__file__).parent.glob("*.py")]
    newest = max(source.stat().st_mtime for source in sources)
    for index in (module.parent / "__pycache__").glob(f"{module.stem}.*.nbi"):
        # Another process was faster; or the folder is not ours to write, and then numba does not use it either.
        with suppress(FileNotFoundError, PermissionError):
            if index.stat().st_mtime < newest:
                index.unlink()


def kernel_jit(file: str, **options: Any) -> Any:
    """Decorator that compiles functions of the module ``file`` (its ``__file__``), releasing the interpreter's lock."""
    discard_stale_code(file)
    return njit(cache=True, error_model="numpy", nogil=True, **options)
