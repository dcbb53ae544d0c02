"""Units as instruments print them."""

from __future__ import annotations

import re
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
_BRACKETED = re.compile(r"\s*[(\[]\s*([^()\[\]]+?)\s*[)\]]\s*$")
_SUFFIXED = re.compile(r"_([A-Za-zµμ]{1,2})$")
_RIGOL_CHANNEL = re.compile(r"^CH\d+(V)$")


def known_unit(printed: str) -> Unit | None:
    """Unit denoted by a cell such as ``ms``, ``(mV)`` or ``Volt``, or None.

    Examples
    --------
    >>> known_unit("(µs)")
    Unit(base='s', times=1.0, over=1000000.0)
    """
    text = printed.strip().strip("()[]").strip().replace("µ", "u").replace("μ", "u")
    return _UNITS.get(text) or (_UNITS.get(text.lower()) if len(text) > 2 else None)


def unit_in_name(name: str) -> Unit | None:
    """Unit in the name of a column, as in ``Time (ms)``, ``drive_V`` or ``CH1V``; None if there is none."""
    for pattern in (_BRACKETED, _SUFFIXED, _RIGOL_CHANNEL):
        found = pattern.search(name)
        if found and (unit := known_unit(found.group(1))):
            return unit
    return None
