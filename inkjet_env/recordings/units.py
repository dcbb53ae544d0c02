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
        return values if self.times == self.over else values * self.times / self.over


_SECOND, _VOLT, _MICROMETRE, _NANOMETRE = Unit("s"), Unit("V"), Unit("um"), Unit("nm")
_UNITS = {
    **dict.fromkeys(("s", "S", "sec", "secs", "second", "seconds"), _SECOND),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), Unit("s", over=1e3)),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds"), Unit("s", over=1e6)),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), Unit("s", over=1e9)),
    **dict.fromkeys(("V", "v", "volt", "volts"), _VOLT),
    **dict.fromkeys(("mV", "millivolt", "millivolts"), Unit("V", over=1e3)),
    **dict.fromkeys(("uV", "microvolt", "microvolts"), Unit("V", over=1e6)),
    **dict.fromkeys(("kV", "kilovolt", "kilovolts"), Unit("V", times=1e3)),
    **dict.fromkeys(("um", "micron", "microns", "micrometer", "micrometre"), _MICROMETRE),
    **dict.fromkeys(("nm", "nanometer", "nanometre"), _NANOMETRE),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), Unit("um", times=1e3)),
    **dict.fromkeys(("m", "meter", "metre"), Unit("um", times=1e6)),
}
_BRACKETED = re.compile(r"\s*[(\[{]\s*([^()\[\]{}]+?)\s*[)\]}]\s*$")
_AFTER_IN = re.compile(r"(?:^|\s)in\s+([^\s()\[\]]+)$", re.IGNORECASE)
_AFTER_SLASH = re.compile(r"\s/\s*([A-Za-zµμ]{1,3})$")
_SUFFIXED = re.compile(r"_([A-Za-zµμ]{1,4})$")
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
    >>> known_unit("(µs)")
    Unit(base='s', times=1.0, over=1000000.0)
    """
    text = printed.strip().strip("()[]").strip().replace("µ", "u").replace("μ", "u")
    return _UNITS.get(text) or (_UNITS.get(text.lower()) if len(text) > 2 else None)


def unit_in_name(name: str) -> Unit | str | None:
    """Unit in the name of a column, as in ``Time (ms)``, ``C1 in V``, ``drive_V`` or ``CH1V``; None if there is none.

    A unit that is not known is returned as printed.

    Examples
    --------
    >>> unit_in_name("Channel A (mV)"), unit_in_name("current_mA"), unit_in_name("X(CH1)")
    (Unit(base='V', times=1.0, over=1000.0), 'mA', None)
    """
    for pattern in (_BRACKETED, _AFTER_IN, _AFTER_SLASH, _SUFFIXED, _RIGOL_CHANNEL):
        found = pattern.search(name)
        if found is None:
            continue
        if unit := known_unit(found.group(1)):
            return unit
        if (_OTHER_SUFFIX if pattern is _SUFFIXED else _OTHER_UNIT).fullmatch(found.group(1)):
            return found.group(1)
    return None


def seconds(text: str) -> float | None:
    """A time with its unit, as ``0.50uS`` or ``5e-07``, in seconds; None if it is none."""
    return _quantity(text, {"": 1.0} | {name: u.times / u.over for name, u in _UNITS.items() if u.base == "s"})


def hertz(text: str) -> float | None:
    """A sampling rate with its unit, as ``2.5 GSa/s`` or ``48000``, in hertz; None if it is none."""
    names = ("", "hz", "s/s", "sa/s", "samples/s", "samples/sec", "sps", "sa/sec")
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
