"""One file of an instrument or a program as a table: text of any style, or arrays of NumPy, MATLAB, HDF5 or Parquet."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.extras import extra
from inkjet_env.recordings.header import Header
from inkjet_env.recordings.header_entries import HeaderError, stated_clock
from inkjet_env.recordings.recording import CampaignError
from inkjet_env.recordings.sampling import last_digit
from inkjet_env.recordings.sheet import Sheet, read_sheet
from inkjet_env.recordings.table import read_columns, row_of_sample
from inkjet_env.recordings.text_file import open_text
from inkjet_env.recordings.units import Unit, known_unit, unit_in_name, unit_like
from inkjet_env.typing import Real

TEXT_SUFFIXES = (".csv", ".txt", ".dat", ".asc", ".tsv", ".lvm", ".gz")
_UNIT_SUFFIX = re.compile(r"_([munk\u00b5]?s|[kMG]?Hz)$", re.IGNORECASE)
"""Unit of a single number, such as ``dt_us``."""
_UNIT_IN_TEXT = re.compile(r"[(\[\"' ]([mun\u00b5]s|[mu\u00b5k]V)[)\]\"' ,]")
"""A unit in a text, other than seconds and volts."""
_FACTORS = re.compile(
    r"scale|gain|factor|lsb|per_?(count|bit)|resolution|_to_(volt|v)|bits|range|\by_?(inc|mult)", re.IGNORECASE
)
"""Names of single numbers that turn counts into volts."""
ARRAY_SUFFIXES = (".npz", ".npy", ".mat", ".h5", ".hdf5", ".parquet")


class Table(ABC):
    """The columns of one file.

    Attributes
    ----------
    file : Path
        The file.
    columns : tuple of int
        Columns that hold samples, counted from 0.
    header : Header
        Names, units and clock.
    first_row : int
        Row of the first sample, counted from 1.
    notes : tuple of str
        What was passed over, in sentences.
    counting : tuple of int
        Columns that count by one.
    """

    file: Path
    columns: tuple[int, ...]
    header: Header
    first_row: int
    notes: tuple[str, ...]
    counting: tuple[int, ...]

    @abstractmethod
    def read(self, wanted: Sequence[int]) -> list[Real]:
        """Some columns as float64, each of shape (n,), read-only, all finite."""

    @abstractmethod
    def print_step(self, column: int) -> float:
        """One unit in the last printed digit of a column that was read, in its unit; 0 if it is not printed."""

    @abstractmethod
    def place(self, sample: int) -> str:
        """The place of a sample, counted from 0, for people: its row, if the file has rows."""


@dataclass
class TextTable(Table):
    """A text file."""

    sheet: Sheet

    def __post_init__(self) -> None:
        self.file, self.columns, self.header = self.sheet.layout.file.path, self.sheet.columns, self.sheet.header
        self.first_row, self.notes = self.sheet.layout.header_rows + 1, self.sheet.notes
        self.counting = self.sheet.counting
        self._ends: tuple[list[list[str]], ...] = ()  # not all that was read: recordings may be large

    def read(self, wanted: Sequence[int]) -> list[Real]:
        read = read_columns(self.sheet.layout, wanted)
        self._ends = (read.first, read.last)
        return read.values

    def print_step(self, column: int) -> float:
        decimal = self.sheet.layout.decimal
        return max(
            (
                last_digit([row[column].replace(decimal, ".") for row in rows if len(row) > column])
                for rows in self._ends
            ),
            default=0.0,
        )

    def place(self, sample: int) -> str:
        return f"row {row_of_sample(self.sheet.layout, sample)}"


@dataclass
class ArrayTable(Table):
    """Arrays by name, of one length, single numbers beside them, such as a sampling rate, and units by array."""

    file: Path
    arrays: Mapping[str, Real]
    numbers: Mapping[str, float]
    printed: Mapping[str, str]

    def __post_init__(self) -> None:
        self.columns, self.first_row, self.notes = tuple(range(len(self.arrays))), 1, ()
        self.counting = tuple(i for i, a in enumerate(self.arrays.values()) if a.size > 2 and (np.diff(a) == 1).all())
        known: dict[int, Unit] = {}
        unknown: dict[int, str] = {}
        for i, name in enumerate(self.arrays):
            text = self.printed.get(name, "")
            named = unit_in_name(name)
            unit = known_unit(text) or text or named
            if text and isinstance(named, Unit) and unit != named:
                raise CampaignError(f"{self.file}: {name[:40]} has another unit beside it, {text[:20]}. Correct one.")
            if isinstance(unit, Unit):
                known[i] = unit
            elif unit:
                unknown[i] = unit
        entries: dict[str, list[str]] = {}
        for name, number in self.numbers.items():
            key = _UNIT_SUFFIX.sub(r" (\1)", re.split(r"[./]", name)[-1]).lower()
            entries.setdefault(key, [""]).append(f"{number:.17g}")
        try:
            self.header = Header(tuple(self.arrays), known, unknown, stated_clock(entries), self.file.suffix[1:])
        except HeaderError as error:
            raise CampaignError(f"{self.file}: {error}") from None

    def read(self, wanted: Sequence[int]) -> list[Real]:
        names = list(self.arrays)
        for i in wanted:
            bad = ~np.isfinite(self.arrays[names[i]])
            if bad.any():
                raise CampaignError(
                    f"{self.file}, sample {int(np.argmax(bad)) + 1}: {names[i][:40]} must be finite. Trim the "
                    "recording or mark the gap."
                )
        return [self.arrays[names[i]] for i in wanted]

    def print_step(self, column: int) -> float:
        return 0.0

    def place(self, sample: int) -> str:
        return f"sample {sample + 1}"


def open_table(file: Path, settings: Path | None = None) -> Table:
    """The table in a file; a file beside it may hold its header.

    Raises
    ------
    CampaignError
        The file cannot be read, or holds no table of numbers.
    """
    suffix = file.suffix.lower()
    if suffix not in ARRAY_SUFFIXES:
        return TextTable(read_sheet(open_text(file), None if settings is None else open_text(settings)))
    units: Mapping[str, str] = {}
    reader = {".npz": _npz, ".npy": _npy, ".mat": _mat, ".h5": _hdf5, ".hdf5": _hdf5, ".parquet": _parquet}[suffix]
    try:
        found = reader(file)
        units = _parquet_units(file) if suffix == ".parquet" else {}
    except (CampaignError, ImportError):
        raise
    except Exception as error:  # whatever a damaged file makes a reader raise
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise CampaignError(f"{file}: cannot be read as {suffix}: {reason}. Export it again.") from None
    return _array_table(file, found, units)


def _array_table(file: Path, found: Mapping[str, Any], units: Mapping[str, str]) -> ArrayTable:
    """Vectors, columns of matrices, single numbers and units among some variables."""
    arrays: dict[str, Real] = {}
    numbers: dict[str, float] = {}
    whole, texts = True, dict(units)
    for given, value in found.items():
        name = "".join(letter if letter.isprintable() else "\ufffd" for letter in given)
        array = np.asarray(value)
        if array.dtype.kind in "USO":
            told = [str(text) for text in array.reshape(-1).tolist()]
            if array.size == 1:
                texts[name] = told[0]
            elif any(unit_like(text) or unit_in_name(text) for text in told):
                raise CampaignError(f"{file}: the units in {name[:40]} are not read. Put them behind names: drive_mV.")
        if array.dtype.kind not in "fiub":
            continue
        time = re.search(r"time|^t\b|^t_", name, re.IGNORECASE)
        if array.size > 1 and not time:
            whole &= array.dtype.kind != "f" or bool(np.allclose(array, np.round(array), rtol=1e-12, atol=1e-9))
        if array.size == 1:
            numbers[name] = float(array.reshape(-1)[0])
            continue
        array = np.squeeze(array)
        if array.ndim == 2:
            table = array if array.shape[0] >= array.shape[1] else array.T
            arrays |= {f"{name} {k + 1}": _column(table[:, k]) for k in range(table.shape[1])}
        elif array.ndim == 1:
            arrays[name] = _column(array)
    lengths = {array.size for array in arrays.values()}
    if len(lengths) > 1:
        sizes = ", ".join(f"{name} {array.size}" for name, array in arrays.items())[:120]
        raise CampaignError(f"{file}: its arrays must have one length; they have {sizes}. Save one recording a file.")
    if len(arrays) < 2 or max(lengths) < 2:
        raise CampaignError(f"{file}: holds no two arrays of at least two numbers. Save drive and sensor in it.")
    if whole and (factors := [name for name, number in numbers.items() if number != 1 and _FACTORS.search(name)]):
        raise CampaignError(f"{file}: holds whole numbers and {factors[0]!r}, a factor. Save volts.")
    printed = {}
    for key, text in texts.items():
        stem = re.sub(r"^units?[_.]|[_.]?units?([_.]?(name|label|symbol))?$", "", key, flags=re.IGNORECASE)
        mine = [name for name in arrays if stem and name.lower() == stem.lower()]
        unit = known_unit(text)
        if mine:
            printed[mine[0]] = text
        elif unit in (known_unit("s"), known_unit("V")):
            continue  # what is taken without it, too
        elif (stem != key and (unit or unit_like(text))) or _UNIT_IN_TEXT.search(text):
            raise CampaignError(
                f"{file}: the unit in {key[:40]} = {text[:30]!r} belongs to no array. Put units behind names: drive_mV."
            )
    return ArrayTable(file, arrays, numbers, printed)


def _column(values: Any) -> Real:
    column = np.array(values, dtype=np.float64)
    column.flags.writeable = False
    return column


def _npz(file: Path) -> Mapping[str, Any]:
    with np.load(file, allow_pickle=False) as saved:
        return {name: saved[name] for name in saved.files}


def _npy(file: Path) -> Mapping[str, Any]:
    array = np.load(file, allow_pickle=False)
    if array.dtype.names:
        return {name: array[name] for name in array.dtype.names}
    return {"column": array}


def _mat(file: Path) -> Mapping[str, Any]:
    from scipy.io import loadmat

    try:
        found = loadmat(file, squeeze_me=False, struct_as_record=True)
    except NotImplementedError:  # version 7.3 is HDF5
        return _hdf5(file)
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _hdf5(file: Path) -> Mapping[str, Any]:
    with extra(f"{file}: an HDF5 file"):
        import h5py
    found: dict[str, Any] = {}
    with h5py.File(file, "r") as opened:

        def keep(name: str, item: Any) -> None:
            if "#" in name:
                return
            if isinstance(item, h5py.Dataset) and (item.dtype.kind in "fiub" or item.size == 1):
                found[name] = _decoded(item[()])
            found.update({f"{name}.{key}": _decoded(value) for key, value in item.attrs.items() if key.isprintable()})

        keep("", opened)
        opened.visititems(keep)
    return found


def _decoded(value: Any) -> Any:
    """A value with texts as text: HDF5 holds bytes."""
    array = np.asarray(value)
    if array.dtype.kind not in "SO":
        return value
    return np.array(
        [v.decode(errors="replace") if isinstance(v, bytes) else str(v) for v in array.reshape(-1).tolist()]
    )


def _parquet(file: Path) -> Mapping[str, Any]:
    with extra(f"{file}: a Parquet file"):
        from pyarrow import parquet
    table = parquet.read_table(file)
    return {name: table[name].to_numpy() for name in table.column_names}


def _parquet_units(file: Path) -> Mapping[str, str]:
    """Units in the fields' own metadata, by column, and what the file's metadata says."""
    from pyarrow import parquet

    schema = parquet.read_schema(file)
    own = {key: text for key, text in (schema.metadata or {}).items() if key not in (b"pandas", b"ARROW:schema")}
    found = {key.decode(errors="replace"): text.decode(errors="replace") for key, text in own.items()}
    for field in schema:
        for key, text in (field.metadata or {}).items():
            if "unit" in key.decode(errors="replace").lower():
                found[field.name] = text.decode(errors="replace")
    return found
