"""Units as instruments print them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
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
_SPELLINGS = {
    "s S sec secs second seconds Sek Sekunde Sekunden secondes segundos с": _SECOND,
    "ms msec msecs millis millisec millisecond milliseconds Millisekunden мс": Unit("s", over=1e3),
    "us usec usecs micros microsec microsecond microseconds Mikrosekunden мкс": Unit("s", over=1e6),
    "ns nsec nsecs nanos nanosecond nanoseconds Nanosekunden нс": Unit("s", over=1e9),
    "ps picosecond picoseconds": Unit("s", over=1e12),
    "min minute minutes": _MINUTE,
    "V v volt volts Vdc Vac В": _VOLT,
    "mV mv mvolt mvolts millivolt millivolts мВ": Unit("V", over=1e3),
    "uV uvolt uvolts microvolt microvolts": Unit("V", over=1e6),
    "kV KV kilovolt kilovolts кВ": Unit("V", times=1e3),
    "um micron microns micrometer micrometre micrometers micrometres мкм": _MICROMETRE,
    "nm nanometer nanometre nanometers nanometres нм": _NANOMETRE,
    "pm picometer picometre picometers picometres": Unit("nm", over=1e3),
    "mm millimeter millimetre millimeters millimetres": Unit("um", times=1e3),
    "cm centimeter centimetre centimeters centimetres": Unit("um", times=1e4),
    "m meter metre meters metres": Unit("um", times=1e6),
}
_UNITS = {word: unit for words, unit in _SPELLINGS.items() for word in words.split()}
_LETTERS = {"Âµ": "u", "Î¼": "u", "&micro;": "u", "µ": "u", "μ": "u"}
"""Ways in which the letter for a millionth arrives: two of its codes, and the first read as Latin-1."""
_SPELLED = ("sec", "volt", "uvolt", "mvolt", "met", "micro", "milli", "nano", "pico", "centi", "kilo", "min")
NO_UNIT = ("", "-", "--", "none", "n/a", "[]", "()", "1")
"""What stands for no unit, in lower case."""
_UNIT_LIKE = re.compile(
    r"(x\s*1\d*\s*|1\s*e\s*[-+]?\d+\s*|10\s*(\^\s*)?[-+\u2212]\s*\d+\s*|10\^\d+\s*|\?|\ufffd|\u00e6|\u00c2?[\u00b5\u03bc]|milli|micro"
    r"|nano|pico|kilo|mega|centi|mu|[munpkcdg])?"
    r"[-\s]?(s|secs?|seconds?|v|volts?|vpp|vrms|met(er|re)s?|m|Å|angstroms?|min(ute)?s?|h|hours?|days?)"
    r"([-\s]*(dc|ac|pp|p-p|rms|peak))?",
    re.IGNORECASE,
)
"""What can only be meant as a unit of time, voltage or length, known or not."""
_BRACKETED = re.compile(r"[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
_NODE = re.compile(r"^([VI])\([^()]+\)$", re.IGNORECASE)
_REMARK = re.compile(
    r"(ch(an(nel)?)?|plot|trace|axis|out(put)?|in(put)?|port|probe|math|ref|demod)?[ _.#:]*\w?\d{0,3}|raw|(un)?filtered"
    r"|trigger|drive|sensor|monitor|neighbou?r|(strain )?gauge|command|response|rel(ative)?|abs(olute)?|avg|mean"
    r"|average|min|max|low|high|top|bottom|left|right|real|imag|x\d+|\d+x|\d+:\d+",
    re.IGNORECASE,
)
"""What may stand in brackets and is no unit."""
_AFTER_SLASH = re.compile(r"^[^/]*[^/\s]\s*/\s*([^\s/]{1,12})$")
_AFTER_IN = re.compile(r"(?:^|\s)in\s+([^\s()\[\]]{1,12})$", re.IGNORECASE)
_WORDS = re.compile(r"[0-9.]*[0-9]|[^\W\d_]+|\S", re.UNICODE)
_SETTING = re.compile(r"(?:^|[\s_])[-+]?\d[\d.,]*[\s_]*[^\W\d_]+$")
"""A number with its unit at the end of a name, such as ``at 200 mV``: no unit of the column."""
_CAMEL = re.compile(r"(?<=[a-z]{3})(?=[A-Z])|(?<=[a-z]In)(?=[A-Z])")
_TIME_IN = re.compile(r"^t([mun\u00b5]?s)$")
_RIGOL_CHANNEL = re.compile(r"^CH\d+([VAWU])$")
_OF_TIME = re.compile(r"time|zeit|temps|tiempo|tempo|clock|stamp|^t$", re.IGNORECASE)
_PREFIXES = "fpnuµμmkKMG"
_OTHER_UNIT = re.compile(
    rf"[{_PREFIXES}]?(A|N|Pa|Hz|W|J|C|F|H|T|g|bar|psi|Ohm|ohm|Ω|m/s|m/s2|m/s²|m/s\^2|g|rad|V/us|V/µs|C/s|S|l/min)"
    r"|amps?|(milli|micro|nano|kilo)?(amperes?|hertz|newtons?|pascals?|ohms?)|deg(ree)?s?|°C?|degC|%|dB\w*|a\.?u\.?"
    r"|counts?|LSB|bits?|samples?|pts?|points?|in(ch)?|ft|thou|mil|.*(/|\^|²|³|·).*"
)
"""Units of other quantities than time, voltage and length."""
_OTHER_SUFFIX = re.compile(
    rf"[{_PREFIXES}](A|N|Pa|Hz|W|J)|Hz|Pa|bar|psi|ohm|degC|ampere|newtons?|counts|LSB", re.IGNORECASE
)
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


def other_unit(printed: str) -> bool:
    """Whether a cell is a unit of another quantity, as far as those are known: ``A``, ``Ampere``, ``%``, ``counts``."""
    text = _plain(printed)
    return (_OTHER_UNIT.fullmatch(text) or _OTHER_SUFFIX.fullmatch(text)) is not None or text.lower() == "unknown"


def _plain(printed: str) -> str:
    text = _readable(printed).strip("()[]{}<>").strip(" .*")
    return re.sub(r"(?<=i)-(?=[a-z])", "", text)  # milli-seconds


def _readable(text: str) -> str:
    """A text with the letter for a millionth as u, and wide letters and brackets as plain ones."""
    for way, letter in _LETTERS.items():
        text = text.replace(way, letter)
    return unicodedata.normalize("NFKC", text).replace("\u03bc", "u").strip()


def unit_in_name(name: str) -> Unit | str | None:
    """Unit in the name of a column, as in ``Time (ms)``, ``U/mV``, ``C1 in V`` or ``drive_V``; None if there is none.

    A unit that is not known is returned as printed, and so are two that differ.

    Examples
    --------
    >>> unit_in_name("Channel A (mV)"), unit_in_name("current_mA"), unit_in_name("X(CH1)"), unit_in_name("Drive (MV)")
    (Unit(base='V', times=1.0, over=1000.0), 'mA', None, 'MV')
    >>> unit_in_name("Time.ms"), unit_in_name("Sensor (V) [mV]"), unit_in_name("Sensor at 200 mV"), unit_in_name("V_m")
    (Unit(base='s', times=1.0, over=1000.0), 'V and mV', None, None)
    """
    name = _readable(name)
    if node := _NODE.match(name):  # a circuit simulator's voltage or current at a node
        return _VOLT if node.group(1) in "Vv" else "A"
    if rigol := _RIGOL_CHANNEL.match(name):
        return known_unit(rigol.group(1)) or rigol.group(1)
    if time_in := _TIME_IN.match(name):  # tms
        return known_unit(time_in.group(1))
    found = [*_bracketed_units(name), *_trailing_units(_BRACKETED.sub(" ", name).strip())]
    known = list(dict.fromkeys(one for one in found if isinstance(one[1], Unit)))
    if len({unit for _, unit in known}) > 1:
        return " and ".join(dict.fromkeys(text for text, _ in known))
    if known:
        return known[0][1]
    return next((text for text, _ in found), None)


def _bracketed_units(name: str) -> list[tuple[str, Unit | None]]:
    """Texts in the brackets of a name that are units, and what they are; None where they are not known."""
    found: list[tuple[str, Unit | None]] = []
    for inner in _BRACKETED.findall(name):
        for part in re.split(r"[,;]", inner):
            text = re.sub(r"^in\s+", "", part.strip(" .*"))
            unit = known_unit(text)
            setting = re.match(r"[-+]?\d[\d.]*\s*[^\W\d]", text) and not unit_like(text)
            if text.lower() in NO_UNIT or setting or (unit == _MINUTE and not _OF_TIME.search(name)):
                continue
            if unit or other_unit(text) or unit_like(text) or not _REMARK.fullmatch(text):
                found.append((text, unit))
    return found


def _trailing_units(name: str) -> list[tuple[str, Unit | None]]:
    """The unit at the end or the start of a name without its brackets, and what it is."""
    if len(name) > 1 and (unit := known_unit(name)) is not None:
        return [(name, unit)] if unit != _VOLT and unit != _MINUTE else []
    for pattern in (_AFTER_IN, _AFTER_SLASH):
        if found := pattern.search(name):
            text, unit = found.group(1), known_unit(found.group(1))
            if unit or other_unit(text) or (len(text) > 1 and unit_like(text)):
                return [(text, unit)]
    if _SETTING.search(name):
        return []
    words = _WORDS.findall(_CAMEL.sub(" ", name))
    letters = [k for k, word in enumerate(words) if word[0].isalpha()]
    if len(letters) < 2:
        return []
    last, first = letters[-1], letters[0]
    if last >= len(words) - 3:
        text, stem = words[last], [words[k] for k in letters[:-1]]
        if unit := _written_as_unit(text, stem):
            return [(text, unit)]
        if _OTHER_SUFFIX.fullmatch(text) or (len(text) > 1 and unit_like(text)):
            return [(text, None)]
        if text in "hd" and _OF_TIME.search(" ".join(stem)):
            return [(text, None)]
    text = words[first]
    unit = known_unit(text) if len(text) > 1 else None
    if unit is None or unit in (_VOLT, _SECOND) or (unit == _MINUTE and not _OF_TIME.search(name)):
        return []
    return [(text, unit)]


def _written_as_unit(word: str, stem: Sequence[str]) -> Unit | None:
    """The unit that the last word of a name is, if what stands before it is more than a letter."""
    unit = known_unit(word) or (
        known_unit(word[0].lower() + word[1:].replace("v", "V")) if word[:1].isupper() and word[1:].islower() else None
    )
    of_time = _OF_TIME.search(" ".join(stem)) is not None
    if unit == _MINUTE and not of_time:
        return None
    if len(word) > 1 or word in "Vv":
        return unit
    several = len(stem) > 1 or len(stem[-1]) > 1
    return unit if word in "sm" and (several or of_time) else None


def seconds(text: str) -> float | None:
    """A time with its unit, as ``0.50uS`` or ``5e-07``, in seconds; None if it is none."""
    return _quantity(text, {"": 1.0} | {name: u.times / u.over for name, u in _UNITS.items() if u.base == "s"})


def hertz(text: str) -> float | None:
    """A sampling rate with its unit, as ``2.5 GSa/s`` or ``48000``, in hertz; None if it is none."""
    if "mHz" in text:
        return None  # mega, as some print it, or milli
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
