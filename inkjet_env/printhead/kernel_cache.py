"""Compiled code on disk, discarded when its sources are newer.

The compiler chooses which products and sums to fuse. Its choice depends on the processor and on the functions that were
compiled before, so the last bits may differ between machines, or after the code was deleted.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from numba import njit


def discard_stale_code(file: str) -> None:
    """Delete the compiled code of a module if a source of the simulator, or one in the module's folder, is newer.

    numba notices a change in the file of a function, but not in the files of the functions that it calls.
    """
    module = Path(file)
    sources = [module, *module.parent.glob("*.py"), *Path(__file__).parent.glob("*.py")]
    newest = max(source.stat().st_mtime for source in sources)
    for index in (module.parent / "__pycache__").glob(f"{module.stem}.*.nbi"):
        # Another process was faster; or the folder is not writable, and then numba does not use it either.
        with suppress(FileNotFoundError, PermissionError):
            if index.stat().st_mtime < newest:
                index.unlink()


def kernel_jit(file: str, **options: Any) -> Any:
    """Decorator that compiles functions of the module ``file`` (its ``__file__``), releasing the interpreter's lock."""
    discard_stale_code(file)
    return njit(cache=True, error_model="numpy", nogil=True, **options)
