"""Lines of instrument files, whatever their encoding: UTF-8, UTF-16 or Latin-1, plain or compressed by gzip."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from inkjet_env.recordings.recording import CampaignError

SNIFFED_BYTES = 1 << 16
"""Bytes at the start of a file from which its encoding and layout are recognised."""
_GZIP = b"\x1f\x8b"
_CONTROL_CODES = {code: "\ufffd" for code in (*range(32), *range(127, 160)) if chr(code) not in "\t\n\r"}
"""Characters that must not reach a terminal from the names in a header."""


@dataclass(frozen=True)
class TextFile:
    """A text file and how it is written.

    Attributes
    ----------
    path : Path
        The file.
    encoding : str
        Encoding of its text.
    start : tuple of str
        Its first lines, of which none is cut off.
    """

    path: Path
    encoding: str
    start: tuple[str, ...]

    @contextmanager
    def lines(self) -> Iterator[Iterator[str]]:
        r"""All lines, each with ``\n`` at its end however the file ends it.

        Raises
        ------
        CampaignError
            The file cannot be read to its end.
        """
        try:
            with _opened(self.path) as file, io.TextIOWrapper(file, self.encoding, errors="replace") as text:
                yield text
        except (OSError, EOFError, zlib.error) as error:
            raise cannot_be_read(self.path, error) from None


def open_text(path: Path) -> TextFile:
    """Recognise the encoding of a text file.

    Raises
    ------
    CampaignError
        The file cannot be read, or is binary.
    """
    try:
        with _opened(path) as file:
            start = file.read(SNIFFED_BYTES)
    except (OSError, EOFError, zlib.error) as error:
        raise cannot_be_read(path, error) from None
    encoding = _encoding(start)
    if encoding is None:
        raise CampaignError(f"{path}: is binary, not text. Export it as CSV, or take it out of the folder.")
    readable = start.decode(encoding, errors="replace").translate(_CONTROL_CODES)
    lines = io.StringIO(readable, newline=None).read().split("\n")
    return TextFile(path, encoding, tuple(lines[:-1] if len(start) == SNIFFED_BYTES or not lines[-1] else lines))


def cannot_be_read(path: Path, error: Exception) -> CampaignError:
    """The error for a file that cannot be opened or decompressed."""
    reason = getattr(error, "strerror", None) or "its compressed content is damaged"
    return CampaignError(f"{path}: cannot be read: {reason}. Check the file.")


def _opened(path: Path) -> BinaryIO:
    with open(path, "rb") as file:
        compressed = file.read(2) == _GZIP
    return gzip.open(path) if compressed else open(path, "rb")  # type: ignore[return-value]


def _encoding(start: bytes) -> str | None:
    """Encoding of a text that starts with these bytes; None if it is no text."""
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if b"\0" in start:  # ASCII in two bytes a character has a zero in every second one
        even, odd = start[::2].count(0), start[1::2].count(0)
        half = len(start) // 2
        if odd >= 0.9 * half and not even:
            return "utf-16-le"
        return "utf-16-be" if even >= 0.9 * half and not odd else None
    try:
        start.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(start) - 3:  # otherwise a character is cut off at the end of the block
            return "latin-1"
    return "utf-8-sig"
