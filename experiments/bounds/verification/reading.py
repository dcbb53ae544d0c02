"""The certificate's description, ``certificate.json``, and the bytes of its parts.

Nothing of a certificate is believed: whatever is not exactly as expected is refused with one sentence.
"""

from __future__ import annotations

import json
import lzma
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FORMAT = "lower-bound/1"
DESCRIPTION = "certificate.json"
DESCRIPTION_BYTES = 1 << 20
"""Longest description that is read."""
CHUNK = 1 << 16
"""Bytes of a part that are held at once."""
MEMORY_BYTES = 1 << 28
"""Most memory that unpacking a part may take."""
PARTS_MOST = 1000
US = 1e6
SIDES = 7


class CertificateError(ValueError):
    """A certificate is malformed, is of a problem that is not covered, or a claim of it could not be shown."""


@dataclass(frozen=True)
class Certificate:
    """What a certificate claims.

    Attributes
    ----------
    a0, a1, b1 : float
        Resonator in 1/s², 1/s and 1/s.
    coefficients : tuple of float
        Branch law of the hysteresis, highest power first; the last one is 0.
    full_scale_V : float
        Full scale of the branch law in V.
    A, B : float
        Weights of the largest extremum and of the one after it.
    lower, upper : tuple of 7 floats
        Box in V and µs, order ``U1, −U2, t1 … t5``.
    window_us : float
        End of the window in µs.
    bound_V : float
        Claimed lower bound of the cost in V.
    parts : tuple of pairs of float
        Ranges of the largest ``|extremum|`` in V.
    """

    a0: float
    a1: float
    b1: float
    coefficients: tuple[float, ...]
    full_scale_V: float
    A: float
    B: float
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    window_us: float
    bound_V: float
    parts: tuple[tuple[float, float], ...]


def part_file(number: int) -> str:
    """Name of the file of a part, counted from 0."""
    return f"part-{number:02}.xz"


