"""Files written atomically: a reader finds a whole file or none."""

from __future__ import annotations

import io
import json
import os
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNFINISHED = ".unfinished"
"""Ending of a file that is still being written; a killed process may leave one behind."""


def write_atomically(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Write a file so that a reader, even after a crash, finds either the old content or the new, never a mixture.

    Parameters
    ----------
    path : str or Path
        Destination. Its folder must exist. An existing file is replaced; a symbolic link is followed to its target.
    content : str or bytes
        New content of the file; text is written as UTF-8.

    Raises
    ------
    OSError
        The folder is missing or not writable; nothing is left behind.
    ValueError
        ``path`` exists and is not a regular file but a folder, a device or a pipe.
    """
    path = Path(os.path.realpath(path))
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is not a file, so it cannot be replaced by one. Give another name.")
    unfinished = path.with_name(f"{path.name}.{os.getpid()}{UNFINISHED}")
    try:
        with open(unfinished, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(unfinished, path)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from None
    except BaseException:  # Ctrl-C
        unfinished.unlink(missing_ok=True)
        raise


def remove_unfinished(folder: Path) -> None:
    """Delete the partly written files that a killed process left in ``folder``."""
    for leftover in folder.glob(f"*{UNFINISHED}"):
        leftover.unlink(missing_ok=True)


def json_text(value: Any) -> str:
    """JSON text of ``value`` with a final newline; ``ValueError`` on NaN or infinity, since JSON has neither."""
    return json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def write_json(destination: str | os.PathLike[str], value: Any) -> None:
    """Write ``value`` as JSON to a file, atomically; ``-`` means standard output."""
    if str(destination) == "-":
        sys.stdout.write(json_text(value))
    else:
        write_atomically(destination, json_text(value))


def stored_object(file: Path) -> dict[str, Any]:
    """The JSON object in a file of this program's own; ``ValueError`` says what it is instead, without its name."""
    if not file.is_file():
        raise ValueError("it is no file")  # opening a pipe would wait for ever
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise ValueError("it is not text in UTF-8") from None
    except (ValueError, RecursionError):
        raise ValueError("it is not JSON") from None
    if not isinstance(content, dict):
        raise ValueError("it is not a JSON object")
    return content


def archive_bytes(arrays: Mapping[str, NDArray]) -> bytes:
    """``.npz`` archive of named arrays: equal arrays give equal bytes (`numpy.savez` writes a time stamp)."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(array, order="C"), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), member.getvalue())
    return buffer.getvalue()
