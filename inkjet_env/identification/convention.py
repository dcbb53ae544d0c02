"""Convention for the scale of the hysteretic drive, which no recording can separate from the gains after it."""

from __future__ import annotations

from inkjet_env.printhead import Printhead

PUBLISHED = Printhead.published()
"""Head whose law fixes the scale."""


def conventional_swing(full_scale_V: float) -> float:
    """``Q(1)`` by convention: swing of the published head under a drive of swing ``full_scale_V``, over that swing.

    With it the published head keeps its ``b1``, whatever the amplitude at which it is identified.
    """
    x = full_scale_V / PUBLISHED.full_scale_V
    return float(PUBLISHED.branch_law.Q(x)) / x


def in_convention(printhead: Printhead, full_scale_V: float | None = None) -> Printhead:
    """The same head with its law scaled by convention and ``b1`` adapted: its response to every drive is unchanged.

    Parameters
    ----------
    printhead : Printhead
        The head.
    full_scale_V : float, optional
        Swing in volts at which the convention holds; the head's own by default. Two heads can be compared parameter by
        parameter once both follow the convention at the same swing.

    Returns
    -------
    Printhead
        The head in the convention.
    """
    swing = printhead.full_scale_V if full_scale_V is None else full_scale_V
    x = swing / printhead.full_scale_V
    factor = conventional_swing(swing) * x / float(printhead.branch_law.Q(x))
    return Printhead(
        printhead.a0,
        printhead.a1,
        printhead.b1 / factor,
        tuple(factor * c for c in printhead.coefficients),
        printhead.full_scale_V,
    )
