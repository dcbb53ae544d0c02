"""How strong an effect must be for a mismatch that is asked for: a secant on logarithmic scales."""

from collections.abc import Callable
from math import exp, inf, isfinite, log

TOLERANCE = 0.01


def solved_strength(
    rho_of: Callable[[float], float], asked: float, start: float, weakest: float, strongest: float, name: str
) -> float:
    """The strength at which `rho_of` is `asked`, to 1 %.

    Parameters
    ----------
    rho_of : callable
        RMS of the mismatch over the noise for a strength; FloatingPointError where such a plant cannot be.
    asked : float
    start, weakest, strongest : float
        First guess and physical bounds.
    name : str
        Of the effect, for the message.

    Raises
    ------
    ValueError
        Where no strength within the bounds gives what is asked.
    """
    low: tuple[float, float] | None = None
    high: tuple[float, float] | None = None
    at = log(start)
    for count in range(60):
        try:
            rho = rho_of(exp(at))
        except FloatingPointError:
            rho = inf
        if isfinite(rho) and abs(rho / asked - 1) <= TOLERANCE:
            return exp(at)
        if rho < asked:
            low = (at, log(rho) if rho > 0 else -inf)
        else:
            high = (at, log(rho) if isfinite(rho) else inf)
        if low and low[0] >= log(strongest) - 1e-12:
            raise ValueError(
                f"{name} does not reach rho {asked} within its bounds: {exp(low[1]):.3g} at its strongest."
            )
        if high and high[0] <= log(weakest) + 1e-12:
            raise ValueError(f"{name} cannot be as faint as rho {asked}: its weakest gives {exp(high[1]):.3g}.")
        at = _next(low, high, log(asked), count)
        at = min(max(at, log(weakest)), log(strongest))
    raise ValueError(f"{name}: no strength gives rho {asked} within 1 %; it jumps there.")


def _next(low: tuple[float, float] | None, high: tuple[float, float] | None, asked: float, count: int) -> float:
    if low and high:
        if count % 4 == 3 or not (isfinite(low[1]) and isfinite(high[1])):
            return (low[0] + high[0]) / 2
        share = (asked - low[1]) / (high[1] - low[1])
        return low[0] + min(max(share, 0.05), 0.95) * (high[0] - low[0])
    if low:
        return low[0] + min(max(1.1 * (asked - low[1]), 0.1), 3.0)
    if high:
        return high[0] - min(max(1.1 * (high[1] - asked), 0.1), 3.0) if isfinite(high[1]) else high[0] - 1.0
    raise ValueError("A next strength needs one that was tried.")
