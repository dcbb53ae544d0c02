"""Numbers, units and names formatted for readers."""

from __future__ import annotations

import math
import re

from inkjet_env.estimate import Estimate
from inkjet_env.plant.wording import CHANNEL_WORDS

FLOOR_V = 1e-6
LONGEST_NAME = 24
PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
NEGATIVE = re.compile(r"(?<![\w.\-])-(?=\d)")
UNIT_ENDING = re.compile(r"_(Hz|s|V|V_s|per_V2?)$")
PREFIXABLE = re.compile(r"(Hz|V|s|A|m|N|Pa|F|W|Ω)(?=$|[ /·])")


def interval_text(estimate: Estimate) -> tuple[str, str]:
    """Value and interval, rounded to two significant digits of the interval's half width.

    Examples
    --------
    >>> interval_text(Estimate(1.05512e11, 1.05489e11, 1.05535e11))
    ('1.05512e11', '1.05489e11 … 1.05535e11')
    >>> interval_text(Estimate(-0.0469, -0.0481, -0.0457))
    ('−0.0469', '−0.0481 … −0.0457')
    >>> interval_text(Estimate(float("nan"), 0.0, float("inf")))
    ('–', 'unknown')
    """
    if math.isnan(estimate.value):
        return "–", "unknown"
    half = (estimate.high - estimate.low) / 2
    digits = 6
    if 0 < half < math.inf and estimate.value != 0:
        digits = min(max(math.floor(math.log10(abs(estimate.value))) - math.floor(math.log10(half)) + 2, 2), 10)
    value, low, high = (short(v, digits) for v in (estimate.value, estimate.low, estimate.high))
    return value, f"{low} … {high}"


def short(value: float, digits: int = 3) -> str:
    """A number with ``digits`` significant digits; a dash if it is not finite.

    Examples
    --------
    >>> short(-3.14159e-7), short(12345.678), short(12345.678, 5), short(float("nan"))
    ('−3.14e−7', '12300', '12346', '–')
    """
    if not math.isfinite(value):
        return "–"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    if -4 < exponent < 6:
        text = f"{float(f'{value:.{digits}g}'):.{max(digits - 1 - exponent, 0)}f}"
    else:
        text = f"{value / 10.0**exponent:.{digits - 1}f}e{exponent}"
    return text.replace("-", "−")


def quantity_text(value: float, unit: str) -> str:
    """A value with its unit and an SI prefix, three significant digits; a dash if it is not finite.

    Examples
    --------
    >>> quantity_text(0.00216, "V"), quantity_text(0.0794, "um"), quantity_text(float("nan"), "V")
    ('2.16 mV', '79.4 nm', '–')
    """
    if not math.isfinite(value):
        return "–"
    size, shown = prefixed_unit(value, unit)
    return f"{short(value / size)} {shown}".rstrip()


def prefixed_unit(value: float, unit: str) -> tuple[float, str]:
    """What to divide a value by, and the unit with the SI prefix that this gives.

    Examples
    --------
    >>> prefixed_unit(0.0284, "V"), prefixed_unit(12.0, "V"), prefixed_unit(0.05, "um"), prefixed_unit(0.02, "1")
    ((0.001, 'mV'), (1.0, 'V'), (0.001, 'nm'), (1.0, ''))
    """
    metres = {"um": -6, "nm": -9}.get(unit)
    if metres is None and not PREFIXABLE.match(unit):
        return 1.0, "" if unit == "1" else unit_text(unit)
    given, unit = metres or 0, "m" if metres else unit
    if not math.isfinite(value) or value == 0:
        exponent = given
    else:
        rounded = float(f"{abs(value):.2e}")
        exponent = min(max(3 * math.floor((math.log10(rounded) + given) / 3 + 1e-12), -12), 12)
    return float(f"1e{exponent - given}"), PREFIXES[exponent] + unit


def hertz(frequency_Hz: float) -> str:
    """A frequency in Hz, kHz or MHz.

    Examples
    --------
    >>> hertz(51694.6), hertz(412.3)
    ('51.69 kHz', '412.3 Hz')
    """
    for size, unit in ((1e6, "MHz"), (1e3, "kHz")):
        if frequency_Hz >= size:
            return f"{frequency_Hz / size:.4g} {unit}"
    return f"{frequency_Hz:.4g} Hz"


def unit_text(unit: str) -> str:
    """The unit with ``um`` written as µm."""
    return unit.replace("um", "µm")


def short_name(name: str) -> str:
    """A recording's name, cut to `LONGEST_NAME` characters to fit in a figure."""
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…"


