"""Compilation of kernels, and compiled code on disk, which is discarded when its sources are newer.

The compiler chooses which products and sums to fuse. Its choice depends on the processor and on the functions that were
compiled before, so the last bits may differ between machines, or after the code was deleted.

Compiled code is kept beside the sources, in the user's cache folder if the sources cannot be written, or in the folder
that the environment variable ``NUMBA_CACHE_DIR`` names. Without any of them every process compiles anew.
"""

from __future__ import annotations

import io
import multiprocessing
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import event
from numba.core.caching import IndexDataCacheFile

INTERNAL = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a function that only other kernels call: without an entrance from Python it compiles faster."""


def discard_stale_code(file: str, folder: Path) -> None:
    """Delete the compiled code of a module if a source of the simulator, or one in the module's folder, is newer.

    numba notices a change in the file of a function, but not in the files of the functions that it calls.

    Parameters
    ----------
    file : str
        File of the module.
    folder : Path
        Folder of the module's compiled code.
    """
    module = Path(file)
    sources = [module, *module.parent.glob("*.py"), *Path(__file__).parent.glob("*.py")]
    newest = max(source.stat().st_mtime for source in sources)
    for index in folder.glob(f"{module.stem}.*.nbi"):
        # Another process was faster; or the folder is not writable, and then numba does not use it either.
        with suppress(FileNotFoundError, PermissionError):
            if index.stat().st_mtime < newest:
                index.unlink()


_discard_once = cache(discard_stale_code)


@cache
def _say_once(sentence: str) -> None:
    if multiprocessing.parent_process() is None:  # not from every worker
        print(sentence, file=sys.stderr, flush=True)


NOT_KEPT = (
    "Compiled code cannot be kept, because {why}, so every start takes seconds longer. Set NUMBA_CACHE_DIR to a folder "
    "that you can write."
)


class CheckedFiles(IndexDataCacheFile):
    """Files of compiled code, each with its digest: a damaged one is compiled again instead of being run.

    numba's own files end in an error, or in a crash of the process, if they are truncated or garbled.
    """

    def save(self, key: Any, data: Any) -> None:
        try:
            super().save(key, data)
        except OSError as error:
            _say_once(NOT_KEPT.format(why=f"{error.filename or self._index_path}: {error.strerror}"))

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            file.write(content.getvalue() + sha256(content.getvalue()).digest())  # pickle reads to its own end

    def _load_index(self) -> Any:
        return super()._load_index() if is_whole(Path(self._index_path)) else {}

    def _load_data(self, name: str) -> Any:
        if not is_whole(Path(self._data_path(name))):
            raise OSError(f"{name} is damaged")  # numba then compiles the function
        return super()._load_data(name)


def is_whole(file: Path) -> bool:
    """Whether a file ends with the SHA-256 of what is before."""
    try:
        content = file.read_bytes()
    except OSError:
        return False
    return sha256(content[:-32]).digest() == content[-32:]


class _Announcement(event.Listener):
    """Says on standard error that kernels are being compiled, when the first one really is."""

    def on_start(self, event: Any) -> None:
        if event.data["dispatcher"].py_func.__module__.startswith("inkjet_env."):
            _say_once("compiling the simulator once …")

    def on_end(self, event: Any) -> None:
        pass


event.register("numba:compile", _Announcement())


def kernel_jit(file: str, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator that compiles functions of the module ``file`` (its ``__file__``), releasing the interpreter's lock.

    If no folder for compiled code can be written, the functions are compiled anew by every process, and a sentence on
    standard error says so.
    """
    options = {"error_model": "numpy", "nogil": True, **options}

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            kernel = njit(cache=True, **options)(function)
        except RuntimeError as error:
            if "cannot cache function" not in str(error):
                raise
            _say_once(NOT_KEPT.format(why="no folder for it can be written"))
            return njit(**options)(function)
        files = kernel._cache._cache_file
        kernel._cache._cache_file = CheckedFiles(kernel.stats.cache_path, files._index_name[:-4], files._source_stamp)
        _discard_once(file, Path(kernel.stats.cache_path))
        return kernel

    return compiled