def read_certificate(folder: Path) -> Certificate:
    """Read the description of a certificate.

    Raises
    ------
    CertificateError
        It is missing, malformed or of a problem that is not covered.
    """
    path = folder / DESCRIPTION
    try:
        with path.open("rb") as file:
            raw = file.read(DESCRIPTION_BYTES + 1)
    except OSError as error:
        raise CertificateError(f"{path}: cannot be read: {error.strerror}.") from None
    if len(raw) > DESCRIPTION_BYTES:
        raise CertificateError(f"{path}: is longer than {DESCRIPTION_BYTES} bytes.")
    try:
        found = json.loads(raw.decode(), object_pairs_hook=_once, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise CertificateError(f"{path}: is no JSON: {error}.") from None
    try:
        return _certificate(found)
    except CertificateError as error:
        raise CertificateError(f"{path}: {error}") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key occurs twice")
    return found


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no number")


def _entries(found: Any, name: str, keys: tuple[str, ...]) -> dict[str, Any]:
    """The entries of an object with exactly the keys that are covered."""
    if not isinstance(found, dict):
        raise CertificateError(f"{name} is no object.")
    missing = [key for key in keys if key not in found]
    if missing:
        raise CertificateError(f"{name} lacks {', '.join(missing)}.")
    others = [key for key in found if key not in keys]
    if others:
        raise CertificateError(f"{name} has {', '.join(map(repr, others))}, which this verification does not cover.")
    return found


def _number(found: Any, name: str) -> float:
    if isinstance(found, bool) or not isinstance(found, (int, float)):
        raise CertificateError(f"{name} is no number.")
    try:
        value = float(found)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise CertificateError(f"{name} is no finite number.")
    return value


def _numbers(found: Any, name: str) -> tuple[float, ...]:
    if not isinstance(found, list):
        raise CertificateError(f"{name} is no list.")
    return tuple(_number(value, f"{name}[{i}]") for i, value in enumerate(found))


def _require(holds: bool, sentence: str) -> None:
    if not holds:
        raise CertificateError(sentence)


def _certificate(found: Any) -> Certificate:
    whole = _entries(found, "the certificate", ("format", "problem", "bound_V", "parts"))
    _require(whole["format"] == FORMAT, f"its format is {whole['format']!r}, not {FORMAT!r}.")
    keys = ("name", "printhead", "cost", "bounds", "initial_state", "window_s")
    problem = _entries(whole["problem"], "the problem", keys)
    head = _entries(problem["printhead"], "the printhead", ("a0", "a1", "b1", "coefficients", "full_scale_V"))
    cost = _entries(problem["cost"], "the cost", ("A", "B", "effective"))
    box = _entries(problem["bounds"], "the bounds", ("lower", "upper"))
    _require(isinstance(problem["name"], str), "the problem's name is no text.")
    _require(problem["initial_state"] == "periodic", "the initial state is not 'periodic', which alone is covered.")
    _require(cost["effective"] == "largest", "the effective extremum is not the 'largest', which alone is covered.")
    a0, a1, b1 = (_number(head[key], key) for key in ("a0", "a1", "b1"))
    _require(a0 > 0 and a1 > 0 and a0 > a1 * a1 / 4, "the resonator is not underdamped with losses.")
    _require(b1 >= 0, "b1 is negative.")
    coefficients = _numbers(head["coefficients"], "coefficients")
    _require(2 <= len(coefficients) <= 10, "the branch law is not of degree 1 to 9.")
    _require(coefficients[-1] == 0, "the branch law's constant is not 0.")
    scale = _number(head["full_scale_V"], "full_scale_V")
    _require(scale > 0, "full_scale_V is not positive.")
    weight_a, weight_b = _number(cost["A"], "A"), _number(cost["B"], "B")
    _require(weight_a < 0, "A is not negative.")
    _require(weight_b >= 1, "B is below 1.")
    lower, upper = _numbers(box["lower"], "lower"), _numbers(box["upper"], "upper")
    _require(len(lower) == SIDES and len(upper) == SIDES, "the bounds are not of 7 parameters.")
    _require(all(low <= high for low, high in zip(lower, upper, strict=True)), "a lower end is above the upper one.")
    _require(lower[0] >= 0 and upper[1] <= 0, "U1 may be negative or U2 positive.")
    _require(all(low > 0 for low in lower[2:]), "a duration may be 0.")
    low = (lower[0], -upper[1], *(t * US for t in lower[2:]))
    high = (upper[0], -lower[1], *(t * US for t in upper[2:]))
    window = _number(problem["window_s"], "window_s") * US
    half_us = math.pi / math.sqrt(a0 - a1 * a1 / 4) * US
    room = "a waveform and four half periods after it may be longer than the window."
    _require(sum(high[2:]) + 4 * half_us <= window, room)
    bound = _number(whole["bound_V"], "bound_V")
    _require(bound <= 0, "bound_V is positive, but no drive costs 0 V.")
    _require(isinstance(whole["parts"], list) and 0 < len(whole["parts"]) <= PARTS_MOST, "the parts are no list.")
    parts = []
    for i, part in enumerate(whole["parts"]):
        ends = _numbers(part, f"parts[{i}]")
        _require(len(ends) == 2 and 0 <= ends[0] < ends[1], f"parts[{i}] is no pair of a least and a greater value.")
        parts.append((ends[0], ends[1]))
    return Certificate(
        a0, a1, b1, coefficients, scale, weight_a, weight_b, low, high, window, bound, tuple(parts)
    )  # fmt: skip


def chunks(path: Path) -> Iterator[bytes]:
    """The unpacked bytes of a part, `CHUNK` at a time.

    Raises
    ------
    CertificateError
        The file is missing, is no xz file, is cut off, or something follows its end.
    """
    try:
        with path.open("rb") as file:
            unpack = lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=MEMORY_BYTES)
            while not unpack.eof:
                raw = file.read(CHUNK) if unpack.needs_input else b""
                if unpack.needs_input and not raw:
                    raise CertificateError(f"{path}: is cut off.")
                found = unpack.decompress(raw, CHUNK)
                if found:
                    yield found
            if unpack.unused_data or file.read(1):
                raise CertificateError(f"{path}: something follows the end of the xz stream.")
    except OSError as error:
        raise CertificateError(f"{path}: cannot be read: {error.strerror}.") from None
    except lzma.LZMAError as error:
        raise CertificateError(f"{path}: is no sound xz file: {error}.") from None