def engineering(estimate: Estimate, unit: str) -> tuple[str, str, str]:
    """Value, interval and unit, with an SI prefix that suits all three numbers.

    Two significant digits of the interval's half width are shown and at least two of the value; three of the value if
    there is no interval.

    Examples
    --------
    >>> engineering(Estimate(210.4e3, 205.1e3, 216.2e3), "Hz")
    ('210.4', '205.1 … 216.2', 'kHz')
    >>> engineering(Estimate(-2.5e-9, -2.61e-9, -2.39e-9), "1/V²")
    ('−2.50', '−2.61 … −2.39', '10⁻⁹/V²')
    >>> engineering(Estimate(4e5, 1e5, float("inf")), "Hz"), engineering(Estimate(46520.0, 46520.0, 46520.0), "Hz")
    (('400', '100 … ∞', 'kHz'), ('46.5', '–', 'kHz'))
    """
    numbers = (estimate.value, estimate.low, estimate.high)
    finite = [abs(v) for v in numbers if math.isfinite(v) and v != 0]
    size = finite[0] if finite else 1.0
    exponent = min(max(3 * math.floor(math.log10(size) / 3 + 1e-12), -12), 12)
    shown_unit = unit_text(unit)
    if PREFIXABLE.match(unit):
        shown_unit = PREFIXES[exponent] + shown_unit
    elif 1e-3 <= size < 1e4:
        exponent = 0
    else:
        power = "10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        shown_unit = power + (shown_unit[1:] if unit.startswith("1") else f" {shown_unit}") if exponent else shown_unit
    half = (estimate.high - estimate.low) / 2
    leading = [math.floor(math.log10(v / 10.0**exponent)) for v in (half, size) if 0 < v < math.inf]
    digits = 1 if half else 2
    decimals = min(max(0, *(digits - digit for digit in leading), 0), 8) if leading else 0
    value, low, high = (number(v / 10.0**exponent, decimals) for v in numbers)
    return value, f"{low} … {high}" if half else "–", "" if shown_unit == "1" else shown_unit


def number(value: float, decimals: int = 2) -> str:
    """A number with ``decimals`` decimals, a true minus sign and ∞ for infinity; a dash for NaN.

    Examples
    --------
    >>> number(-0.126), number(-1e-9), number(float("inf"), 0), number(float("nan")), number(3.2e9, 0)
    ('−0.13', '0.00', '∞', '–', '3.20e9')
    """
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    return short(value) if abs(value) >= 1e6 else f"{value:z.{decimals}f}".replace("-", "−")


def with_minus(text: str) -> str:
    """The text with a true minus sign before every negative number.

    Examples
    --------
    >>> with_minus("strain-gauge: -2.2 % between -1 and 2e-05 V")
    'strain-gauge: −2.2 % between −1 and 2e-05 V'
    """
    return NEGATIVE.sub("−", text)


def probability(p: float) -> str:
    """A probability with two significant digits; ``below 10⁻⁶`` if it is smaller than that.

    Examples
    --------
    >>> probability(0.0123), probability(1e-40)
    ('0.012', 'below 10⁻⁶')
    """
    return short(p, 2) if p >= 1e-6 else "below 10⁻⁶"


def share_text(share: float) -> str:
    """A share in per cent; a dash if it is not finite.

    Examples
    --------
    >>> share_text(0.9312), share_text(0.9961), share_text(-0.02), share_text(-1e-4), share_text(float("nan"))
    ('93 %', '99.6 %', '−2 %', '0 %', '–')
    """
    if not math.isfinite(share):
        return "–"
    decimals = 1 if 0.99 < share < 0.9995 else 0
    return f"{100 * share:z.{decimals}f} %".replace("-", "−")


def explained_text(share: float) -> str:
    """A share that is explained, in per cent, never above 100 %: what fits the noise as well explains no more.

    Examples
    --------
    >>> explained_text(1.012), explained_text(0.9312), explained_text(float("nan"))
    ('100 %', '93 %', '–')
    """
    return share_text(share if share != share else min(share, 1.0))


def channels_in_words(text: str) -> str:
    """The text with the channels' names for readers.

    Examples
    --------
    >>> channels_in_words("strain_gauge: the residual is 1.9 times the noise.")
    'strain gauge: the residual is 1.9 times the noise.'
    """
    for channel, words in CHANNEL_WORDS.items():
        text = text.replace(channel, words)
    return text


def parameter_text(name: str) -> str:
    """A parameter's name for readers: without the unit of its stored value, which stands beside it with a prefix.

    Examples
    --------
    >>> parameter_text("bubble_frequency_Hz"), parameter_text("slew_rate_V_s"), parameter_text("time_1_s")
    ('bubble frequency', 'slew rate', 'time 1')
    """
    return UNIT_ENDING.sub("", name).replace("_", " ")


def volts(value: float) -> str:
    """A regret, in volts or in the problem's scale; a dash if it is not finite.

    Examples
    --------
    >>> [volts(v) for v in (12.3456, 0.01234, 3e-9, float("nan"))]
    ['12.35', '0.0123', '< 1e-6', '–']
    """
    if not math.isfinite(value):
        return "–"
    if abs(value) < FLOOR_V:
        return "< 1e-6"
    return f"{value:.2f}" if abs(value) >= 1 else f"{value:.3g}"
