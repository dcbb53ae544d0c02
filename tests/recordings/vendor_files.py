"""Small recordings of a piezo drive and a sensor, written the way real instruments and programs export them.

Every function below writes one style of export and knows the right numbers: the arrays in a `VendorFile` are parsed
back from the digits that were printed, never the numbers before rounding. The content is made up (a trapezoidal drive
pulse and a sensor that rings or creeps after it); only the layout of the files is that of the instrument.

Conventions that hold for every style:

- Rows at the start of a record whose drive or sensor cell holds no number (empty, ∞, ----, NAN, 9.9E+37) are left out
  of the arrays, and `start_s` is the time of the first row that is kept. Where such marks stand in the middle of a
  record the style is to be refused.
- `drive_V` is in volts whatever unit is printed (a generator's 300 mV stay 0.3 V: no amplifier is guessed), `sensor`
  is in `sensor_unit`; metres, millimetres and picometres are turned into um or nm, millivolts and microvolts into V.
- `step_s` is the true sampling interval, even where the printed times are rounded.
- `columns` names a column by the text of its cell in the file, brackets included; columns without any name are named
  by their place, counted from "1"; where each channel has its own file the label of the channel is used ("C1").
- `remark` begins by saying how well the layout is known: `SEEN` (the layout of a real export, whole or as
  lines quoted from one), `TOLD` (from a public reader or writer of that format, or from its documentation) or `MEMORY`
  (from memory of a manual, unchecked). It also says which details of a seen layout are guesses.
- A style to be refused still carries the numbers that are printed; where they are no volts and no lengths `remark`
  says what they are, and where the channels have different lengths so have the arrays.
"""

from __future__ import annotations

import gzip
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

SEEN = "Seen: layout of a real export, or of lines quoted from one. "
TOLD = "Told: layout from a public reader, writer or documentation of the format. "
MEMORY = "Memory: layout from memory of a manual, not checked against a real file. "


@dataclass(frozen=True, eq=False)
class VendorFile:
    """One style of export: the bytes to write into a folder, and what a careful reader must find in them."""

    name: str
    vendor: str
    files: dict[str, bytes]
    step_s: float
    start_s: float
    drive_V: np.ndarray | None
    sensor: np.ndarray
    sensor_unit: str
    columns: dict[str, str] | None = None
    interval_s: float | None = None
    refused: str | None = None
    remark: str = ""


# ---------------------------------------------------------------------------------------------------------------------
# Signals
# ---------------------------------------------------------------------------------------------------------------------


def _pulse(count: int, volts: float) -> np.ndarray:
    """A trapezoidal pulse from 0 to `volts` and back, over `count` samples."""
    corners = np.array([0.20, 0.22, 0.30, 0.32]) * count
    return np.interp(np.arange(count), corners, [0.0, volts, volts, 0.0])


def _ringing(count: int, step: float, size: float) -> np.ndarray:
    """A damped sine that starts with the pulse: 40 kHz where that is neither too slow nor too fast for the record."""
    since = (np.arange(count) - 0.21 * count) * step
    frequency = min(max(40e3, 4.0 / (count * step)), 0.08 / step)
    wave = np.exp(-np.abs(since) * frequency / 4.0) * np.sin(2.0 * np.pi * frequency * since)
    return np.where(since > 0.0, size * wave, 0.0)


def _fast(count: int, step: float, volts: float, size: float, levels: tuple[float, float]) -> list[np.ndarray]:
    """Drive and sensor of a fast channel pair, both rounded to the levels of a converter."""
    drive, sensor = _pulse(count, volts), _ringing(count, step, size)
    return [np.round(values / level) * level + 0.0 for values, level in zip((drive, sensor), levels, strict=True)]


def _slow(count: int, volts: float, travel: float, noise: float) -> list[np.ndarray]:
    """Drive and displacement of a slow trapezoid with hysteresis (a plain play operator) and a little noise."""
    drive = np.interp(np.arange(count), np.array([0.1, 0.4, 0.5, 0.8]) * count, [0.0, volts, volts, 0.0])
    width, place, places = 0.06 * volts, 0.0, []
    for value in drive:
        place = min(max(place, value - width), value + width)
        places.append(place)
    sensor = travel * np.array(places) / volts
    return [drive, sensor + noise * np.random.default_rng(7).standard_normal(count)]


# ---------------------------------------------------------------------------------------------------------------------
# Printing and reading back
# ---------------------------------------------------------------------------------------------------------------------


def _cells(values: Iterable[float], form: str) -> list[str]:
    """Each value printed with an old-style format, without a minus sign before zero."""
    cells = [form % value for value in values]
    return [cell.replace("-", " " if " " in form else "", 1) if _is_minus_zero(cell) else cell for cell in cells]


def _is_minus_zero(cell: str) -> bool:
    """True if a printed number is a zero with a minus sign."""
    return cell.lstrip().startswith("-") and float(cell) == 0.0


def _comma(cells: Iterable[str]) -> list[str]:
    """The same cells with a decimal comma."""
    return [cell.replace(".", ",") for cell in cells]


def _long_exponents(cells: Iterable[str]) -> list[str]:
    """The same cells with exponents of three digits, as older Windows programs print them."""
    out = []
    for cell in cells:
        mantissa, mark, exponent = cell.replace("E", "e").partition("e")
        out.append(f"{mantissa}{mark}{exponent[0]}{exponent[1:].zfill(3)}" if mark else cell)
    return out


def _engineering(values: Iterable[float], finest: int) -> list[str]:
    """Numbers with exponents in steps of three and a fixed finest digit (10**finest), as Keysight scopes print them."""
    out = []
    for value in values:
        whole = round(value / 10.0**finest)
        if whole == 0:
            out.append("+0.0E+00")
            continue
        exponent = 3 * math.floor((len(str(abs(whole))) - 1 + finest) / 3)
        digits = max(exponent - finest, 0)
        out.append(f"{whole * 10.0 ** (finest - exponent):+.{digits}f}E{exponent:+03d}")
    return out


def _plain(values: Iterable[float], digits: int) -> list[str]:
    """Numbers as spreadsheets print them: as short as possible, exponents without zeros (1.2E-8)."""
    out = []
    for value in values:
        mantissa, mark, exponent = f"{value:.{digits}g}".partition("e")
        out.append(f"{mantissa}E{int(exponent)}" if mark else mantissa)
    return out


def _read(cells: Iterable[str], scale: float = 1.0) -> np.ndarray:
    """The numbers that printed cells say, decimal point or comma, times `scale`."""
    return np.array([float(cell.replace(",", ".")) for cell in cells]) * scale


def _rows(*columns: Sequence[str], sep: str = ",", head: str = "", tail: str = "") -> list[str]:
    """Rows of text out of columns of cells, with text before and behind each row."""
    return [head + sep.join(row) + tail for row in zip(*columns, strict=True)]


def _numbers(count: int, first: int = 0) -> list[str]:
    """Row numbers as cells."""
    return [str(first + row) for row in range(count)]


def _bytes(lines: Iterable[str], end: str = "\r\n", encoding: str = "ascii") -> bytes:
    """Lines of text as the bytes of a file; `end` closes each line, the last one too."""
    return "".join(line + end for line in lines).encode(encoding)


def _times(start: float, step: float, count: int) -> np.ndarray:
    """Times of samples."""
    return start + step * np.arange(count)


# ---------------------------------------------------------------------------------------------------------------------
# Rigol
# ---------------------------------------------------------------------------------------------------------------------


def _rigol_ds1000z_memory() -> VendorFile:
    """Rigol DS1000Z memory export; seen: DS1054Z and DS1074Z samples of the public repository RigolWFM."""
    count, start, step = 600, -2.4e-5, 2e-7
    drive, sensor = (_cells(v, "%.2e") for v in _fast(count, step, 40.0, 1.2, (0.4, 0.02)))
    lines = ["X,CH1,CH2,Start,Increment,", f"Sequence,Volt,Volt,{start:.6e},{step:.6e}"]
    lines += _rows(_numbers(count), drive, sensor, tail=",")
    return VendorFile(
        name="rigol_ds1000z_memory",
        vendor="Rigol",
        files={"NewFile1.csv": _bytes(lines)},
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN + "Row numbers instead of times; start and increment stand in the second header row, which alone "
        "has no comma at its end.",
    )


def _rigol_mso1000z_pods() -> VendorFile:
    """Rigol MSO1000Z with logic pods as hexadecimal bytes; told: comments in the Oszi Waveform Analyzer."""
    count, start, step = 500, -4e-7, 4e-9
    drive, sensor = (_cells(v, "%.2e") for v in _fast(count, step, 30.0, 0.8, (0.4, 0.008)))
    pods = [f"0x{(row // 40) % 2:02X}" for row in range(count)]
    lines = ["X,CH1,CH2,D7-D0,D15-D8,Start,Increment,", f"Sequence,Volt,Volt,,,{start:.6e},{step:.6e}"]
    lines += _rows(_numbers(count), drive, sensor, pods, ["0x00"] * count, tail=",")
    return VendorFile(
        name="rigol_mso1000z_pods",
        vendor="Rigol",
        files={"NewFile2.csv": _bytes(lines)},
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=TOLD + "Digital columns as 0x00 beside the channels; 4 ns per sample.",
    )


