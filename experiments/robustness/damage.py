"""Damage to files: bytes, rows, cells and values of JSON replaced, moved, repeated or removed."""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

ODD_CELLS = (
    "", "nan", "inf", "-inf", "1e400", "1e-400", "--", "0x1F", "1,5", "1.5.2", "\u0661\u0662", "None", "=A1+1",
    "1e5000000000", '"', '"1', "\x00", "\x1b[31m", "12:34:56", "1_000", "9.9E+37", "TRUE", "9" * 400, " ", "\ufeff",
)  # fmt: skip
"""Cells that are put in place of others."""
ODD_VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1e300, -1e300, 1e-300, 10**400, -(10**400), 0.5, "", "x", "\x1b[2J", "a[/x]b", "\ud800",
    [], {}, [[]], [None], {"value": 1}, "nan", "1e400", list(range(50)), "../../etc/passwd", "/dev/zero", "r0", "free",
)  # fmt: skip
"""Values that are put in place of those in JSON."""
ODD_NAMES = ("con", ".hidden", "a b", "a[b]", "ü", "x" * 200, "-rf", "a\nb", "a;b", "CH1", "\udcff")
_NUMBER = re.compile(r"[-+]?\d+([.,]\d+)?([eE][-+]?\d+)?")


def mutated_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Content with a span of bytes replaced, removed, repeated or inserted, or cut off."""
    if not content:
        return bytes(rng.integers(0, 256, 10, dtype=np.uint8))
    start = int(rng.integers(len(content)))
    end = min(len(content), start + int(rng.choice([1, 1, 4, 60, 4000])))
    kind = rng.integers(6)
    if kind == 0:
        return content[:start]
    if kind == 1:
        return content[:start] + content[end:]
    if kind == 2:
        return content[:end] + content[start:end] * int(rng.integers(1, 4)) + content[end:]
    if kind == 3:
        return content[:start] + bytes(rng.integers(0, 256, end - start, dtype=np.uint8)) + content[end:]
    if kind == 4:
        return content[:start] + bytes([content[start] ^ (1 << int(rng.integers(8)))]) + content[start + 1 :]
    return content[:start] + b"\0" * (end - start) + content[end:]


def mutated_rows(content: bytes, rng: np.random.Generator) -> bytes:
    """Text with a cell, a row or a column changed, doubled, moved or removed, or written in another way."""
    encoding, delimiter, rows = _table(content)
    if len(rows) < 2:
        return content
    i, j = (int(k) for k in rng.integers(len(rows), size=2))
    column = int(rng.integers(len(rows[i])))
    kind = rng.integers(9)
    if kind == 0:
        rows[i][column] = str(rng.choice(ODD_CELLS))
    elif kind == 1:
        rows[i], rows[j] = rows[j], rows[i]
    elif kind == 2:
        rows.insert(i, list(rows[j]))
    elif kind == 3:
        del rows[min(i, j) : max(i, j)]
    elif kind == 4:
        rows = [row[:column] + row[column + 1 :] for row in rows]
    elif kind == 5:
        rows = [[*row, str(rng.choice(ODD_CELLS))] for row in rows]
    elif kind == 6:
        rows[i] = rows[i][: max(column, 1)]
    elif kind == 7:
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    else:
        factor = float(rng.choice([0.0, -1.0, 1e-9, 1e9, 1e300]))
        for row in rows:
            if len(row) > column:
                with contextlib.suppress(ValueError):
                    row[column] = repr(float(row[column]) * factor)
    ending = str(rng.choice(["\n", "\r\n", "\r"]))
    return ending.join(delimiter.join(row) for row in rows).encode(encoding, errors="replace")


def mutated_numbers(content: bytes, rng: np.random.Generator) -> bytes:
    """Text in whose samples one column is wrong but still numbers: a sensor that sticks, clips, jumps or drifts."""
    encoding, delimiter, rows = _table(content)
    decimal = "," if delimiter == ";" else "."
    places = [k for k, row in enumerate(rows) if len(row) > 2 and all(_NUMBER.fullmatch(cell) for cell in row)]
    if len(places) < 2:
        return content
    column = int(rng.integers(1, min(len(rows[k]) for k in places)))
    values = np.array([float(rows[k][column].replace(decimal, ".")) for k in places])
    i, j = sorted(int(k) for k in rng.integers(len(values), size=2))
    scale = float(np.ptp(values)) or 1.0
    kind = rng.integers(8)
    if kind == 0:
        values[i:j] = values[i]
    elif kind == 1:
        values = np.clip(values, *np.sort(rng.choice(values, 2)))
    elif kind == 2:
        values[i:] += scale * float(rng.choice([-3.0, 0.03, 0.3]))
    elif kind == 3:
        values[i] += scale * float(rng.choice([-100.0, 1.0, 10.0]))
    elif kind == 4:
        values = -values
    elif kind == 5:
        step = scale * float(rng.choice([0.003, 0.1]))
        values = step * np.round(values / step)
    elif kind == 6:
        values = np.roll(values, i)
    else:
        values += scale * float(rng.choice([0.01, 0.1, 1.0])) * rng.normal(size=values.size)
    for k, value in zip(places, values, strict=True):
        rows[k][column] = f"{value:.9g}".replace(".", decimal)
    return "\r\n".join(delimiter.join(row) for row in rows).encode(encoding, errors="replace")


def _table(content: bytes) -> tuple[str, str, list[list[str]]]:
    """Encoding, delimiter and cells of a text."""
    encoding = "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8"
    text = content.decode(encoding, errors="surrogateescape" if encoding == "utf-8" else "replace")
    delimiter = next((mark for mark in ";\t" if mark in text), ",")
    return encoding, delimiter, [line.split(delimiter) for line in text.splitlines()]


def mutated_json(content: bytes, rng: np.random.Generator) -> bytes:
    """JSON with a value replaced, or a key removed or renamed; unchanged if it is no JSON."""
    try:
        value = json.loads(content)
    except (ValueError, RecursionError):
        return content
    places = list(_places(value))
    if not places:
        return content
    holder, key = places[int(rng.integers(len(places)))]
    odd = ODD_VALUES[int(rng.integers(len(ODD_VALUES)))]
    kind = rng.integers(4)
    if kind == 0 and isinstance(holder, dict):
        del holder[key]
    elif kind == 1 and isinstance(holder, dict):
        holder[f"{key}x"] = holder.pop(key)
    elif kind == 2 and isinstance(holder[key], list):
        holder[key] = holder[key] * 3
    else:
        holder[key] = odd
    return json.dumps(value).encode()


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every place of a JSON value: its holder and its key."""
    for key in list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield value, key
        yield from _places(value[key])


