"""Units as instruments print them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from inkjet_env.typing import Real


@dataclass(frozen=True)
class Unit:
    """A printed unit.

    Parameters
    ----------
    base : {"s", "V", "um", "nm"}
        Unit to which values are converted.
    times, over : float
        Factor and divisor of a printed value; one of them is 1, so that 0.1 ms becomes the number nearest to 0.0001 s.
    """

    base: str
    times: float = 1.0
    over: float = 1.0

    def to_base(self, values: Real) -> Real:
        """Values in ``base``, same shape; the same array if there is nothing to convert."""
        if self.times == self.over:
            return values
        converted: Real = values * self.times / self.over
        converted.flags.writeable = False
        return converted


_SECOND, _MINUTE, _VOLT, _MICROMETRE, _NANOMETRE = Unit("s"), Unit("s", times=60.0), Unit("V"), Unit("um"), Unit("nm")
_UNITS = {
    **dict.fromkeys(("s", "S", "sec", "secs", "second", "seconds"), _SECOND),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisec", "millisecond", "milliseconds"), Unit("s", over=1e3)),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microsec", "microsecond", "microseconds"), Unit("s", over=1e6)),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"), Unit("s", over=1e9)),
    **dict.fromkeys(("ps", "picosecond", "picoseconds"), Unit("s", over=1e12)),
    **dict.fromkeys(("min", "minute", "minutes"), _MINUTE),
    **dict.fromkeys(("V", "v", "volt", "volts", "Vdc", "Vac"), _VOLT),
    **dict.fromkeys(("mV", "mv", "mvolt", "mvolts", "millivolt", "millivolts"), Unit("V", over=1e3)),
    **dict.fromkeys(("uV", "microvolt", "microvolts"), Unit("V", over=1e6)),
    **dict.fromkeys(("kV", "KV", "kilovolt", "kilovolts"), Unit("V", times=1e3)),
    **dict.fromkeys(("um", "micron", "microns", "micrometer", "micrometre", "micrometers", "micrometres"), _MICROMETRE),
    **dict.fromkeys(("nm", "nanometer", "nanometre", "nanometers", "nanometres"), _NANOMETRE),
    **dict.fromkeys(("pm", "picometer", "picometre", "picometers", "picometres"), Unit("nm", over=1e3)),
    **dict.fromkeys(("mm", "millimeter", "millimetre", "millimeters", "millimetres"), Unit("um", times=1e3)),
    **dict.fromkeys(("cm", "centimeter", "centimetre", "centimeters", "centimetres"), Unit("um", times=1e4)),
    **dict.fromkeys(("m", "meter", "metre", "meters", "metres"), Unit("um", times=1e6)),
}
_LETTERS = {"Âµ": "u", "µ": "u", "μ": "u"}
"""Ways in which the letter for a millionth arrives: two of its codes, and the first read as Latin-1."""
_SPELLED = ("sec", "volt", "met", "micro", "milli", "nano", "pico", "centi", "kilo", "min")
NO_UNIT = ("", "-", "--", "none", "n/a", "[]", "()", "1")
"""What stands for no unit, in lower case."""
_UNIT_LIKE = re.compile(
    r"(x?\s*1(0\s*\^?|e)?\s*[-+]?\d*\s*[*·x]?|\?|æ|Â?[µμ]|milli|micro|nano|pico|kilo|mega|centi|mu|[munpkcdg])?"
    r"[-\s]?(s|secs?|seconds?|v|volts?|vpp|vrms|met(er|re)s?|m|Å|angstroms?|min(ute)?s?|h|hours?|days?)"
    r"([-\s]*(dc|ac|pp|p-p|rms|peak))?",
    re.IGNORECASE,
)
"""What can only be meant as a unit of time, voltage or length, known or not."""
_BRACKETED = re.compile(r"(?<!^[VvIi])[(\[{<]\s*([^()\[\]{}<>]*?)\s*[)\]}>]")
_NODE = re.compile(r"^([VI])\(.+\)$", re.IGNORECASE)
_AFTER_IN = re.compile(r"(?:^|\s)in\s+([^\s()\[\]]+)$", re.IGNORECASE)
_AFTER_SLASH = re.compile(r"^[^/]*[^/\s]\s*/\s*([^\s/]{1,12})$")
_LAST_WORD = re.compile(r"[^\s,;:-](?:\s*[,;:]\s*|\s+-\s*|-|\s+)([^\s,;:-]{1,12}(?:[-\s](?:DC|AC|dc|ac))?)$")
_SUFFIXED = re.compile(r"_([A-Za-zµμ]{1,12})$")
_CAMEL = re.compile(r"[a-z](Ms|Us|Ns|Ps|Mv|MV|Uv|Kv|Um|Nm|V)$")
_RIGOL_CHANNEL = re.compile(r"^CH\d+(V)$")
_PREFIXES = "fpnuµμmkKMG"
_OTHER_UNIT = re.compile(
    rf"[{_PREFIXES}]?(A|N|Pa|Hz|W|J|C|F|H|T|g|bar|psi|Ohm|ohm|Ω|m/s|m/s2|m/s²|m/s\^2|g|rad|V/us|V/µs|C/s|S|l/min)"
    r"|amps?|(milli|micro|nano|kilo)?(amperes?|hertz|newtons?|pascals?|ohms?)|deg(ree)?s?|°C?|degC|%|dB\w*|a\.?u\.?"
    r"|counts?|LSB|bits?|samples?|pts?|points?|in(ch)?|ft|thou|mil|.*(/|\^|²|³|·).*"
)
"""Units of other quantities than time, voltage and length."""
_OTHER_SUFFIX = re.compile(rf"[{_PREFIXES}](A|N|Pa|Hz|W|J)|Hz|Pa|bar|psi|ohm|degC")
"""Those that are meant where they end a name: ``channel_A`` is no current."""


def known_unit(printed: str) -> Unit | None:
    """Unit denoted by a cell such as ``ms``, ``(mV)`` or ``Volt``, or None.

    Examples
    --------
    >>> known_unit("(µs)"), known_unit("Volts DC")
    (Unit(base='s', times=1.0, over=1000000.0), Unit(base='V', times=1.0, over=1.0))
    """
    text = _plain(printed)
    text = re.sub(r"(?<=[Vvt])s?[-\s]?(DC|AC|dc|ac)$", "", text)
    return _UNITS.get(text) or (
        _UNITS.get(text.lower()) if text.lower().startswith(_SPELLED) or len(text) > 3 else None
    )


def unit_like(printed: str) -> bool:
    """Whether a cell can only be meant as a unit of time, voltage or length, known or not.

    Examples
    --------
    >>> [unit_like(cell) for cell in ("ms", "MV", "?s", "1e-6 s", "mVpp", "raw", "CH1")]
    [True, True, True, True, True, False, False]
    """
    return _UNIT_LIKE.fullmatch(printed.strip().strip("()[]{}<>").strip()) is not None


def _plain(printed: str) -> str:
    text = printed.strip().strip("()[]{}<>").strip()
    for way, letter in _LETTERS.items():
        text = text.replace(way, letter)
    return re.sub(r"(?<=i)-(?=[a-z])", "", text)  # milli-seconds


def unit_in_name(name: str) -> Unit | str | None:
    """Unit in the name of a column, as in ``Time (ms)``, ``U/mV``, ``C1 in V`` or ``drive_V``; None if there is none.

    A unit that is not known is returned as printed.

    Examples
    --------
    >>> unit_in_name("Channel A (mV)"), unit_in_name("current_mA"), unit_in_name("X(CH1)"), unit_in_name("Drive (MV)")
    (Unit(base='V', times=1.0, over=1000.0), 'mA', None, 'MV')
    """
    found = _unit_in_name(name.strip())
    smallest = found == _MINUTE and re.search(r"time|^t\b", name, re.IGNORECASE) is None
    return None if smallest else found  # "CH1 min" is no time


def _unit_in_name(name: str) -> Unit | str | None:
    if node := _NODE.match(name):  # a circuit simulator's voltage or current at a node
        return _VOLT if node.group(1) in "Vv" else "A"
    if len(name) > 1 and (unit := known_unit(name)) is not None:
        return unit
    bracketed = _BRACKETED.findall(name)
    for text in bracketed:
        if unit := known_unit(text):
            return unit
        if _OTHER_UNIT.fullmatch(text) or unit_like(text):
            return str(text)
    if bracketed:
        return None
    for pattern, others in ((_AFTER_IN, _OTHER_UNIT), (_AFTER_SLASH, _OTHER_UNIT), (_SUFFIXED, _OTHER_SUFFIX)):
        if found := pattern.search(name):
            text, stem = found.group(1), name[: found.start(1)].strip("_/ ")
            if len(text) == 1 and len(stem) == 1 and stem not in "tTUVu":
                continue
            if len(stem) == 1 and stem in "UVIuvi" and known_unit(text) == _SECOND:
                continue  # V_s is the voltage of a sensor
            if unit := known_unit(text):
                return unit
            if others.fullmatch(text) or (len(text) > 1 and unit_like(text)):
                return text
    found = _LAST_WORD.search(name)
    if found and (len(found.group(1)) > 1 or found.group(1) in "sVv"):
        if unit := known_unit(found.group(1)):
            return unit
        if _OTHER_SUFFIX.fullmatch(found.group(1)) or (len(found.group(1)) > 1 and unit_like(found.group(1))):
            return found.group(1)
    if found := _CAMEL.search(name):
        text = found.group(1)
        return text if text == "MV" else _UNITS[text[0].lower() + text[1:].replace("v", "V") if len(text) > 1 else text]
    return _VOLT if _RIGOL_CHANNEL.match(name) else None


def seconds(text: str) -> float | None:
    """A time with its unit, as ``0.50uS`` or ``5e-07``, in seconds; None if it is none."""
    return _quantity(text, {"": 1.0} | {name: u.times / u.over for name, u in _UNITS.items() if u.base == "s"})


def hertz(text: str) -> float | None:
    """A sampling rate with its unit, as ``2.5 GSa/s`` or ``48000``, in hertz; None if it is none."""
    names = ("", "hz", "s/s", "s/sec", "sa/s", "sa/sec", "samples/s", "samples/sec", "samples/second", "sps")
    return _quantity(text.lower(), {f"{prefix}{name}": factor for prefix, factor in _RATES for name in names})


_RATES = (("", 1.0), ("k", 1e3), ("m", 1e6), ("g", 1e9))
_QUANTITY = re.compile(r"(?:[A-Za-z]+\s*:\s*)?([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([^\s0-9]*)")


def _quantity(text: str, units: Mapping[str, float]) -> float | None:
    found = _QUANTITY.fullmatch(text.strip())
    if found is None:
        return None
    unit = found.group(2).replace("µ", "u").replace("μ", "u")
    factor = units.get(unit, units.get(unit.lower()))
    try:
        return None if factor is None else float(found.group(1)) * factor
    except ValueError:
        return None
