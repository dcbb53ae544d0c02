"""Numbers in sentences as an engineer reads them aloud: 48 kHz, 24 µs, 0.7 ppm."""

from __future__ import annotations

import math

PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))
"""SI prefixes with their factors, largest first."""
CHANNEL_WORDS = {"self_sensing": "self-sensing", "strain_gauge": "strain gauge", "displacement": "displacement"}
"""Channels as adjectives."""
SENSOR_UNIT = "sensor's unit"
"""Unit of a parameter that has the unit of the sensor's signal."""


def with_prefix(value: float, unit: str, digits: int = 2) -> str:
    """A value with its unit and the appropriate SI prefix.

    Parameters
    ----------
    value : float
        The value, in ``unit``.
    unit : str
        Unit without a prefix. Steep edges in "V/s" are given per microsecond or millisecond; "um" and "nm" are
        converted to metres.
    digits : int
        Number of significant digits; digits before the decimal point are never dropped.

    Examples
    --------
    >>> with_prefix(48_123, "Hz"), with_prefix(1.986e6, "Hz", 3), with_prefix(2.4e-5, "s")
    ('48 kHz', '1.99 MHz', '24 µs')
    >>> with_prefix(1e8, "V/s"), with_prefix(-100.0, "V"), with_prefix(0.0, "s"), with_prefix(math.inf, "Hz")
    ('100 V/µs', '-100 V', '0 s', '∞ Hz')
    """
    metres = {"um": 1e-6, "nm": 1e-9}.get(unit)
    if metres:
        value, unit = value * metres, "m"
    if math.isinf(value):
        return f"{'-' if value < 0 else ''}∞ {unit}"
    if value == 0:
        return f"0 {unit}"
    value = float(f"{value:.{digits}g}")
    if unit == "V/s":
        scale, name = (1e6, "V/µs") if abs(value) >= 1e5 else (1e3, "V/ms") if abs(value) >= 1e3 else (1.0, "V/s")
    else:
        scale, prefix = next((p for p in PREFIXES if abs(value) >= 0.9995 * p[0]), PREFIXES[-1])
        name = prefix + unit
    return f"{_plain(value / scale, digits)} {name}"


def span_text(low: float, high: float, unit: str) -> str:
    """An interval in words, its ends in ``unit``.

    Examples
    --------
    >>> span_text(4e4, 1.2e5, "Hz"), span_text(900.0, 1500.0, "Hz"), span_text(20.0, 20.0, "V")
    ('40 to 120 kHz', '900 Hz to 1.5 kHz', '20 V')
    """
    first, last = with_prefix(low, unit), with_prefix(high, unit)
    if first == last:
        return first
    if first.split()[1] == last.split()[1]:
        first = first.split()[0]
    return f"{first} to {last}"


def percent(part: float, digits: int = 2, signed: bool = False) -> str:
    """A share in per cent, or in parts per million if it is below a hundredth of a per cent.

    Examples
    --------
    >>> percent(0.0312), percent(-0.5), percent(1.0, 3), percent(7e-7), percent(0.02, signed=True)
    ('3.1 %', '-50 %', '100 %', '0.7 ppm', '+2 %')
    """
    scale, unit = (1e6, "ppm") if 0 < abs(part) < 0.9995e-4 else (1e2, "%")
    return f"{'+' if signed and part > 0 else ''}{_plain(scale * part, digits)} {unit}"


def _plain(value: float, digits: int) -> str:
    """The number with ``digits`` significant digits and never an exponent."""
    rounded = float(f"{value:.{digits}g}")
    if rounded == 0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(rounded))), 0)
    text = f"{rounded:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
