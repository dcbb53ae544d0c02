"""How the scale of the hysteretic drive is fixed, which no recording can tell from the gains behind it."""

from __future__ import annotations

from inkjet_env.printhead import Printhead

PUBLISHED = Printhead.published()


def conventional_swing(full_scale_V: float) -> float:
    """``Q(1)`` by convention: the published head's swing under a drive that swings over ``full_scale_V``, in its units.

    So the published head keeps its own ``b1`` whatever the amplitude it is identified at.
    """
    x = full_scale_V / PUBLISHED.full_scale_V
    return float(PUBLISHED.branch_law.Q(x)) / x


def in_convention(printhead: Printhead, full_scale_V: float | None = None) -> Printhead:
    """The same head with its law scaled as by convention and ``b1`` changed to match: it answers every drive as before.

    Parameters
    ----------
    printhead : Printhead
    full_scale_V : float, optional
        The swing at which the convention is to hold, the head's own unless given. Two heads compare parameter by
        parameter once both are put so at the same swing.
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
