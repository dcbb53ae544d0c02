"""Uniform times restored from printed ones, if only their printed precision makes them uneven."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from inkjet_env.recordings.recording import LARGEST_JITTER, grid, largest_departure, uniform_grid
from inkjet_env.typing import Real

COARSEST_PRINT = 1e-3
"""Largest print step of times that are repaired, as a share of the recording; beyond it, the step would be a guess."""

_NUMBER = re.compile(r"[+-]?(?P<digits>[0-9.]+)(?:[eE](?P<exponent>[+-]?[0-9]{1,4}))?")


def last_digit(cells: Sequence[str]) -> float:
    """Value of one unit in the last printed digit of the most precise of some numbers; other cells are ignored.

    Examples
    --------
    >>> last_digit(["0.0002", "0.00040001"]), last_digit(["-6.00e-04", "0"])
    (1e-08, 1e-06)
    """
    places = []
    for cell in cells:
        number = _NUMBER.fullmatch(cell)
        if number and number["digits"].strip("0."):
            places.append(int(number["exponent"] or 0) - len(number["digits"].partition(".")[2]))
    return float(f"1e{min(places)}") if places else 0.0


def single_precision_step(times: Real, print_step: float) -> float:
    """Spacing of single-precision numbers at the largest of printed times if all are such numbers, otherwise 0.

    An instrument that holds times in single precision prints more digits than they have.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Printed times.
    print_step : float
        One unit in the last printed digit.
    """
    rounded = times.astype(np.float32)
    off = rounded - times
    if np.abs(off, out=off).max(initial=0.0) > print_step:
        return 0.0
    return float(np.spacing(np.abs(rounded, out=rounded).max(initial=0.0)))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def uniform_times(time_s: Real, print_step_s: float) -> tuple[Real, float] | None:
    """Times on the uniform grid that printed times represent.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Printed times in seconds; equal neighbours are allowed if the printing is coarse.
    print_step_s : float
        One unit in the last printed digit, in seconds.

    Returns
    -------
    (ndarray, shape (n,), float) or None
        The times in seconds, and the largest deviation of the printed ones from the grid, in steps. Times that are
        uniform to floating-point rounding are returned unchanged. None if neither the printed precision nor 1 % of a
        step explains the deviation.
    """
    start_s, step_s = uniform_grid(time_s)
    off_s = largest_departure(time_s, start_s, step_s)[1]
    rounding_s = 8 * float(np.spacing(max(abs(time_s.min()), abs(time_s.max()))))
    if not step_s > 0:
        return None
    rising = bool((np.diff(time_s) > 0).all())
    if rising and off_s <= min(rounding_s, LARGEST_JITTER * step_s):
        return time_s, off_s / step_s
    printed = off_s <= print_step_s and print_step_s <= COARSEST_PRINT * (time_s[-1] - time_s[0])
    if not (printed or (rising and off_s <= LARGEST_JITTER * step_s)):
        return None
    if printed:
        middle = (len(time_s) - 1) / 2
        rounded = start_s + step_s * middle, _shortest_near(step_s, 2 * print_step_s / (len(time_s) - 1)), middle
        if largest_departure(time_s, *rounded)[1] <= print_step_s:
            return grid(len(time_s), *rounded), off_s / step_s
    return grid(len(time_s), start_s, step_s), off_s / step_s


def _shortest_near(value: float, tolerance: float) -> float:
    """The number with the fewest digits within a tolerance of a value: instruments sample at such steps."""
    for digits in range(17):
        rounded = float(f"{value:.{digits}e}")
        if abs(rounded - value) <= tolerance:
            return rounded
    return value