def _rigol_ds1102e_delayed() -> VendorFile:
    """Rigol DS1000E screen export with times of single precision; seen: DS1102E samples of RigolWFM."""
    count, start, step = 600, 8.97e-3, 5e-7
    times = _cells(np.float32(_times(start, step, count)).astype(float), "%.7e")
    drive, sensor = (_cells(v, "%.5e") for v in _fast(count, step, 48.0, 2.0, (0.8, 0.04)))
    lines = ["X,CH1,CH2,", "Second,Volt,Volt,", *_rows(times, drive, sensor, tail=",")]
    return VendorFile(
        name="rigol_ds1102e_delayed",
        vendor="Rigol",
        files={"NewFile3.csv": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN + "Trigger 9 ms before the record: the float32 times step unevenly by up to a thousandth of 1 us.",
    )


def _rigol_ds1204b() -> VendorFile:
    """Rigol DS1000B export with an unnamed time column; seen: DS1204B samples of RigolWFM."""
    count, start, step = 512, -1.024e-3, 4e-6
    times = _cells(_times(start, step, count), "%.5e")
    drive, sensor = (_cells(v, "%.2e") for v in _fast(count, step, 36.0, 4.0, (0.4, 0.08)))
    lines = [",CH2,CH4", "Second,Volt,Volt", *_rows(times, drive, sensor, tail=", ")]
    return VendorFile(
        name="rigol_ds1204b",
        vendor="Rigol",
        files={"DS1204B.csv": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH2", "sensor": "CH4"},
        remark=SEEN + "The time column has no name, only the unit Second; each row ends in comma and blank.",
    )


def _rigol_ds4000_late_index() -> VendorFile:
    """Rigol DS4000 screen export whose row numbers begin at 22; seen: DS4024 samples of RigolWFM."""
    count, start, step, first = 550, -1.4e-3, 2e-6, 22
    drive, sensor = (_cells(v, "%.6e") for v in _fast(count, step, 60.0, 3.0, (1.25, 0.03125)))
    lines = ["X,CH1,CH2,Start,Increment,", f"Sequence,Volt,Volt,{start:.6e},{step:.6e},"]
    lines += _rows(_numbers(count, first), drive, sensor, tail=",")
    return VendorFile(
        name="rigol_ds4000_late_index",
        vendor="Rigol",
        files={"DS4024.csv": _bytes(lines)},
        step_s=step,
        start_s=start + first * step,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN + "Start is the time of row 0, but the first row printed is 22: the record starts 44 us later. "
        "(In the real file 1400 rows from Start would end where the screen ends, so this reading fits.)",
    )


def _rigol_ds1052e_quoted() -> VendorFile:
    """Rigol DS1000E record as converted by a PC program; seen: DS1052E sample of RigolWFM."""
    count, step = 500, 2e-7
    times = _plain(_times(0.0, step, count), 7)
    drive, sensor = (_plain(v, 5) for v in _fast(count, step, 42.0, 0.9, (0.4, 0.02)))
    lines = [
        f'"Number of Data points =",{count},',
        '"Time Scale (s/DIV) =",1E-5,',
        '"Time Delay (s) =",0,',
        '"Sampling Frequency (Hz)=",5000000,',
        '"Trigger Mode = ",0,',
        '"Trigger Source = ",1,',
        '"Channel Data","CH 1","CH 2"',
        '"Attenuation = ",100,1',
        '"Pos (V) = ",0.2,-6',
        '"PosOrig (V) = ",0.2,-6',
        '"Scale (V/DIV) = ",10,0.5',
        '"ScaleOrig (V) = ",10,0.5',
        '"Minimum (V) = ",0,-0.7',
        '"Maximum (V) = ",42,0.76',
        '"Inverted = ","NO","NO"',
        '"Time (s)","Voltage (V)","Voltage (V)"',
        *_rows(times, drive, sensor),
        ",,",
    ]
    return VendorFile(
        name="rigol_ds1052e_quoted",
        vendor="Rigol",
        files={"DS1052E.csv": _bytes(lines, end="\n")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH 1", "sensor": "CH 2"},
        remark=SEEN + "Quoted keys whose rows hold two numbers, both channels named Voltage (V), the names CH 1 and "
        "CH 2 nine rows higher, times 2E-7, a last row of commas.",
    )


def _rigol_ds1102d_rounded_times() -> VendorFile:
    """Rigol DS1000D record with times rounded to 10 ns; seen: DS1102D sample of RigolWFM."""
    count, start, step = 500, -4.688e-3, 1.001e-5
    times = _cells(_times(start, step, count), "%.8f")
    drive, sensor = (_cells(v, "%.2f") for v in _fast(count, step, 44.0, 3.0, (0.08, 0.08)))
    return VendorFile(
        name="rigol_ds1102d_rounded_times",
        vendor="Rigol",
        files={"DS1102D.csv": _bytes(["X,CH 1 (V),CH 2 (V)", *_rows(times, drive, sensor)], end="\n")},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH 1 (V)", "sensor": "CH 2 (V)"},
        remark=SEEN + "The time column is named X without a unit (seconds); step 10.01 us.",
    )


def _rigol_mso5000_memory() -> VendorFile:
    """Rigol MSO5000 memory export with the time base in the header row; told: a public MSO5074 analysis script."""
    count, start, step = 500, -2e-5, 2e-7
    drive, sensor = (_cells(v, "%.6f") for v in _fast(count, step, 50.0, 1.5, (0.4, 0.0125)))
    lines = [f"CH1(V),CH2(V),t0 = {start:g}s, tInc = {step:g}s,", *_rows(drive, sensor, tail=",,,")]
    return VendorFile(
        name="rigol_mso5000_memory",
        vendor="Rigol",
        files={"RigolDS0.csv": _bytes(lines, end="\n")},
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1(V)", "sensor": "CH2(V)"},
        remark=TOLD + "No time column; start and increment are header cells such as 't0 = -2e-05s'. How the data rows "
        "end with two channels is a guess.",
    )


def _rigol_mso5000_repeating_times() -> VendorFile:
    """Rigol MSO5000 screen export whose times have too few digits; told: notes on such a file in a repository."""
    count, start, step = 600, -1.5e-4, 1.5e-6
    times = _cells(_times(start, step, count), "%.5f")
    drive, sensor = (_cells(v, "%.6f") for v in _fast(count, step, 50.0, 1.5, (0.4, 0.0125)))
    return VendorFile(
        name="rigol_mso5000_repeating_times",
        vendor="Rigol",
        files={"RigolDS1.csv": _bytes(["Time(s),CH1(V),CH2(V)", *_rows(times, drive, sensor)], end="\n")},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1(V)", "sensor": "CH2(V)"},
        refused="times repeat: printed with too few digits to tell the interval",
        remark=TOLD
        + "Six or seven rows share each printed time. Reading it with a stated interval would be right too.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Siglent and relatives
# ---------------------------------------------------------------------------------------------------------------------


def _siglent_sds1104x_u() -> VendorFile:
    """Siglent SDS1000X-U export of two channels; told: a public writer of such files and an example in a viewer's
    readme."""
    count, start, step = 600, -1e-4, 5e-7
    times = _cells(_times(start, step, count), "%+.6E")
    drive, sensor = (_cells(v, "%+.6E") for v in _fast(count, step, 45.0, 1.0, (0.8, 0.02)))
    lines = [
        f"Record Length,Analog:{count},",
        f"Sample Interval,Analog:{step:.6E},",
        "Vertical Units,CH1:V, CH2:V,,",
        "Vertical Scale,CH1:1.000000E+01, CH2:5.000000E-01,,",
        "Vertical Offset,CH1:-2.000000E+01, CH2:0.000000E+00,,",
        "Horizontal Units,us,",
        "Horizontal Scale,2.000000E+01,",
        "Model Number,SDS1104X-U,",
        "Serial Number,SDSAHBAX500000,",
        "Software Version,2.1.1.1.5R5,",
        "Source,CH1,CH2",
        "Second,Value,Value",
        *_rows(times, drive, sensor),
    ]
    return VendorFile(
        name="siglent_sds1104x_u",
        vendor="Siglent",
        files={"SDS00001.csv": _bytes(lines, end="\n")},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=TOLD + "Header keys with 'CH1:V, CH2:V'; the names CH1, CH2 stand one row above Second,Value,Value. The "
        "header says horizontal units us, the time column is in seconds.",
    )


def _siglent_bin2csv() -> VendorFile:
    """Siglent's converter from .bin to .csv, one channel per file; seen: example in the readme of SigFyCSV
    (SDS1104X-E)."""
    count, start, step = 500, -2e-5, 1e-7
    times = _cells(_times(start, step, count), "%.11f")
    drive, sensor = (_cells(v, "%.5f") for v in _fast(count, step, 40.0, 0.6, (0.4, 0.004)))

    def channel(number: int, scale: str, cells: list[str]) -> bytes:
        head = [
            f"Record Length,Analog:{count}",
            "Sample Rate,10000000.0",
            f"Vertical Scale,CH{number}: {scale}",
            f"Vertical Offset,CH{number}:0.00000",
            "Horizontal Scale, 0.000005000",
            "Second,Volt",
        ]
        return _bytes([*head, *_rows(times, cells)], end="\n")

    return VendorFile(
        name="siglent_bin2csv",
        vendor="Siglent",
        files={"usr_wf_data_CH1.csv": channel(1, "10.00", drive), "usr_wf_data_CH2.csv": channel(2, "0.20", sensor)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN + "One file per channel (the names of the files are made up), sample rate in the header without a "
        "unit, times with eleven decimals.",
    )


def _siglent_menu_save() -> VendorFile:
    """Siglent's save menu, two header rows only; told: comments of SigFyCSV and a script reading SDS00006.CSV."""
    count, start, step = 400, -5e-4, 2.5e-6
    times = _cells(_times(start, step, count), "%.11f")
    drive, sensor = (_cells(v, "%.5f") for v in _fast(count, step, 40.0, 2.4, (0.4, 0.04)))
    return VendorFile(
        name="siglent_menu_save",
        vendor="Siglent",
        files={"SDS00006.CSV": _bytes(["Source,CH1,CH2", "Second,Volt,Volt", *_rows(times, drive, sensor)])},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=TOLD + "The names stand in a row that begins with Source, the units in the next one.",
    )


def _atten_ads1202cl() -> VendorFile:
    """Atten ADS1202CL+ (a Siglent design); seen: data lines quoted in a public Perl script about these files."""
    count, start, step = 420, -1.68e-6, 8e-9
    times = _cells(_times(start, step, count), "% .11f")
    drive, sensor = (_cells(v, "%.5f") for v in _fast(count, step, 32.0, 0.9, (0.4, 0.012)))
    lines = [
        f"Record Length,{count}",
        "Sample Interval,CH1:0.0000000000013 CH2:0.0000000000013",
        "Vertical Units,CH1:V CH2:V,,",
        "Vertical Scale,CH1:10.00 CH2:0.50,,",
        "Vertical Offset,CH1:-15.00000 CH2:0.20000,,",
        "Horizontal Units,s,,",
        "Horizontal Scale,0.0000002500,,",
        "Model Number,ADS1202CL+,,",
        "Serial Number,ADS00001100000,,",
        "Software Version,3.01.01.31R16,,",
        "",
        "Source,CH1,CH2",
        "Second,Volt,Volt",
        *_rows(times, drive, sensor),
    ]
    return VendorFile(
        name="atten_ads1202cl",
        vendor="Atten",
        files={"ADS00001.CSV": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN + "The header's Sample Interval (1.3 ps) is wrong by a factor of 6000, as in the real files: the "
        "time column (8 ns) is right. Positive times begin with a blank.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Tektronix
# ---------------------------------------------------------------------------------------------------------------------


def _tektronix_tds2000() -> VendorFile:
    """Tektronix TDS2000/TBS1000 folder ALL0000, one file per channel; told: a public writer of this layout (TDS2012C)
    and memory."""
    count, start, step = 500, -5e-5, 5e-7
    times = [f"{t: 016.12f}" for t in _times(start, step, count)]
    drive, sensor = (_cells(v, "%10.5f") for v in _fast(count, step, 40.0, 0.8, (1.6, 0.04)))

    def channel(label: str, scale: float, probe: float, cells: list[str]) -> bytes:
        head = [
            f"Record Length,{count:.6e},",
            f"Sample Interval,{step:.6e},",
            f"Trigger Point,{round(-start / step):.12e},",
            ",,",
            ",,",
            ",,",
            f"Source,{label},",
            "Vertical Units,V,",
            f"Vertical Scale,{scale:.6e},",
            "Vertical Offset,0.000000e+00,",
            "Horizontal Units,s,",
            "Horizontal Scale,2.500000e-05,",
            "Pt Fmt,Y,",
            "Yzero,0.000000e+00,",
            f"Probe Atten,{probe:.6e},",
            "Model Number,TDS2014B,",
            "Serial Number,C000000,",
            "Firmware Version,FV:v22.01,",
        ]
        left = head + [",,"] * (count - len(head))
        return _bytes(_rows(left, times, cells, tail=","))

    return VendorFile(
        name="tektronix_tds2000",
        vendor="Tektronix",
        files={
            "F0000CH1.CSV": channel("CH1", 10.0, 100.0, drive),
            "F0000CH2.CSV": channel("CH2", 0.5, 1.0, sensor),
            "F0000TEK.SET": b":HEADER 1;:VERBOSE 1;:CH1:PROBE 1.0E2;SCALE 1.0E1;POSITION -2.0E0;:HORIZONTAL:MAIN:SCALE "
            b"2.5E-5;POSITION 0.0E0\n",
        },
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=TOLD + "The header stands to the left of the first 18 samples, data in columns 4 and 5, a comma at the "
        "end. The drive went through a 100:1 probe and is printed in volts at its tip: nothing to multiply.",
    )


def _tektronix_mso2000_peak_detect() -> VendorFile:
    """Tektronix MSO/DPO2000 file T0000ALL.CSV; seen: header of an MSO2014 quoted in a public script, and the column
    names of another repository's file."""
    count, start, step = 500, -1e-4, 1e-6
    times = _cells(_times(start, step, count), "%.6e")
    drive, sensor = (_cells(v, "%.6g") for v in _fast(count, step, 40.0, 0.8, (0.8, 0.04)))
    drive_peak, sensor_peak = _cells(_read(drive) + 0.8, "%.6g"), _cells(_read(sensor) + 0.04, "%.6g")
    lines = [
        "Model,MSO2014",
        "Firmware Version,1.35",
        "Point Format,Y,,Y,",
        "Horizontal Units,S,,S,",
        "Horizontal Scale,4e-05,,4e-05,",
        f"Sample Interval,{step:g},,{step:g},",
        "Filter Frequency,4.2e+07,,4.2e+07,",
        f"Record Length,{count},,{count},",
        "Gating,0.0% to 100.0%,,0.0% to 100.0%,",
        "Probe Attenuation,100,,1,",
        "Vertical Units,V,,V,",
        "Vertical Offset,0,,0,",
        "Vertical Scale,10,,0.5,",
        "Label,,,,",
        "TIME,CH1,CH1 Peak Detect,CH2,CH2 Peak Detect",
        *_rows(times, drive, drive_peak, sensor, sensor_peak),
    ]
    return VendorFile(
        name="tektronix_mso2000_peak_detect",
        vendor="Tektronix",
        files={"T0000ALL.CSV": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN + "Peak-detect columns between the channels; header rows hold two numbers; 'S' for seconds.",
    )


def _tektronix_mdo3000_digital() -> VendorFile:
    """Tektronix MDO3000 with digital channels behind a second time column; seen: first and last lines of an MDO3014
    file in a public write-up of a contest."""
    count, start, step = 520, -4.72e-4, 2e-7
    times = _cells(_times(start, step, count), "%.6e")
    drive, sensor = (_cells(v, "%.5g") for v in _fast(count, step, 36.0, 0.4, (0.4, 0.004)))
    bits = [str((row // 60) % 2) for row in range(count)]
    lines = [
        "Model,MDO3014",
        "Firmware Version,1.20",
        "",
        "Waveform Type,ANALOG,,,Waveform Type,DIGITAL,",
        "Point Format,Y,,,Point Format,Y,",
        "Horizontal Units,s,,,Horizontal Units,s,",
        "Horizontal Scale,1e-05,,,Horizontal Scale,1e-05,",
        "Horizontal Delay,0.00042,,,,,",
        f"Sample Interval,{step:.0e},,,Sample Interval,{step:.0e},",
        f"Record Length,{count},,,Record Length,{count},",
        "Gating,0.0% to 100.0%,,,Gating,0.0% to 100.0%,",
        "Probe Attenuation,100,1,,,,",
        "Vertical Units,V,V,,Vertical Units,V,V",
        "Vertical Offset,0,0,,Threshold Used,1.65,1.65",
        "Vertical Scale,10,0.1,,,,",
        "Vertical Position,-1.98,0.02,,,,",
        ",,,,,,",
        ",,,,,,",
        ",,,,,,",
        "Label,HEAD07,PICKUP,,Label,TRIG,FIRE",
        "TIME,CH1,CH2,,TIME,D1,D0",
        *_rows(times, drive, sensor, [""] * count, times, bits, ["0"] * count),
    ]
    return VendorFile(
        name="tektronix_mdo3000_digital",
        vendor="Tektronix",
        files={"tek0000ALL.csv": _bytes(lines, end="\n")},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN
        + "The real file had one analog channel; with two the places are likely but not seen. Labels in the "
        "row above the names; rows of commas in the header; an empty column; two equal time columns; bits.",
    )


def _tektronix_mso4_math() -> VendorFile:
    """Tektronix 4/5/6 Series with a math channel; told: a public stand-in for such files, readers of 'Model,MSO46'."""
    count, start, step = 500, -2e-5, 3.2e-7
    times = _cells(_times(start, step, count), "%.9e")
    drive, sensor = (_cells(v, "%.6g") for v in _fast(count, step, 40.0, 0.5, (0.0625, 0.0009765625)))
    product = _cells(_read(drive) * _read(sensor), "%.6g")
    lines = [
        "Model,MSO46",
        "Firmware Version,1.28.4",
        "",
        "Waveform Type,ANALOG,ANALOG,MATH",
        "Point Format,Y,Y,Y",
        "Horizontal Units,s,s,s",
        "Horizontal Scale,2e-05,2e-05,2e-05",
        "Horizontal Delay,0,0,0",
        "Sample Interval,3.2e-07,3.2e-07,3.2e-07",
        f"Record Length,{count},{count},{count}",
        "Gating,0.0% to 100.0%,0.0% to 100.0%,0.0% to 100.0%",
        "Probe Attenuation,100,1,1",
        "Vertical Units,V,V,VV",
        "Vertical Offset,0,0,0",
        "Vertical Scale,10,0.2,5",
        "Label,,,",
        ",,,",
        "TIME,CH1,CH2,MATH1",
        *_rows(times, drive, sensor, product),
    ]
    return VendorFile(
        name="tektronix_mso4_math",
        vendor="Tektronix",
        files={"Tek000_ALL.csv": _bytes(lines, end="\n")},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=TOLD + "MATH1 (unit VV) beside the channels.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Keysight
# ---------------------------------------------------------------------------------------------------------------------


def _keysight_infiniivision_blank_start() -> VendorFile:
    """Keysight InfiniiVision, first cells empty, with its settings file; seen: data lines in public readmes, and a
    German reader that notes the empty cells."""
    count, start, step, empty = 500, -1e-3, 5e-6, 3
    times = _engineering(_times(start, step, count), -9)
    drive, sensor = (_engineering(v, -9) for v in _fast(count, step, 38.0, 1.6, (0.402010051, 0.0402010051)))
    lines = ["x-axis,1,2", "second,Volt,Volt"]
    lines += _rows(times[:empty], [""] * empty, [""] * empty)
    lines += _rows(times[empty:], drive[empty:], sensor[empty:])
    settings = [
        "ANALOG",
        "Ch 1 Scale 10.0V/, Pos 15.0000V, Coup DC, BW Limit Off, Inv Off, Imp 1M Ohm",
        "     Probe 100.0000000 : 1, Skew 0.0s",
        "Ch 2 Scale 500mV/, Pos 0.0V, Coup DC, BW Limit Off, Inv Off, Imp 1M Ohm",
        "     Probe 1.0000000 : 1, Skew 0.0s",
        "",
        "TRIGGER",
        "Sweep Mode Normal, Coup DC, Noise Rej Off, HF Rej Off, Holdoff 60.0ns",
        "",
        "HORIZONTAL",
        "Mode Normal, Ref Center, Main Scale 200.0us/, Main Delay 0.0s",
    ]
    return VendorFile(
        name="keysight_infiniivision_blank_start",
        vendor="Keysight",
        files={"scope_1.csv": _bytes(lines), "scope_1.txt": _bytes(settings)},
        step_s=step,
        start_s=float(times[empty]),
        drive_V=_read(drive[empty:]),
        sensor=_read(sensor[empty:]),
        sensor_unit="V",
        columns={"drive": "1", "sensor": "2"},
        remark=SEEN + "Channels are named 1 and 2, exponents go in threes (-402.010E-06), zero is +0.0E+00. The first "
        "three rows hold a time but no voltages. The settings file beside it is from memory.",
    )


def _keysight_infiniium_header() -> VendorFile:
    """Keysight Infiniium, header of keys and one file per channel; from memory of the Infiniium manual."""
    count, start, step = 512, -1.28e-5, 5e-8
    times = _cells(_times(start, step, count), "%.11E")
    drive, sensor = (_cells(v, "%.5E") for v in _fast(count, step, 30.0, 0.5, (0.25, 0.005)))

    def channel(number: int, cells: list[str]) -> bytes:
        head = [
            "Revision:,0",
            "Type:,raw",
            "Start:,0",
            f"Points:,{count}",
            "Count:,1",
            "XDispRange:,2.56000000000E-05",
            f"XDispOrg:,{start:.11E}",
            f"XInc:,{step:.11E}",
            f"XOrg:,{start:.11E}",
            "YDispRange:,4.00000E+01",
            "YDispOrg:,0.00000E+00",
            "Coupling:,DC 50 Ohms",
            "XUnits:,second",
            "YUnits:,Volt",
            "Frame:,DSO9404A:MY50000000",
            "Date:,11 JUN 2024",
            "Time:,12:34:56:78",
            f"Source:,Channel {number}",
            "Max bandwidth:,4.00000E+09",
            "Min bandwidth:,0.00000E+00",
            "Data:,",
        ]
        return _bytes([*head, *_rows(times, cells)])

    return VendorFile(
        name="keysight_infiniium_header",
        vendor="Keysight",
        files={"drop_Channel1.csv": channel(1, drive), "drop_Channel2.csv": channel(2, sensor)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "Channel 1", "sensor": "Channel 2"},
        remark=MEMORY
        + "21 rows 'Key:,value', no row of column names at all; units, increment and origin in the header.",
    )


def _keysight_overrange_start() -> VendorFile:
    """Keysight InfiniiVision with 9.9E+37 where the first samples are not valid; the mark is from the SCPI standard."""
    count, start, step, invalid = 400, -2e-4, 1e-6, 4
    times = _engineering(_times(start, step, count), -9)
    drive, sensor = (_engineering(v, -6) for v in _fast(count, step, 42.0, 0.9, (0.35, 0.012)))
    sensor[:invalid] = ["+9.9E+37"] * invalid
    lines = ["x-axis,1,2", "second,Volt,Volt", *_rows(times, drive, sensor)]
    return VendorFile(
        name="keysight_overrange_start",
        vendor="Keysight",
        files={"scope_2.csv": _bytes(lines)},
        step_s=step,
        start_s=float(times[invalid]),
        drive_V=_read(drive[invalid:]),
        sensor=_read(sensor[invalid:]),
        sensor_unit="V",
        columns={"drive": "1", "sensor": "2"},
        remark=TOLD
        + "9.9E+37 means 'not a number' to SCPI instruments; here the first four samples of channel 2. Such "
        "a mark in this file is from memory.",
    )


def _keysight_current() -> VendorFile:
    """Keysight InfiniiVision with a current probe; seen: the units 'second,Ampere,Volt' quoted in a public reader."""
    count, start, step = 400, -2e-4, 1e-6
    times = _engineering(_times(start, step, count), -9)
    drive, current = (_engineering(v, -6) for v in _fast(count, step, 42.0, 0.09, (0.35, 0.0012)))
    return VendorFile(
        name="keysight_current",
        vendor="Keysight",
        files={"scope_3.csv": _bytes(["x-axis,1,2", "second,Ampere,Volt", *_rows(times, current, drive)])},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(current),
        sensor_unit="V",
        columns={"drive": "2", "sensor": "1"},
        refused="current in A: no unit of a drive or sensor",
        remark=SEEN + "The second signal is the current through the piezo, not a sensor; `sensor` here is in ampere.",
    )


def _keysight_segments() -> VendorFile:
    """Keysight segmented memory; seen: 'points/segment = N' above the usual header, described in a public reader."""
    count, step = 200, 1e-6
    times = _engineering(_times(-4e-5, step, count), -9)
    drive, sensor = (_engineering(v, -6) for v in _fast(count, step, 42.0, 0.9, (0.35, 0.012)))
    lines = [f"points/segment = {count}", "x-axis,1,2", "second,Volt,Volt"]
    lines += 2 * _rows(times, drive, sensor)
    return VendorFile(
        name="keysight_segments",
        vendor="Keysight",
        files={"scope_4.csv": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(2 * drive),
        sensor=_read(2 * sensor),
        sensor_unit="V",
        columns={"drive": "1", "sensor": "2"},
        refused="two segments: times start over in the middle",
        remark=TOLD + "Whether the times of later segments start over or go on depends on the firmware; here they do.",
    )


def _keysight_fra() -> VendorFile:
    """Keysight frequency response analysis; seen: the header that the public package openqlab looks for."""
    count = 301
    frequency = np.logspace(3, 5, count)
    gain = 1.0 / np.abs(1.0 - (frequency / 40e3) ** 2 + 0.05j * frequency / 40e3)
    decibels = _cells(20.0 * np.log10(gain), "%.2f")
    lines = ["#, Frequency (Hz), Amplitude (Vpp), Gain (dB), Phase (°)"]
    lines += _rows(_numbers(count, 1), _cells(frequency, "%.2f"), ["0.20"] * count, decibels, ["-12.50"] * count)
    return VendorFile(
        name="keysight_fra",
        vendor="Keysight",
        files={"scope_5.csv": _bytes(lines, encoding="cp1252")},
        step_s=math.nan,
        start_s=math.nan,
        drive_V=None,
        sensor=_read(decibels),
        sensor_unit="V",
        refused="frequency response: no times and no drive samples",
        remark=SEEN + "Degree sign in code page 1252. `sensor` here is the gain in dB.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Teledyne LeCroy
# ---------------------------------------------------------------------------------------------------------------------


def _lecroy_trace(model: str, times: list[str], cells: list[str], sep: str = ",", end: str = "\r\n") -> bytes:
    """One trace in LeCroy's ASCII layout."""
    head = [
        [model, "51235", "Waveform"],
        ["Segments", "1", "SegmentSize", str(len(times))],
        ["Segment", "TrigTime", "TimeSinceSegment1"],
        ["#1", "11-Jun-2024 12:34:56", "0" + 17 * " "],
        ["Time", "Ampl"],
    ]
    return _bytes([*(sep.join(row) for row in head), *_rows(times, cells, sep=sep)], end=end)


def _lecroy_hdo() -> VendorFile:
    """Teledyne LeCroy WaveSurfer/HDO, one file per trace; seen: lines of an HDO9404 file in a public program."""
    count, start, step = 502, -1.78051e-5, 2e-7
    times = _cells(_times(start, step, count), "%.9g")
    drive, sensor = (_cells(v, "%.8g") for v in _fast(count, step, 40.0, 0.7, (0.01220703125, 0.00030517578125)))
    return VendorFile(
        name="lecroy_hdo",
        vendor="Teledyne LeCroy",
        files={
            "C1--drop--00000.csv": _lecroy_trace("LECROYHDO9404", times, drive),
            "C2--drop--00000.csv": _lecroy_trace("LECROYHDO9404", times, sensor),
        },
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "C1", "sensor": "C2"},
        remark=SEEN
        + "The channel is named only at the start of the file's name; every column is called Ampl; no unit. "
        "Blanks at the end of the fourth row; the date row holds several numbers.",
    )


def _lecroy_math() -> VendorFile:
    """Teledyne LeCroy with a math trace F1 saved beside the channels; layout as for `lecroy_hdo`."""
    count, start, step = 402, -4.00002e-5, 2.5e-7
    times = _long_exponents(_cells(_times(start, step, count), "%.8e"))
    drive, sensor = (_cells(v, "%.6g") for v in _fast(count, step, 35.0, 0.4, (0.25, 0.004)))
    summed = _cells(_read(drive) + _read(sensor), "%.6g")
    return VendorFile(
        name="lecroy_math",
        vendor="Teledyne LeCroy",
        files={
            f"{label}--pulse--00003.csv": _lecroy_trace("LECROYMAUI", times, cells)
            for label, cells in (("C2", drive), ("C3", sensor), ("F1", summed))
        },
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "C2", "sensor": "C3"},
        remark=SEEN + "A third file F1 (a sum) that is neither; times with exponents of three digits (-4.0e-005), as "
        "quoted from a LECROYMAUI file in a public converter.",
    )


def _lecroy_semicolons() -> VendorFile:
    """LeCroy WaveRunner with semicolons, .txt; told: a public script that mimics a WR625Zi header."""
    count, start, step = 402, -8.0e-5, 5e-7
    times = _cells(_times(start, step, count), "%.8e")
    drive, sensor = (_cells(v, "%.6f") for v in _fast(count, step, 35.0, 0.4, (0.25, 0.004)))
    return VendorFile(
        name="lecroy_semicolons",
        vendor="Teledyne LeCroy",
        files={
            "C1Trace00000.txt": _lecroy_trace("LECROYWR625Zi", times, drive, sep=";", end="\n"),
            "C2Trace00000.txt": _lecroy_trace("LECROYWR625Zi", times, sensor, sep=";", end="\n"),
        },
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "C1", "sensor": "C2"},
        remark=TOLD + "Semicolons between cells, but a decimal point.",
    )


def _lecroy_wavejet() -> VendorFile:
    """LeCroy WaveJet 300; told: tests of a public reader ('ModelName,WaveJet 354A', 'Delta(second)')."""
    count, step, trigger = 500, 4e-7, 100
    drive, sensor = (_cells(v, "%.5f") for v in _fast(count, step, 40.0, 0.8, (0.4, 0.02)))
    lines = [
        "ModelName,WaveJet 354A",
        f"Delta(second),{step:.1E}",
        f"Trigger Address,{trigger}",
        "CH1 Volt/div,10",
        "CH2 Volt/div,0.5",
        "Ch1 V,Ch2 V",
        *_rows(drive, sensor),
    ]
    return VendorFile(
        name="lecroy_wavejet",
        vendor="Teledyne LeCroy",
        files={"WAVE0001.CSV": _bytes(lines)},
        step_s=step,
        start_s=-trigger * step,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "Ch1 V", "sensor": "Ch2 V"},
        remark=TOLD + "No time column; 'Delta(second)' is the interval. That the start is minus the trigger address "
        "times Delta is that reader's view; a reader that gives no start is fair.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# PicoScope
# ---------------------------------------------------------------------------------------------------------------------


def _picoscope(head: list[str], columns: list[list[str]], sep: str = ",") -> list[str]:
    """Lines of a PicoScope export: names, units, an empty row, rows."""
    return [*head, "", *_rows(*columns, sep=sep)]


def _picoscope_mv() -> VendorFile:
    """PicoScope 6, microseconds and millivolts; seen: header lines and rows quoted in several public repositories."""
    count, start, step = 500, -50.0, 0.5
    times = _cells(_times(start, step, count), "%.8f")
    drive, sensor = (_cells(v, "%.8f") for v in _fast(count, 5e-7, 300.0, 0.9, (2.4414808, 0.0078740)))
    lines = _picoscope(["Time,Channel A,Channel B", "(us),(mV),(V)"], [times, drive, sensor])
    return VendorFile(
        name="picoscope_mv",
        vendor="Pico Technology",
        files={"20240611-0001.csv": _bytes(lines)},
        step_s=5e-7,
        start_s=float(times[0]) * 1e-6,
        drive_V=_read(drive, 1e-3),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "Channel A", "sensor": "Channel B"},
        remark=SEEN + "Times in us, drive in mV: it was measured at the generator before the amplifier, 0.3 V high.",
    )


def _picoscope_german() -> VendorFile:
    """PicoScope 6 in German, decimal comma, overrange marks; seen: header 'Zeit;Kanal A;Kanal B' in public scripts and
    rows quoted in the Oszi Waveform Analyzer."""
    count, start, step, out = 450, -0.2, 0.002, 3
    times = _comma(_cells(_times(start, step, count), "%.8f"))
    drive, sensor = (_comma(_cells(v, "%.8f")) for v in _fast(count, 2e-6, 40.0, 1.8, (0.1574803, 0.0157480)))
    sensor[:out] = ["-∞", "∞", "∞"]
    lines = _picoscope(["Zeit;Kanal A;Kanal B", "(ms);(V);(V)"], [times, drive, sensor], sep=";")
    return VendorFile(
        name="picoscope_german",
        vendor="Pico Technology",
        files={"20240611-0002.csv": _bytes(lines, encoding="utf-8-sig")},
        step_s=2e-6,
        start_s=float(times[out].replace(",", ".")) * 1e-3,
        drive_V=_read(drive[out:]),
        sensor=_read(sensor[out:]),
        sensor_unit="V",
        columns={"drive": "Kanal A", "sensor": "Kanal B"},
        remark=SEEN + "Semicolons, decimal comma, UTF-8 with a byte-order mark, ms; the first "
        "three samples of the sensor are ∞ or -∞ (out of range). Both kinds of marks are from memory.",
    )


def _picoscope_french() -> VendorFile:
    """PicoScope in French; told: a public script reading 'Temps;Canal A;Canal B' with '(ms);(V);(V)'."""
    count, start, step = 450, -20.0, 0.2
    times = _comma(_cells(_times(start, step, count), "%.8f"))
    drive, sensor = (_comma(_cells(v, "%.8f")) for v in _fast(count, 2e-7, 40.0, 180.0, (0.1574803, 0.78740)))
    lines = _picoscope(["Temps;Canal A;Canal B", "(µs);(V);(mV)"], [times, drive, sensor], sep=";")
    return VendorFile(
        name="picoscope_french",
        vendor="Pico Technology",
        files={"20240611-0003.csv": _bytes(lines, encoding="latin-1")},
        step_s=2e-7,
        start_s=float(times[0].replace(",", ".")) * 1e-6,
        drive_V=_read(drive),
        sensor=_read(sensor, 1e-3),
        sensor_unit="V",
        columns={"drive": "Canal A", "sensor": "Canal B"},
        remark=TOLD + "µs with the µ as one byte of Latin-1 (0xB5): this writing of the unit is from memory.",
    )


def _picoscope_gzip() -> VendorFile:
    """PicoScope export, compressed by the user to .csv.gz; layout as for `picoscope_mv`."""
    count, start, step = 600, -0.1, 0.001
    times = _cells(_times(start, step, count), "%.8f")
    drive, sensor = (_cells(v, "%.8f") for v in _fast(count, 1e-6, 55.0, 0.9, (0.2362205, 0.0078740)))
    lines = _picoscope(["Time,Channel A,Channel B", "(ms),(V),(V)"], [times, drive, sensor])
    return VendorFile(
        name="picoscope_gzip",
        vendor="Pico Technology",
        files={"20240611-0004.csv.gz": gzip.compress(_bytes(lines), mtime=0)},
        step_s=1e-6,
        start_s=float(times[0]) * 1e-3,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "Channel A", "sensor": "Channel B"},
        remark=SEEN + "gzip around the same text.",
    )


def _picoscope_overrange_middle() -> VendorFile:
    """PicoScope with the sensor out of range in the middle of the pulse; layout as for `picoscope_german`."""
    count, step = 400, 1e-6
    times = _cells(_times(-0.1, 0.001, count), "%.8f")
    drive, sensor = (_cells(v, "%.8f") for v in _fast(count, step, 40.0, 1.9, (0.1574803, 0.0157480)))
    clipped = ["∞" if value > 1.0 else cell for cell, value in zip(sensor, _read(sensor), strict=True)]
    lines = _picoscope(["Time,Channel A,Channel B", "(ms),(V),(V)"], [times, drive, clipped])
    return VendorFile(
        name="picoscope_overrange_middle",
        vendor="Pico Technology",
        files={"20240611-0005.csv": _bytes(lines, encoding="utf-8")},
        step_s=step,
        start_s=float(times[0]) * 1e-3,
        drive_V=_read(drive),
        sensor=np.array([math.inf if cell == "∞" else float(cell) for cell in clipped]),
        sensor_unit="V",
        columns={"drive": "Channel A", "sensor": "Channel B"},
        refused="sensor out of range (∞) in the middle of the record",
        remark=SEEN + "The signal is clipped where it matters; that ∞ is printed for it is from memory.",
    )


def _picoscope_spectrum() -> VendorFile:
    """PicoScope in spectrum mode; from memory of the PicoScope 6 guide."""
    count = 512
    level = _cells(-60.0 + 45.0 * np.exp(-(((np.arange(count) - 160) / 6.0) ** 2)), "%.8f")
    lines = _picoscope(
        ["Frequency,Channel A,Channel B", "(kHz),(dBu),(dBu)"],
        [_cells(_times(0.0, 0.25, count), "%.8f"), level, level],
    )
    return VendorFile(
        name="picoscope_spectrum",
        vendor="Pico Technology",
        files={"20240611-0006.csv": _bytes(lines)},
        step_s=math.nan,
        start_s=math.nan,
        drive_V=None,
        sensor=_read(level),
        sensor_unit="V",
        refused="spectrum: first column is a frequency, channels in dBu",
        remark=MEMORY + "`sensor` here is a level in dBu.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Rohde & Schwarz, Yokogawa
# ---------------------------------------------------------------------------------------------------------------------


def _rs_rtb2000() -> VendorFile:
    """Rohde & Schwarz RTB2000; seen: header 'in s,C1 in V' and a row quoted in public converters."""
    count, start, step = 600, -5.9999832e-5, 2e-7
    times = _cells(np.float32(_times(start, step, count)).astype(float), "%.7E")
    drive, sensor = (_cells(v, "%.7E") for v in _fast(count, step, 36.0, 0.4, (0.15686275, 0.0019607844)))
    return VendorFile(
        name="rs_rtb2000",
        vendor="Rohde & Schwarz",
        files={"WFM01.CSV": _bytes(["in s,C1 in V,C2 in V", *_rows(times, drive, sensor)])},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "C1 in V", "sensor": "C2 in V"},
        remark=SEEN + "Units after the word 'in'; the time column is only 'in s'.",
    )


def _rs_rto_values_only() -> VendorFile:
    """Rohde & Schwarz RTO/RTP, values without times and a file of parameters; seen: .Wfm.csv samples of RigolWFM; told:
    keys of the parameter file in public readers."""
    count, start, step = 500, -2e-5, 2e-7
    drive, sensor = (_cells(v, "%.8g") for v in _fast(count, step, 30.0, 0.35, (0.15810277, 0.0031620555)))
    settings = [
        "SaveItemHeader:Waveform:",
        f"Resolution:{step:g}:",
        f"RecordLength:{count}:",
        f"XStart:{start:g}:",
        f"XStop:{start + step * count:g}:",
        f"HardwareXStart:{start:g}:",
        f"HardwareXStop:{start + step * count:g}:",
        f"SignalResolution:{step:g}:",
        f"SignalRecordLength:{count}:",
        f"SignalHardwareRecordLength:{count}:",
        "VerticalScale:10:0.1",
        "VerticalOffset:0:0",
        "VerticalPosition:-3:0",
        "MultiChannelExport:eRS_ONOFF_ON:",
        "MultiChannelSource:eRS_SIGNAL_SOURCE_CH1:eRS_SIGNAL_SOURCE_CH2",
        "HorizontalUnit:s:",
        "VerticalUnit:V:V",
        "TimestampState:eRS_ONOFF_OFF:",
    ]
    return VendorFile(
        name="rs_rto_values_only",
        vendor="Rohde & Schwarz",
        files={"drop.csv": _bytes(settings), "drop.Wfm.csv": _bytes(_rows(drive, sensor))},
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "1", "sensor": "2"},
        remark=SEEN
        + "drop.Wfm.csv holds two bare columns, no names, no times; interval and start are in drop.csv, whose "
        "rows are 'key:value:' with one or two values. A reader that does not pair the files needs interval_s=2e-7 and "
        "has no start.",
    )


def _rs_rtp_no_names() -> VendorFile:
    """Rohde & Schwarz RTP, times and two channels without a header; seen: sample rs_rtp_05 of RigolWFM."""
    count, start, step = 500, -5.24e-6, 2.5e-8
    times = _cells(_times(start, step, count), "%.9g")
    drive, sensor = (_cells(v, "%.6g") for v in _fast(count, step, 30.0, 0.35, (0.0123477, 0.0003088)))
    return VendorFile(
        name="rs_rtp_no_names",
        vendor="Rohde & Schwarz",
        files={"RefCurve_2024-06-11_0.Wfm.csv": _bytes(_rows(times, drive, sensor))},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "2", "sensor": "3"},
        remark=SEEN + "No header at all: the first row is a sample.",
    )


def _rs_rth1004() -> VendorFile:
    """Rohde & Schwarz Scope Rider RTH; told: the 20 keys a public reader of RTH1004 files takes from the header."""
    count, start, step = 500, -1e-4, 1e-6
    times = _cells(_times(start, step, count), "%.9e")
    drive, sensor = (_cells(v, "%.6e") for v in _fast(count, step, 40.0, 0.8, (0.4, 0.02)))
    lines = [
        "Model;RTH1004",
        "SerialNumber;100000",
        "Firmware Version;'1.80.4.5'",
        "Acquisition Time Stamp;2024-06-11 12:34:56.789012345",
        "Waveform Type;Analog",
        "Acquisition Mode;Sample",
        "Horizontal Unit;s",
        "Horizontal Scale;5.000000e-05",
        "Horizontal Position;0.000000e+00",
        "Reference Point;20%",
        f"Sample Interval;{step:.6e}",
        f"Record Length;{count}",
        "History Index;1;1",
        "Probe Setting;V 100:1;V 1:1",
        "Vertical Unit;V;V",
        "Vertical Scale;1.000000e+01;5.000000e-01",
        "Vertical Position;-2.000000e+00;0.000000e+00",
        "Vertical Offset;0.000000e+00;0.000000e+00",
        "Coupling;DC;DC",
        "Label;;",
        "",
        "TIME;C1;C2",
        *_rows(times, drive, sensor, sep=";"),
    ]
    return VendorFile(
        name="rs_rth1004",
        vendor="Rohde & Schwarz",
        files={"RTH_001.csv": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "C1", "sensor": "C2"},
        remark=TOLD
        + "Semicolons with a decimal point; keys from a reader, their order and the row of names are guesses.",
    )


def _yokogawa_dl850() -> VendorFile:
    """Yokogawa DL750/DL850 ASCII; from memory of the manuals of the ScopeCorder series."""
    count, start, step = 501, -1e-4, 1e-6
    drive, sensor = (_cells(v, "%.5E") for v in _fast(count, step, 40.0, 800.0, (0.05, 12.5)))
    lines = [
        '"Header Size",16',
        '"Model Name","DL850"',
        '"Comment",""',
        '"BlockNumber",1',
        '"TraceName","CH1","CH2"',
        f'"BlockSize",{count},{count}',
        '"VUnit","V","uV"',
        '"SampleRate",1.00000E+06,1.00000E+06',
        f'"HResolution",{step:.5E},{step:.5E}',
        f'"HOffset",{start:.5E},{start:.5E}',
        '"HUnit","s","s"',
        f'"DisplayBlockSize",{count},{count}',
        '"DisplayPointNo.",1,1',
        '"PhaseShift",0,0',
        '"Date","2024/06/11","2024/06/11"',
        '"Time","12:34:56.78901","12:34:56.78901"',
        "",
        *_rows([""] * count, drive, sensor, tail=","),
    ]
    return VendorFile(
        name="yokogawa_dl850",
        vendor="Yokogawa",
        files={"00001.CSV": _bytes(lines)},
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor, 1e-6),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=MEMORY + "Quoted keys, one value per trace; each row begins and ends with a comma; no times, but "
        "HResolution and HOffset; sensor in uV.",
    )


def _yokogawa_time_per_channel() -> VendorFile:
    """Yokogawa Xviewer CSV with a time column for each channel; from memory."""
    count, start, step = 400, -0.5, 0.005
    times = _cells(_times(start, step, count), "%.6f")
    drive, sensor = (_cells(v, "%.5f") for v in _slow(count, 60.0, 5.2, 0.002))
    lines = ["Time1[s],CH1[V],Time2[s],CH2[um]", *_rows(times, drive, times, sensor)]
    return VendorFile(
        name="yokogawa_time_per_channel",
        vendor="Yokogawa",
        files={"export.csv": _bytes(lines)},
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        remark=MEMORY + "t1,ch1,t2,ch2 with equal times; units in square brackets tell the roles.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# OWON, Hantek, GW Instek, Micsig
# ---------------------------------------------------------------------------------------------------------------------


def _owon_hds200() -> VendorFile:
    """OWON HDS200/DOS1100, row numbers and an interval with its unit; seen: a file quoted in the program OwonOszi."""
    count, step = 500, 2e-7
    drive, sensor = (_cells(v, "%.2f") for v in _fast(count, step, 40000.0, 640.0, (800.0, 20.0)))
    lines = [
        "Channel\t\t\t  :,CH1,CH2",
        "Frequency\t\t\t  :,F=?,F=40.00kHz",
        "Period \t\t\t  :,T=?,T=25.00us",
        "PK-PK\t\t\t\t  :,Vpp=40.00V,Vpp=1.180V",
        "Average\t\t\t  :,V=4.000V,V=-9.333mV",
        "Vertical pos\t\t  :,0.00mV,0.00mV",
        "Probe attenuation\t  :,100X,1X",
        "Voltage per ADC value:,800.00mV,20.00mV",
        "Time interval\t\t  :,0.20000uS,0.20000uS",
        "",
        "index,CH1_Voltage(mV),CH2_Voltage(mV)",
        *_rows(_numbers(count), drive, sensor),
    ]
    return VendorFile(
        name="owon_hds200",
        vendor="OWON",
        files={"WAVE1.CSV": _bytes(lines)},
        step_s=step,
        start_s=math.nan,
        drive_V=_read(drive, 1e-3),
        sensor=_read(sensor, 1e-3),
        sensor_unit="V",
        columns={"drive": "CH1_Voltage(mV)", "sensor": "CH2_Voltage(mV)"},
        remark=SEEN + "The one-channel header is real, the second column after it is not seen. Tabs and blanks inside "
        "the keys; interval '0.20000uS'; millivolts; row numbers; no start.",
    )


def _owon_descending() -> VendorFile:
    """OWON Java software 1.1.5, times running backwards; seen: rows quoted in the Oszi Waveform Analyzer."""
    count, step = 400, 4e-6
    times = _cells(_times(0.8, -0.004, count), "%.7f")
    drive, sensor = (_cells(v, "%.2f") for v in _fast(count, step, 40000.0, 640.0, (80.0, 20.0)))
    lines = ["#,Time(ms),CH1(mV),CH2(mV)", *_rows(_numbers(count), times, drive, sensor)]
    return VendorFile(
        name="owon_descending",
        vendor="OWON",
        files={"owon.csv": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]) * 1e-3,
        drive_V=_read(drive, 1e-3),
        sensor=_read(sensor, 1e-3),
        sensor_unit="V",
        columns={"drive": "CH1(mV)", "sensor": "CH2(mV)"},
        refused="times run backwards",
        remark=SEEN + "Row numbers rise while times fall: which of the two is right nobody can tell from the file. The "
        "header row begins with #.",
    )


def _hantek_dso5000() -> VendorFile:
    """Hantek DSO5000P, one file per channel; seen: the three header lines and a row quoted in public readers."""
    count, start, step = 400, 2.5e-6, 2.5e-6
    times = _cells(_times(start, step, count), "%.5E")
    drive, sensor = (_cells(v, "%.3f") for v in _fast(count, step, 40.0, 2.0, (0.4, 0.02)))

    def channel(base: int, cells: list[str]) -> bytes:
        head = ["#timebase=200000000(ps)", f",#voltbase={base}(uV)", f"#size={count}"]
        return _bytes([*head, *_rows(times, cells)], end="\n")

    return VendorFile(
        name="hantek_dso5000",
        vendor="Hantek",
        files={"wave_CH1_0001.csv": channel(10000000, drive), "wave_CH2_0001.csv": channel(500000, sensor)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN + "Comment lines with #, one of them after a comma; no names, no units of the columns (volts). The "
        "timebase in ps is that of the screen, not the sampling interval. The names of the files, with the channel in "
        "the middle, are made up.",
    )


def _openhantek() -> VendorFile:
    """OpenHantek6022 CSV export; from memory of the program."""
    count, start, step = 500, -1e-4, 1e-6
    times = _plain(_times(start, step, count), 9)
    drive, sensor = (_plain(v, 6) for v in _fast(count, step, 40.0, 0.8, (0.4, 0.02)))
    lines = ['"t / s","CH1 / V","CH2 / V","MATH / V"', *_rows(times, drive, sensor, sensor)]
    return VendorFile(
        name="openhantek",
        vendor="OpenHantek",
        files={"20240611_123456.csv": _bytes(lines, end="\n")},
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1 / V", "sensor": "CH2 / V"},
        remark=MEMORY + "Quoted names with the unit behind a stroke (t / s); a math channel.",
    )


def _gwinstek_detail() -> VendorFile:
    """GW Instek GDS-1000B, detail mode, all channels; told: header keys and layout in openqlab's reader."""
    count, start, step = 500, -5e-5, 5e-7
    times = _cells(_times(start, step, count), "%.9e")
    drive, sensor = (_cells(v, "%.6e") for v in _fast(count, step, 40.0, 0.8, (0.4, 0.02)))
    pairs = [
        ("Memory Length", str(count), str(count)),
        ("IntpDistance", "0", "0"),
        ("Trigger Address", "99", "99"),
        ("Trigger Level", "2.000E+01", "2.000E+01"),
        ("Source", "CH1", "CH2"),
        ("Vertical Units", "V", "V"),
        ("Vertical Units Div", "0", "0"),
        ("Vertical Units Extend Div", "15", "15"),
        ("Label", " ", " "),
        ("Probe Type", "0", "0"),
        ("Probe Ratio", "1.000e+02", "1.000e+00"),
        ("Vertical Scale", "1.000e+01", "5.000e-01"),
        ("Vertical Position", "-2.000e+01", "0.000e+00"),
        ("Horizontal Units", "S", "S"),
        ("Horizontal Scale", "2.500E-05", "2.500E-05"),
        ("Horizontal Position", "0.000E+00", "0.000E+00"),
        ("Horizontal Mode", "Main", "Main"),
        ("SincET Mode", "Real Time", "Real Time"),
        ("Sampling Period", "5.000E-07", "5.000E-07"),
        ("Horizontal Old Scale", "2.500E-05", "2.500E-05"),
        ("Horizontal Old Position", "0.000E+00", "0.000E+00"),
        ("Firmware", "V1.19", "V1.19"),
        ("Time", "11-Jun-24 12:34:56", "11-Jun-24 12:34:56"),
        ("Mode", "Detail", "Detail"),
    ]
    lines = ["Format,1.0B,"]
    lines += [f"{key},{first},{key},{second}," for key, first, second in pairs]
    lines += ["Waveform Data,,Waveform Data,,", *_rows(times, drive, times, sensor, tail=",")]
    return VendorFile(
        name="gwinstek_detail",
        vendor="GW Instek",
        files={"DS0001.CSV": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=TOLD + "Each key is repeated for each channel; time, CH1, time, CH2 in rows that end with a comma; the "
        "names stand in the row Source. The exact rows are not seen.",
    )


def _gwinstek_fast() -> VendorFile:
    """GW Instek GDS-1000A, fast mode: counts only; seen: the header quoted in a public analysis program."""
    count, step = 400, 4e-6
    codes = [np.round(_pulse(count, 100.0)), np.round(_ringing(count, step, 60.0))]
    drive, sensor = (_cells(values, "%.0f") for values in codes)

    def channel(label: str, scale: str, cells: list[str]) -> bytes:
        head = [
            f"Memory Length,{count},",
            "Trigger Level,2.00000e+01,",
            f"Source,{label},",
            "Probe,100X," if label == "CH1" else "Probe,1.0X,",
            "Vertical Units,V,",
            f"Vertical Scale,{scale},",
            "Vertical Position,0.00000e+00,",
            "Horizontal Units,S,",
            "Horizontal Scale,2.00000e-04,",
            "Horizontal Position,0.0000000e+00,",
            "Horizontal Mode,Main,",
            "Sampling Period,4.00000e-06,",
            "Firmware,V1.09,",
            "Time, ,",
            "Mode,Fast,",
            "Waveform Data,",
        ]
        return _bytes([*head, *_rows(cells, tail=",")])

    return VendorFile(
        name="gwinstek_fast",
        vendor="GW Instek",
        files={
            "A0001CH1.CSV": channel("CH1", "1.00000e+01", drive),
            "A0001CH2.CSV": channel("CH2", "5.00000e-01", sensor),
        },
        step_s=step,
        start_s=math.nan,
        drive_V=_read(drive, 10.0 / 25.0),
        sensor=_read(sensor, 0.5 / 25.0),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        refused="raw converter counts, 25 to a division, though the header says V",
        remark=SEEN
        + "Header real, rows from memory. Taking the integers as volts would be wrong; a reader that knows the "
        "format may multiply by Vertical Scale / 25, which is what `drive_V` and `sensor` hold.",
    )


def _micsig_tbook() -> VendorFile:
    """Micsig tBook, header to the left of the samples; told: the first row and the keys in public source code."""
    count, start, step = 400, -1e-4, 1e-6
    times = _cells(_times(start, step, count), "%.9f")
    drive, sensor = (_cells(v, "%.4f") for v in _fast(count, step, 40.0, 0.8, (0.4, 0.02)))

    def channel(label: str, scale: str, probe: str, cells: list[str]) -> bytes:
        head = [
            "Model,ATO1104,",
            f"Record Length,{count},",
            "Sample Interval,0.000001,",
            "Trigger Time,0,",
            f"Source,{label},",
            "Vertical Units,V,",
            f"Vertical Scale,{scale},",
            "Vertical Offset,0,",
            "Horizontal Units,s,",
            "Horizontal Scale,0.00005,",
            f"Probe Atten,{probe},",
        ]
        left = head + [",,"] * (count - len(head))
        return _bytes(["ProID,Info,,time,Vol.,", *_rows(left, times, cells, tail=",")])

    return VendorFile(
        name="micsig_tbook",
        vendor="Micsig",
        files={
            "wave1_CH1.csv": channel("CH1", "10", "100", drive),
            "wave1_CH2.csv": channel("CH2", "0.5", "1", sensor),
        },
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=TOLD + "Keys and values beside the first samples; columns named time and Vol.; one file per channel.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# National Instruments LabVIEW
# ---------------------------------------------------------------------------------------------------------------------


def _labview_lvm_comma() -> VendorFile:
    """LabVIEW measurement file without times, decimal comma; seen: data/short.lvm of the public package lvm_read."""
    count, step = 500, 3.90625e-5
    drive, sensor = (_comma(_cells(v, "%.6f")) for v in _slow(count, 30.0, 2.4, 0.001))
    lines = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        "Decimal_Separator\t,",
        "Multi_Headings\tYes",
        "X_Columns\tNo",
        "Time_Pref\tAbsolute",
        "Operator\tlab",
        "Date\t2024/06/11",
        "Time\t12:34:56,1970510124996275989",
        "***End_of_Header***\t",
        "\t",
        "Channels\t2\t\t",
        f"Samples\t{count}\t{count}\t",
        "Date\t2024/06/11\t2024/06/11\t",
        "Time\t12:34:57,7271890640258789063\t12:34:57,7271890640258789063\t",
        "Y_Unit_Label\tVolts\tµm\t",
        "X_Dimension\tTime\tTime\t",
        "X0\t0,0000000000000000E+0\t0,0000000000000000E+0\t",
        "Delta_X\t3,906250E-5\t3,906250E-5\t",
        "***End_of_Header***\t\t\t",
        "X_Value\tExcitation (Trigger)\tResponse (Trigger)\tComment",
        *_rows([""] * count, drive, sensor, sep="\t"),
    ]
    return VendorFile(
        name="labview_lvm_comma",
        vendor="National Instruments",
        files={"sweep.lvm": _bytes(lines, encoding="latin-1")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        remark=SEEN
        + "Header of 22 rows, two of them ***End_of_Header***; tabs; decimal comma; empty X_Value cells with "
        "X0 and Delta_X in the header; µ in Latin-1; names Excitation and Response; a Comment column without cells.",
    )


def _labview_lvm_multi_x() -> VendorFile:
    """LabVIEW measurement file with a time column per channel; seen: data/multi_time_column.lvm of lvm_read."""
    count, step = 400, 1e-3
    times = _cells(_times(0.0, step, count), "%.6f")
    drive, sensor = (_cells(v, "%.6f") for v in _slow(count, 45.0, 3600.0, 1.0))
    lines = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        "Decimal_Separator\t.",
        "Multi_Headings\tYes",
        "X_Columns\tMulti",
        "Time_Pref\tAbsolute",
        "Operator\tlab",
        "Date\t2024/06/11",
        "Time\t10:45:47.0352557312499836422",
        "***End_of_Header***\t",
        "\t",
        "Channels\t2\t\t\t",
        f"Samples\t{count}\t\t{count}\t",
        "Date\t2024/06/11\t\t2024/06/11\t",
        "Time\t10:45:47.0352557312499836422\t\t10:45:47.0352557312499836422\t",
        "Y_Unit_Label\tVolts\t\tnm\t",
        "X_Dimension\tTime\t\tTime\t",
        "X0\t0.0000000000000000E+0\t\t0.0000000000000000E+0\t",
        "Delta_X\t1.000000E-3\t\t1.000000E-3\t",
        "***End_of_Header***\t\t\t\t",
        "X_Value\tVoltage\tX_Value\tDisplacement\tComment",
        *_rows(times, drive, times, sensor, sep="\t"),
        "",
    ]
    return VendorFile(
        name="labview_lvm_multi_x",
        vendor="National Instruments",
        files={"loop.lvm": _bytes(lines, end="\n")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="nm",
        remark=SEEN + "X_Value before each channel; an empty row at the end of the block; nm.",
    )


def _labview_spreadsheet() -> VendorFile:
    """LabVIEW's 'write to spreadsheet file', tabs and no header; from memory of the function."""
    count, step = 400, 2e-3
    times = _cells(_times(0.0, step, count), "%.3f")
    drive, sensor = (_cells(v, "%.3f") for v in _slow(count, 60.0, 8.0, 0.002))
    return VendorFile(
        name="labview_spreadsheet",
        vendor="National Instruments",
        files={"log.txt": _bytes(_rows(times, drive, sensor, sep="\t"))},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "2", "sensor": "3"},
        remark=MEMORY + "Three columns with three decimals (the default format), nothing else; no units, so volts.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# USB scopes and analysers with open programs
# ---------------------------------------------------------------------------------------------------------------------


def _digilent_waveforms() -> VendorFile:
    """Digilent WaveForms scope export; seen: header lines quoted in scopehal and in public example writers."""
    count, start, step = 512, -2e-5, 2e-7
    times = _cells(_times(start, step, count), "%.17g")
    drive, sensor = (_cells(v, "%.17g") for v in _fast(count, step, 3.0, 0.2, (0.00335, 0.00033)))
    lines = [
        "#Digilent WaveForms Oscilloscope Acquisition",
        "#Device Name: Discovery2",
        "#Serial Number: SN:210321A00000",
        "#Date Time: 2024-06-11 12:34:56.789.012.345",
        "#Sample rate: 5e+06Hz",
        f"#Samples: {count}",
        "#Trigger: Source: Channel 1 Type: Edge Condition: Rise Level: 1 V Hysteresis: 10 mV HoldOff: 0 s",
        "#Channel 1: Range: 1 V/div Offset: -1 V",
        "#Channel 2: Range: 50 mV/div Offset: 0 V",
        "",
        "Time (s),Channel 1 (V),Channel 2 (V)",
        *_rows(times, drive, sensor),
    ]
    return VendorFile(
        name="digilent_waveforms",
        vendor="Digilent",
        files={"acq0001.csv": _bytes(lines)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "Channel 1 (V)", "sensor": "Channel 2 (V)"},
        remark=SEEN + "Comment lines with # that hold several numbers and units; 17 digits; drive of 3 V at the "
        "generator. The 17 digits and the spelling 5e+06Hz of the rate are from memory.",
    )


def _digilent_spectrum() -> VendorFile:
    """Digilent WaveForms spectrum export; layout as for `digilent_waveforms`, names from memory."""
    count = 400
    level = _cells(-80.0 + 60.0 * np.exp(-(((np.arange(count) - 80) / 4.0) ** 2)), "%.6f")
    lines = [
        "#Digilent WaveForms Spectrum Acquisition",
        "#Device Name: Discovery2",
        "#Window: FlatTop",
        "",
        "Frequency (Hz),Trace 1 (dBV),Trace 2 (dBV)",
        *_rows(_cells(_times(0.0, 500.0, count), "%.6f"), level, level),
    ]
    return VendorFile(
        name="digilent_spectrum",
        vendor="Digilent",
        files={"spectrum.csv": _bytes(lines)},
        step_s=math.nan,
        start_s=math.nan,
        drive_V=None,
        sensor=_read(level),
        sensor_unit="V",
        refused="spectrum: first column in Hz, traces in dBV",
        remark=MEMORY + "`sensor` here is a level in dBV.",
    )


def _moku_go() -> VendorFile:
    """Liquid Instruments Moku:Go data logger; seen: the output printed in the documentation of mokucli."""
    count, step = 500, 1e-6
    times = _cells(_times(0.0, step, count), "%.10e")
    drive, sensor = (_cells(v, "%.10e") for v in _fast(count, step, 4.0, 0.3, (0.0012, 0.0003)))
    lines = [
        "% Moku:Go Data Logger",
        "% Input 1 (on), DC , 1 MOhm , 10 Vpp",
        "% Input 2 (on), DC , 1 MOhm , 10 Vpp",
        "% Acquisition rate: 1.0000000000e+06 Hz, Precision mode",
        "% Output 1 (off) - Sine, 10.000 000 000 000 MHz, 1.000 0 Vpp, offset 0.000 0 V, phase 0.000 000 deg",
        "% Output 2 (off) - Square, 50.000 000 000 kHz, 500.0 mVpp, offset 0.000 0 V, phase 0.000 000 deg, "
        "duty cycle 50.00 %",
        "%",
        "% Acquired 2024-06-11 T 12:34:56 +0200",
        "% Time (s), Input 1 (V), Input 2 (V)",
        *_rows(times, drive, sensor, sep=", "),
    ]
    return VendorFile(
        name="moku_go",
        vendor="Liquid Instruments",
        files={"MokuDataLoggerData_20240611_123456.csv": _bytes(lines)},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "Input 1 (V)", "sensor": "Input 2 (V)"},
        remark=SEEN + "Every header line, the one with the names too, begins with %; blanks inside numbers and after "
        "commas.",
    )


def _saleae_logic2() -> VendorFile:
    """Saleae Logic 2 raw export, analog.csv beside digital.csv; seen: headers and digital rows in many repositories."""
    count, start, step = 600, 0.0, 1.6e-6
    times = _cells(_times(start, step, count), "%.9f")
    drive, sensor = (_cells(v, "%.15g") for v in _fast(count, step, 8.0, 1.2, (0.00488400488, 0.00488400488)))
    analog = ["Time [s],Channel 0,Channel 1", *_rows(times, drive, sensor)]
    digital = ["Time [s],Channel 2", "0.000000000,0", "0.000192000,1", "0.000288000,0"]
    return VendorFile(
        name="saleae_logic2",
        vendor="Saleae",
        files={"analog.csv": _bytes(analog, end="\n"), "digital.csv": _bytes(digital, end="\n")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "Channel 0", "sensor": "Channel 1"},
        remark=SEEN + "digital.csv holds one row per change and is not part of the recording. Voltages without a unit; "
        "the rows of analog.csv are from memory.",
    )


def _sigrok_cli() -> VendorFile:
    """sigrok-cli -O csv:label=channel; seen: the source text of libsigrok's CSV writer and headers in repositories."""
    count, step = 500, 1e-6
    drive, sensor = (_cells(v, "%.6g") for v in _fast(count, step, 40.0, 0.8, (0.4, 0.02)))
    lines = [
        "; CSV generated by libsigrok 0.5.2",
        "; from Hantek 6xxx (fx2lafw) on Tue Jun 11 12:34:56 2024",
        "",
        "; Channels (2/2): CH1, CH2",
        "; Samplerate: 1 MHz",
        "CH1,CH2",
        *_rows(drive, sensor),
    ]
    return VendorFile(
        name="sigrok_cli",
        vendor="sigrok",
        files={"capture.csv": _bytes(lines, end="\n")},
        step_s=step,
        start_s=math.nan,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1", "sensor": "CH2"},
        remark=SEEN
        + "Comment lines with a semicolon in a file of commas; sample rate '1 MHz' in one of them; an empty "
        "row after the date; no times, no units.",
    )


def _scopy_m2k() -> VendorFile:
    """Analog Devices Scopy with an ADALM2000; seen: header and column names in public readers and test data."""
    count, start, step = 600, -1e-4, 1e-6
    times = _cells(_times(start, step, count), "%.6f")
    drive, sensor = (_cells(v, "%.6f") for v in _fast(count, step, 9.0, 0.6, (0.004883, 0.0012)))
    math_cells = _cells(_read(sensor) - _read(drive), "%.6f")
    lines = [
        ";Scopy version,48fb6a9",
        ";Exported on,Tuesday June 11/06/2024",
        ";Device,M2K",
        f";Nr of samples,{count}",
        ";Sample rate,1.00E+06",
        ";Tool,Oscilloscope",
        ";Additional Information,",
        "Sample,Time(S),CH1(V),CH2(V),M1(V)",
        *_rows(_numbers(count), times, drive, sensor, math_cells),
    ]
    return VendorFile(
        name="scopy_m2k",
        vendor="Analog Devices",
        files={"scopy.csv": _bytes(lines, end="\n")},
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "CH1(V)", "sensor": "CH2(V)"},
        remark=SEEN + "Row numbers and times side by side; a math channel M1; unit S (capital) for seconds.",
    )


def _red_pitaya_acquire() -> VendorFile:
    """Red Pitaya 'acquire' tool with its output in volts redirected to a file; from memory of the tool."""
    count, step = 512, 8.192e-6
    drive, sensor = (_cells(v, "%10.6f") for v in _fast(count, step, 0.9, 0.12, (0.000122, 0.000122)))
    return VendorFile(
        name="red_pitaya_acquire",
        vendor="Red Pitaya",
        files={"acquire.txt": _bytes(_rows(drive, sensor, sep=" "), end="\n")},
        step_s=step,
        start_s=math.nan,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "1", "sensor": "2"},
        interval_s=step,
        remark=MEMORY + "Two columns of volts set apart by blanks, several at the start of a row; no names, no times. "
        "The interval (125 MHz / 1024) must be stated.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Vibrometers, interferometers, piezo controllers
# ---------------------------------------------------------------------------------------------------------------------


def _polytec_file(signal: str, unit: str, times: list[str], cells: list[str]) -> bytes:
    """One signal in Polytec's ASCII layout."""
    head = [
        "Source File Name:\tnozzle 40 V 25 deg",
        f"Signal:\tTime - {signal} - Samples",
        "Time\tTime Signal",
        f"[ s ]\t[ {unit} ]",
    ]
    return _bytes([*head, *_rows(times, cells, sep="\t")])


def _polytec_displacement() -> VendorFile:
    """Polytec vibrometer, one signal per ASCII file; seen: the four header rows quoted in a public analysis program."""
    count, start, step = 500, -2e-5, 4e-7
    times = _cells(_times(start, step, count), "%.8E")
    drive, sensor = (_cells(v, "%.8E") for v in _fast(count, step, 40.0, 8e-8, (0.01, 2e-11)))
    return VendorFile(
        name="polytec_displacement",
        vendor="Polytec",
        files={
            "nozzle_07_Ref1.txt": _polytec_file("Ref1 Voltage", "V", times, drive),
            "nozzle_07_Vib.txt": _polytec_file("Vib Displacement", "m", times, sensor),
        },
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor, 1e9),
        sensor_unit="nm",
        remark=SEEN
        + "Header real for a velocity; here a displacement in metres ([ m ], blanks inside the brackets) and "
        "the reference input in volts. Both columns are called Time Signal: unit and the row Signal tell the roles.",
    )


def _polytec_velocity() -> VendorFile:
    """Polytec vibrometer with a velocity output; seen: the header is real."""
    count, start, step = 500, -2e-5, 4e-7
    times = _cells(_times(start, step, count), "%.8E")
    drive, sensor = (_cells(v, "%.8E") for v in _fast(count, step, 40.0, 0.02, (0.01, 1e-6)))
    return VendorFile(
        name="polytec_velocity",
        vendor="Polytec",
        files={
            "nozzle_08_Ref1.txt": _polytec_file("Ref1 Voltage", "V", times, drive),
            "nozzle_08_Vib.txt": _polytec_file("Vib Velocity", "m/s", times, sensor),
        },
        step_s=step,
        start_s=start,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        refused="velocity in m/s: neither a displacement nor a voltage",
        remark=SEEN + "m/s must not be taken for m. `sensor` here is in m/s.",
    )


def _sios_interferometer() -> VendorFile:
    """SIOS interferometer with an analog input, German; from memory of INFAS exports."""
    count, step = 500, 1e-3
    times = _comma(_cells(_times(0.0, 1.0, count), "%.3f"))
    drive, sensor = (
        _comma(_cells(v, form)) for v, form in zip(_slow(count, 30.0, 2200.0, 0.4), ("%.4f", "%.2f"), strict=True)
    )
    lines = [
        "SIOS Meßtechnik GmbH",
        "Datum:\t11.06.2024\t12:34:56",
        "Kanal:\t1\tLänge",
        "Umgebung:\t20,13 °C\t1013,25 hPa\t45,0 %",
        "",
        "Zeit [ms]\tSpannung [V]\tLänge [nm]",
        *_rows(times, drive, sensor, sep="\t"),
    ]
    return VendorFile(
        name="sios_interferometer",
        vendor="SIOS",
        files={"messung.asc": _bytes(lines, encoding="latin-1")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="nm",
        remark=MEMORY + "German names and letters (ß, ä, °) in Latin-1, tabs, decimal comma, ms, nm; a header row with "
        "three numbers.",
    )


def _attocube_ids() -> VendorFile:
    """attocube IDS displacement log; from memory. There is no drive in it."""
    count, step = 400, 1e-2
    sensor = _cells(_slow(count, 30.0, 2.2e6, 300.0)[1], "%.0f")
    lines = ["Time [s];Position Axis 0 [pm]", *_rows(_cells(_times(0.0, step, count), "%.2f"), sensor, sep=";")]
    return VendorFile(
        name="attocube_ids",
        vendor="attocube",
        files={"ids_log.csv": _bytes(lines)},
        step_s=step,
        start_s=0.0,
        drive_V=None,
        sensor=_read(sensor, 1e-3),
        sensor_unit="nm",
        refused="no drive channel",
        remark=MEMORY + "Position in pm, semicolons, 10 ms per row.",
    )


def _pi_array(names: list[str], step: float, columns: list[list[str]]) -> bytes:
    """A GCS array of a PI controller's data recorder."""
    head = [
        "# REM E-753.1CD ",
        "# ",
        "# VERSION = 1 ",
        "# TYPE = 1 ",
        "# SEPARATOR = 32 ",
        f"# DIM = {len(names)} ",
        f"# SAMPLE_TIME = {step:.6f} ",
        f"# NDATA = {len(columns[0])} ",
        "# ",
        *(f"# NAME{place} = {name} " for place, name in enumerate(names)),
        "# ",
        "# END_HEADER ",
    ]
    rows = _rows(*columns, sep=" ", tail=" ")
    return _bytes([*head, *rows[:-1], rows[-1].rstrip()], end="\n")


def _pi_gcs_voltage() -> VendorFile:
    """Physik Instrumente data recorder (DRR?), output voltage and position; seen: a GCS array in PIPython's tests."""
    count, step = 400, 4e-5
    drive, sensor = (_cells(v, "%.7f") for v in _slow(count, 60.0, 9.5, 0.001))
    names = ["Voltage of Output Chan  OUTP:1", "Actual Position of Axis  AXIS:1"]
    return VendorFile(
        name="pi_gcs_voltage",
        vendor="Physik Instrumente",
        files={"record.dat": _pi_array(names, step, [drive, sensor])},
        step_s=step,
        start_s=math.nan,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        remark=SEEN
        + "Comment lines with # hold everything: SAMPLE_TIME in seconds, names in NAME0 and NAME1, a blank at "
        "the end of each line but the last. The name of the voltage is from memory. The file does not say that "
        "positions are in um: a reader must know it of PI, or be told.",
    )


def _pi_gcs_command_position() -> VendorFile:
    """Physik Instrumente data recorder, commanded and actual position; seen: names and layout in PIPython's tests."""
    count, step = 400, 4e-5
    command, sensor = (_cells(v, "%.7f") for v in _slow(count, 9.5, 9.5, 0.001))
    names = ["Commanded Position of Axis  AXIS:1", "Actual Position of Axis  AXIS:1"]
    return VendorFile(
        name="pi_gcs_command_position",
        vendor="Physik Instrumente",
        files={"record2.dat": _pi_array(names, step, [command, sensor])},
        step_s=step,
        start_s=math.nan,
        drive_V=None,
        sensor=_read(sensor),
        sensor_unit="um",
        refused="commanded position is no voltage: no drive channel",
        remark=SEEN + "The command is a position of a closed loop. A reader that takes it for volts is wrong.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Control and data acquisition programs
# ---------------------------------------------------------------------------------------------------------------------


def _dspace_controldesk() -> VendorFile:
    """dSPACE ControlDesk recorder CSV; from memory of the program."""
    count, step = 400, 1e-3
    times = _plain(_times(0.0, step, count), 9)
    drive, sensor = (_plain(v, 7) for v in _slow(count, 50.0, 6.0, 0.001))
    lines = [
        "type,trace_information",
        "format_version,1.0",
        "description,",
        "timestamp,2024-06-11T12:34:56",
        "path,,Model Root/command/Out1,Model Root/position/Out1",
        "unit,s,V,um",
        "raster,,HostService,HostService",
        "name,time,command,position",
        *(f"trace_values,{row}" for row in _rows(times, drive, sensor)),
    ]
    return VendorFile(
        name="dspace_controldesk",
        vendor="dSPACE",
        files={"rec1_001.csv": _bytes(lines)},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        remark=MEMORY + "Poorly remembered: the first cell of each row tells its kind (unit, name, trace_values). "
        "Names command and position, units V and um.",
    )


def _zurich_labone_ticks() -> VendorFile:
    """Zurich Instruments LabOne, one node per file with clock ticks; told: 'chunk;timestamp;value' in readers."""
    count, ticks, clock = 400, 4480, 60e6
    stamps = [str(1123456789012 + ticks * row) for row in range(count)]
    drive, sensor = (_cells(v, "%.12g") for v in _slow(count, 9.0, 0.8, 0.0004))

    def node(cells: list[str]) -> bytes:
        return _bytes(["chunk;timestamp;value", *_rows(["0"] * count, stamps, cells, sep=";")], end="\n")

    return VendorFile(
        name="zurich_labone_ticks",
        vendor="Zurich Instruments",
        files={
            "dev3000_auxins_0_sample_auxin0_00000.csv": node(drive),
            "dev3000_demods_0_sample_x_00000.csv": node(sensor),
        },
        step_s=ticks / clock,
        start_s=math.nan,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "auxin0", "sensor": "x"},
        refused="times are ticks of a clock whose rate the file does not say",
        remark=TOLD + "With interval_s = 4480/60e6 stated it could be read.",
    )


def _twincat_scope() -> VendorFile:
    """Beckhoff TwinCAT Scope export, tabs, decimal comma; seen: test data of the public package pytcs."""
    count, step = 400, 1e-3
    times = _comma(_plain(_times(0.0, 1.0, count), 9))
    drive, sensor = (_comma(_plain(v, 7)) for v in _slow(count, 60.0, 7.5, 0.001))
    pair = [
        ("Name", "Drive", "Position"),
        ("SymbolComment", "", ""),
        ("Data-Type", "REAL32", "REAL64"),
        ("SampleTime[ms]", "1", "1"),
        ("VariableSize", "4", "8"),
        ("SymbolBased", "True", "True"),
        ("IndexGroup", "16448", "16448"),
        ("IndexOffset", "385312", "385048"),
        ("SymbolName", "MAIN.fDrive", "MAIN.fPosition"),
        ("NetID", "192.168.178.20.1.1", "192.168.178.20.1.1"),
        ("Port", "851", "851"),
        ("Offset", "0", "0"),
        ("ScaleFactor", "1", "1"),
        ("BitMask", "0xffffffffffffffff", "0xffffffffffffffff"),
        ("Unit", "V (Voltage)", "µm (Length)"),
        ("Unit ScaleFactor", "1", "1"),
        ("Unit Offset", "0", "0"),
    ]
    lines = [
        "Name\tpiezo_loop",
        "File\tC:\\data\\piezo_loop.csv",
        "Starttime of export\t133625216967890000\tDienstag, 11. Juni 2024\t12:34:56.789",
        "Endtime of export\t133625216971880000\tDienstag, 11. Juni 2024\t12:34:57.188",
        "",
        "",
        *(f"{key}\t{first}\t{key}\t{second}" for key, first, second in pair),
        "",
        *_rows(times, drive, times, sensor, sep="\t"),
    ]
    return VendorFile(
        name="twincat_scope",
        vendor="Beckhoff",
        files={"piezo_loop.csv": _bytes(lines, encoding="utf-8")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        remark=SEEN
        + "Header of 23 rows, keys repeated per channel; a time column in ms before each channel whose name "
        "cell is the key 'Name'; units 'V (Voltage)' and 'µm (Length)' in UTF-8; decimal comma.",
    )


def _twincat_two_rates() -> VendorFile:
    """Beckhoff TwinCAT Scope with two sampling times; seen: test data of pytcs has 0.2, 1 and 5 ms side by side."""
    count = 400
    fast = _plain(_times(0.0, 0.2, count), 9)
    drive = _plain(_slow(count, 60.0, 7.5, 0.001)[0], 7)
    slow, sensor = _plain(_times(0.0, 1.0, count // 5), 9), _plain(_slow(count // 5, 60.0, 7.5, 0.001)[1], 7)
    rows = [f"{fast[row]}\t{drive[row]}" + (f"\t{slow[row]}\t{sensor[row]}" if row < len(slow) else "\t\t")
            for row in range(count)]  # fmt: skip
    lines = [
        "Name\tpiezo_rates",
        "",
        "Name\tDrive\tName\tPosition",
        "SampleTime[ms]\t0.2\tSampleTime[ms]\t1",
        "Unit\tV (Voltage)\tUnit\tµm (Length)",
        "",
        *rows,
    ]
    return VendorFile(
        name="twincat_two_rates",
        vendor="Beckhoff",
        files={"piezo_rates.csv": _bytes(lines, encoding="utf-8")},
        step_s=2e-4,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        refused="drive and sensor sampled at different intervals",
        remark=SEEN + "Header shortened. Rows pair samples of different times; the slower channel ends after a fifth.",
    )


def _labchart_text() -> VendorFile:
    """ADInstruments LabChart text export; seen: a file quoted in the documentation of phys2bids."""
    count, step = 400, 1e-3
    times = _plain(_times(0.0, step, count), 9)
    drive, sensor = (_plain(v, 7) for v in _slow(count, 9.0, 25.0, 0.003))
    rows = _rows(times, drive, sensor, sep="\t")
    rows[40] += "\t#* drive on "
    lines = [
        "Interval=\t0.001 s",
        "ExcelDateTime=\t4.5454524268391204e+04\t06/11/24 12:34:56.789000",
        "TimeFormat=\tStartOfBlock",
        "DateFormat=\t",
        "ChannelTitle=\tDrive\tPosition",
        "Range=\t10.000 V\t50.0 µm",
        "UnitName=\t*\tµm",
        "TopValue=\t*\t50.0",
        "BottomValue=\t*\t-50.0",
        *rows,
    ]
    return VendorFile(
        name="labchart_text",
        vendor="ADInstruments",
        files={"block1.txt": _bytes(lines, encoding="latin-1")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        remark=SEEN
        + "Keys end with '='; no name for the time column; the unit of the drive is only in Range (10.000 V), "
        "UnitName says *; one row carries a comment behind a tab; µ in Latin-1.",
    )


def _mcc_daqami() -> VendorFile:
    """Measurement Computing DAQami CSV with times of day; from memory of the program."""
    count, step = 400, 1e-3
    stamps = [_clock(45296.789 + step * row, 3, twelve=True) for row in range(count)]
    drive, sensor = (_cells(v, "%.6f") for v in _slow(count, 9.5, 4.2, 0.0005))
    lines = [
        "Device:,USB-1608FS-Plus",
        "Rate:,1000,Samples:,400",
        "",
        "Sample,Date/Time,AI0 (V),AI1 (V)",
        *_rows(_numbers(count, 1), [f"6/11/2024 {stamp}" for stamp in stamps], drive, sensor),
    ]
    return VendorFile(
        name="mcc_daqami",
        vendor="Measurement Computing",
        files={"daqami.csv": _bytes(lines)},
        step_s=step,
        start_s=math.nan,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "AI0 (V)", "sensor": "AI1 (V)"},
        remark=MEMORY
        + "Dates with times of day (12:34:56.789 PM). They step evenly by 1 ms, so the interval is certain "
        "and the file is to be read; a time of day is no start of a record. A header row holds two numbers.",
    )


def _clock(seconds: float, digits: int, twelve: bool = False) -> str:
    """A time of day such as 12:34:56.789, with PM after noon if `twelve`."""
    ticks = round(seconds * 10**digits)
    whole, part = divmod(ticks, 10**digits)
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if not twelve:
        return f"{hours:02d}:{minutes:02d}:{rest:02d}.{part:0{digits}d}"
    return f"{(hours - 1) % 12 + 1}:{minutes:02d}:{rest:02d}.{part:0{digits}d} {'PM' if hours >= 12 else 'AM'}"


def _dewesoft_text() -> VendorFile:
    """DEWESoft text export with relative times; from memory of the program."""
    count, step = 500, 5e-4
    times = _cells(_times(0.0, step, count), "%.6f")
    drive, sensor = (_cells(v, "%.6f") for v in _slow(count, 40.0, 3.1, 0.0008))
    lines = [
        "Data info",
        "File name: piezo_0001.dxd",
        "Start time: 11.6.2024 12:34:56.789",
        "Number of channels: 2",
        "Sample rate: 2000 Hz",
        "Store type: always fast",
        "Post time (sec): 0",
        "Pre time (sec): 0",
        "",
        "Events",
        "Event Type\tEvent\tTime",
        "1\tstoring started\t0.000",
        "2\tstoring stopped\t0.250",
        "",
        "Data1",
        "Time (s)\tAI 1/Drive (V)\tAI 2/Displacement (µm)",
        *_rows(times, drive, sensor, sep="\t"),
    ]
    return VendorFile(
        name="dewesoft_text",
        vendor="DEWESoft",
        files={"piezo_0001.txt": _bytes(lines, encoding="cp1252")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        remark=MEMORY + "A header of 16 rows with an event table whose rows look like data; µ in code page 1252.",
    )


def _dewesoft_clock() -> VendorFile:
    """DEWESoft text export with absolute times that have too few digits; from memory."""
    count, step = 500, 4e-4
    stamps = [_clock(45296.789 + step * row, 3) for row in range(count)]
    drive, sensor = (_cells(v, "%.6f") for v in _slow(count, 40.0, 3.1, 0.0008))
    lines = ["Time\tDrive (V)\tDisplacement (um)", *_rows(stamps, drive, sensor, sep="\t")]
    return VendorFile(
        name="dewesoft_clock",
        vendor="DEWESoft",
        files={"piezo_0002.txt": _bytes(lines)},
        step_s=step,
        start_s=math.nan,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        refused="times of day repeat: milliseconds are too coarse for the interval",
        remark=MEMORY + "12:34:56.789 stamps, two or three rows to each millisecond.",
    )


def _hbm_catman() -> VendorFile:
    """HBM catman ASCII, German; from memory of catmanEasy exports."""
    count, step = 500, 2e-3
    times = _comma(_cells(_times(0.0, step, count), "%.4f"))
    drive, sensor = (_comma(_cells(v, "%.6f")) for v in _slow(count, 58.0, 9.1, 0.002))
    lines = [
        "HBM_CATMAN_DATAFILE_40",
        "Kommentar: Piezo 07",
        "Anzahl Kanäle: 3",
        "",
        "Zeit  1 - Standardmessrate\tSpannung\tWeg",
        "s\tV\tµm",
        "T0 = 11.06.2024 12:34:56\tT0 = 11.06.2024 12:34:56\tT0 = 11.06.2024 12:34:56",
        "dt = 0,002 s\tdt = 0,002 s\tdt = 0,002 s",
        f"Werte: {count}\tWerte: {count}\tWerte: {count}",
        "",
        *_rows(times, drive, sensor, sep="\t", tail="\t"),
    ]
    return VendorFile(
        name="hbm_catman",
        vendor="HBM",
        files={"PIEZO07.ASC": _bytes(lines, encoding="latin-1")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="um",
        remark=MEMORY
        + "German names (Zeit, Spannung, Weg), a bare row of units, rows after the units that are no data, "
        "a tab at the end of each row, Latin-1, decimal comma.",
    )


def _campbell_toa5() -> VendorFile:
    """Campbell Scientific TOA5; seen: header rows of such files in many repositories."""
    count, step, missing = 400, 1e-2, 2
    stamps = [f'"2024-06-11 {_clock(45296.0 + step * row, 2).rstrip("0").rstrip(".")}"' for row in range(count)]
    drive, sensor = (_plain(v, 7) for v in _slow(count, 40.0, 2600.0, 1.5))
    sensor[:missing] = ['"NAN"'] * missing
    lines = [
        '"TOA5","CR1000X","CR1000X","12345","CR1000X.Std.05.02","CPU:piezo.CR1X","1234","Fast"',
        '"TIMESTAMP","RECORD","Drive","Displacement"',
        '"TS","RN","Volts","nm"',
        '"","","Smp","Smp"',
        *_rows(stamps, _numbers(count), drive, sensor),
    ]
    return VendorFile(
        name="campbell_toa5",
        vendor="Campbell Scientific",
        files={"CR1000X_Fast.dat": _bytes(lines)},
        step_s=step,
        start_s=math.nan,
        drive_V=_read(drive[missing:]),
        sensor=_read(sensor[missing:]),
        sensor_unit="nm",
        remark=SEEN
        + 'Quoted cells, four header rows, stamps of date and time in even steps of 10 ms (to be read), "NAN" '
        "for the first two samples of the sensor.",
    )


def _keyence_dashes() -> VendorFile:
    """Keyence data logger with a displacement sensor in mm; from memory, dashes for no value."""
    count, step, missing = 400, 5e-3, 5
    times = _cells(_times(0.0, step, count), "%.3f")
    drive, sensor = (
        _cells(v, form) for v, form in zip(_slow(count, 55.0, 0.0121, 2e-6), ("%+.3f", "%+.6f"), strict=True)
    )
    sensor[:missing] = ["----"] * missing
    lines = [
        "Model,LK-G5001",
        "Start,2024/06/11 12:34:56",
        "Interval,5,ms",
        "",
        "Time(s),CH1 Voltage,OUT1 Displacement",
        ",V,mm",
        *_rows(times, drive, sensor),
    ]
    return VendorFile(
        name="keyence_dashes",
        vendor="Keyence",
        files={"LOG00001.CSV": _bytes(lines)},
        step_s=step,
        start_s=float(times[missing]),
        drive_V=_read(drive[missing:]),
        sensor=_read(sensor[missing:], 1e3),
        sensor_unit="um",
        remark=MEMORY + "---- for the first five samples of the sensor; mm; signs before every number; the interval "
        "stands in the header as a number and a unit in two cells.",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Spreadsheets, MATLAB, Octave, NumPy
# ---------------------------------------------------------------------------------------------------------------------


def _excel_unicode_text() -> VendorFile:
    """Microsoft Excel 'Unicode text', German: UTF-16 with tabs; well known from the program itself."""
    count, step = 400, 1e-5
    times = _comma(_plain(_times(0.0, 10.0, count), 9))
    drive, sensor = (_comma(_plain(v, 6)) for v in _fast(count, step, 40.0, 320.0, (0.05, 0.25)))
    lines = ["Zeit (µs)\tSpannung (V)\tAuslenkung (nm)", *_rows(times, drive, sensor, sep="\t")]
    return VendorFile(
        name="excel_unicode_text",
        vendor="Microsoft Excel",
        files={"Messung.txt": "\ufeff".encode("utf-16-le") + _bytes(lines, encoding="utf-16-le")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="nm",
        remark=TOLD + "UTF-16 (little-endian) with a byte-order mark, tabs, decimal comma, times in µs.",
    )


def _excel_trailing_commas() -> VendorFile:
    """A table saved by Excel as CSV, with emptied rows at its end; seen: the sample DS1052E of RigolWFM ends so."""
    count, step = 400, 1e-3
    times = _plain(_times(0.0, 1.0, count), 9)
    drive, sensor = (_plain(v, 6) for v in _slow(count, 40.0, 2400.0, 1.0))
    lines = ["Time (ms),Voltage (V),Displacement (nm),", *_rows(times, drive, sensor, tail=","), ",,,", ",,,"]
    return VendorFile(
        name="excel_trailing_commas",
        vendor="Microsoft Excel",
        files={"table.csv": _bytes(lines, encoding="utf-8-sig")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="nm",
        remark=TOLD + "Two rows of commas at the end, an empty fourth column, UTF-8 with a byte-order mark, ms.",
    )


def _excel_xy_loop() -> VendorFile:
    """An X-Y table of a hysteresis loop, without times; made up in a common style."""
    drive, sensor = (_plain(v, 6) for v in _slow(400, 40.0, 2400.0, 1.0))
    return VendorFile(
        name="excel_xy_loop",
        vendor="Microsoft Excel",
        files={"loop_xy.csv": _bytes(["Voltage [V],Displacement [nm]", *_rows(drive, sensor)])},
        step_s=math.nan,
        start_s=math.nan,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="nm",
        refused="no times and no interval: an X-Y table",
        remark=TOLD + "Roles are clear, time is not. With a stated interval the same table could be read.",
    )


def _excel_times_differ() -> VendorFile:
    """A table pasted together from two exports whose time columns do not agree; made up in a common style."""
    count, step = 400, 1e-6
    drive, sensor = (_plain(v, 6) for v in _fast(count, step, 40.0, 0.8, (0.4, 0.02)))
    first, second = _plain(_times(0.0, step, count), 9), _plain(_times(3.5e-5, step, count), 9)
    lines = ["t1 (s),ch1 (V),t2 (s),ch2 (V)", *_rows(first, drive, second, sensor)]
    return VendorFile(
        name="excel_times_differ",
        vendor="Microsoft Excel",
        files={"pasted.csv": _bytes(lines)},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        columns={"drive": "ch1 (V)", "sensor": "ch2 (V)"},
        refused="two time columns that do not agree",
        remark=TOLD + "The sensor's times are 35 samples later than the drive's in the same row.",
    )


def _matlab_writetable() -> VendorFile:
    """MATLAB writetable with names input and output; known from the function's documentation."""
    count, step = 400, 1e-4
    times = _cells(_times(0.0, step, count), "%.15g")
    drive, sensor = (_cells(v, "%.15g") for v in _slow(count, 30.0, 1.9, 0.001))
    return VendorFile(
        name="matlab_writetable",
        vendor="MathWorks",
        files={"sweep.csv": _bytes(["time,input,output", *_rows(times, drive, sensor)], end="\n")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(drive),
        sensor=_read(sensor),
        sensor_unit="V",
        remark=TOLD + "No units: seconds and volts.",
    )


def _matlab_ascii() -> VendorFile:
    """MATLAB save -ascii: numbers set apart by blanks, three blanks first; known from the function's documentation."""
    count, step = 400, 2e-6
    drive, sensor = _fast(count, step, 40.0, 0.9, (0.4, 0.02))
    columns = [_cells(values, "%.7e") for values in (_times(0.0, step, count), drive, sensor)]
    padded = [[cell if cell.startswith("-") else f" {cell}" for cell in cells] for cells in columns]
    return VendorFile(
        name="matlab_ascii",
        vendor="MathWorks",
        files={"trace.txt": _bytes(_rows(*padded, sep="  ", head="  "), end="\n")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(columns[1]),
        sensor=_read(columns[2]),
        sensor_unit="V",
        columns={"drive": "2", "sensor": "3"},
        remark=TOLD + "No header; blanks at the start of each row; two or three blanks between numbers.",
    )


def _octave_text() -> VendorFile:
    """Octave save -text with variables t, u and y; seen: the format described and quoted in several repositories."""
    count, step = 300, 5e-6
    names = ("t", "u", "y")
    values = (_times(0.0, step, count), *_fast(count, step, 40.0, 1.4, (0.4, 0.02)))
    columns = [_cells(v, "%.16g") for v in values]
    lines = ["# Created by Octave 8.4.0, Tue Jun 11 12:34:56 2024 CEST <lab@bench>"]
    for name, cells in zip(names, columns, strict=True):
        lines += [f"# name: {name}", "# type: matrix", f"# rows: {count}", "# columns: 1"]
        lines += [f" {cell}" for cell in cells] + ["", ""]
    return VendorFile(
        name="octave_text",
        vendor="GNU Octave",
        files={"data.txt": _bytes(lines, end="\n")},
        step_s=step,
        start_s=0.0,
        drive_V=_read(columns[1]),
        sensor=_read(columns[2]),
        sensor_unit="V",
        remark=SEEN + "Three variables one below the other, each with its own comment lines: a reader of tables that "
        "strings them together gets one column of 900 rows; one that does not know the format should refuse.",
    )


def _mat_bytes(variables: dict[str, object]) -> bytes:
    """A MATLAB v5 file with a fixed date in its first 116 bytes, so that its bytes are always the same."""
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, variables)
    label = b"MATLAB 5.0 MAT-file, Platform: PCWIN64, Created on: Tue Jun 11 12:34:56 2024"
    return label.ljust(116) + buffer.getvalue()[116:]


def _matlab_mat_times() -> VendorFile:
    """MATLAB v5 .mat with t, u, y as columns, written by scipy.io.savemat."""
    count, step = 400, 1e-6
    drive, sensor = _fast(count, step, 40.0, 0.9, (0.4, 0.02))
    times = _times(-1e-4, step, count)
    content = {"t": times[:, None], "u": drive[:, None], "y": sensor[:, None]}
    return VendorFile(
        name="matlab_mat_times",
        vendor="MathWorks",
        files={"pulse.mat": _mat_bytes(content)},
        step_s=step,
        start_s=float(times[0]),
        drive_V=drive,
        sensor=sensor,
        sensor_unit="V",
        remark=TOLD + "Column vectors named t, u, y; no units: seconds and volts.",
    )


def _matlab_mat_rate() -> VendorFile:
    """MATLAB v5 .mat with Fs instead of times, and rows instead of columns, written by scipy.io.savemat."""
    count, rate = 400, 2e6
    drive, sensor = _fast(count, 1.0 / rate, 40.0, 0.9, (0.4, 0.02))
    return VendorFile(
        name="matlab_mat_rate",
        vendor="MathWorks",
        files={"pulse_fs.mat": _mat_bytes({"Fs": rate, "u": drive[None, :], "y": sensor[None, :], "note": "nozzle 7"})},
        step_s=1.0 / rate,
        start_s=math.nan,
        drive_V=drive,
        sensor=sensor,
        sensor_unit="V",
        remark=TOLD + "Fs is the sample rate in Hz; a text variable beside it.",
    )


def _numpy_npz() -> VendorFile:
    """NumPy .npz with time_s, drive_V and sensor."""
    count, step = 500, 1e-6
    drive, sensor = _fast(count, step, 40.0, 0.9, (0.4, 0.02))
    times = _times(-1e-4, step, count)
    buffer = io.BytesIO()
    np.savez(buffer, time_s=times, drive_V=drive, sensor=sensor)
    return VendorFile(
        name="numpy_npz",
        vendor="NumPy",
        files={"record.npz": buffer.getvalue()},
        step_s=step,
        start_s=float(times[0]),
        drive_V=drive,
        sensor=sensor,
        sensor_unit="V",
        remark=TOLD + "Named arrays.",
    )


def _numpy_npy() -> VendorFile:
    """NumPy .npy, two-dimensional: time, drive, sensor in columns."""
    count, step = 500, 1e-6
    drive, sensor = _fast(count, step, 40.0, 0.9, (0.4, 0.02))
    times = _times(0.0, step, count)
    buffer = io.BytesIO()
    np.save(buffer, np.column_stack([times, drive, sensor]))
    return VendorFile(
        name="numpy_npy",
        vendor="NumPy",
        files={"record.npy": buffer.getvalue()},
        step_s=step,
        start_s=0.0,
        drive_V=drive,
        sensor=sensor,
        sensor_unit="V",
        columns={"drive": "2", "sensor": "3"},
        remark=TOLD + "No names: three columns, the first of them times.",
    )


_STYLES: tuple[Callable[[], VendorFile], ...] = (
    _rigol_ds1000z_memory,
    _rigol_mso1000z_pods,
    _rigol_ds1102e_delayed,
    _rigol_ds1204b,
    _rigol_ds4000_late_index,
    _rigol_ds1052e_quoted,
    _rigol_ds1102d_rounded_times,
    _rigol_mso5000_memory,
    _rigol_mso5000_repeating_times,
    _siglent_sds1104x_u,
    _siglent_bin2csv,
    _siglent_menu_save,
    _atten_ads1202cl,
    _tektronix_tds2000,
    _tektronix_mso2000_peak_detect,
    _tektronix_mdo3000_digital,
    _tektronix_mso4_math,
    _keysight_infiniivision_blank_start,
    _keysight_infiniium_header,
    _keysight_overrange_start,
    _keysight_current,
    _keysight_segments,
    _keysight_fra,
    _lecroy_hdo,
    _lecroy_math,
    _lecroy_semicolons,
    _lecroy_wavejet,
    _picoscope_mv,
    _picoscope_german,
    _picoscope_french,
    _picoscope_gzip,
    _picoscope_overrange_middle,
    _picoscope_spectrum,
    _rs_rtb2000,
    _rs_rto_values_only,
    _rs_rtp_no_names,
    _rs_rth1004,
    _yokogawa_dl850,
    _yokogawa_time_per_channel,
    _owon_hds200,
    _owon_descending,
    _hantek_dso5000,
    _openhantek,
    _gwinstek_detail,
    _gwinstek_fast,
    _micsig_tbook,
    _labview_lvm_comma,
    _labview_lvm_multi_x,
    _labview_spreadsheet,
    _digilent_waveforms,
    _digilent_spectrum,
    _moku_go,
    _saleae_logic2,
    _sigrok_cli,
    _scopy_m2k,
    _red_pitaya_acquire,
    _polytec_displacement,
    _polytec_velocity,
    _sios_interferometer,
    _attocube_ids,
    _pi_gcs_voltage,
    _pi_gcs_command_position,
    _dspace_controldesk,
    _zurich_labone_ticks,
    _twincat_scope,
    _twincat_two_rates,
    _labchart_text,
    _mcc_daqami,
    _dewesoft_text,
    _dewesoft_clock,
    _hbm_catman,
    _campbell_toa5,
    _keyence_dashes,
    _excel_unicode_text,
    _excel_trailing_commas,
    _excel_xy_loop,
    _excel_times_differ,
    _matlab_writetable,
    _matlab_ascii,
    _octave_text,
    _matlab_mat_times,
    _matlab_mat_rate,
    _numpy_npz,
    _numpy_npy,
)


def vendor_files() -> list[VendorFile]:
    """All styles, each written anew; two of them need scipy to write MATLAB files."""
    return [style() for style in _STYLES]