def damage(folder: Path, rng: np.random.Generator) -> None:
    """Damage one file in a folder."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    if not files:
        return
    file = files[int(rng.integers(len(files)))]
    if rng.random() < 0.04:
        _replaced_file(file, rng)
        return
    content = file.read_bytes()
    if file.suffix == ".json" and rng.random() < 0.7:
        content = mutated_json(content, rng)
    elif file.suffix in (".csv", ".txt", ".ini") and rng.random() < 0.7:
        content = mutated_rows(content, rng)
    else:
        content = mutated_bytes(content, rng)
    file.write_bytes(content)


def damage_numbers(folder: Path, rng: np.random.Generator) -> None:
    """Damage the samples of one file in a folder so that it can still be read."""
    files = sorted(folder.glob("*.csv"))
    file = files[int(rng.integers(len(files)))]
    file.write_bytes(mutated_numbers(file.read_bytes(), rng))


def _replaced_file(file: Path, rng: np.random.Generator) -> None:
    """A file that is empty, gone, renamed, a folder, a pipe, a device or a link to itself."""
    kind = rng.integers(7)
    if kind == 0:
        file.write_bytes(b"")
        return
    if kind == 1:
        with contextlib.suppress(OSError):
            file.rename(file.with_name(f"{rng.choice(ODD_NAMES)}{file.suffix}"))
        return
    file.unlink()
    if kind == 3:
        file.mkdir()
    elif kind == 4:
        os.mkfifo(file)
    elif kind == 5:
        file.symlink_to(str(rng.choice(["/dev/zero", "/dev/null", "nowhere"])))
    elif kind == 6:
        file.symlink_to(file.name)
