"""Thresholds of a diagnosis."""

from __future__ import annotations

LEFT_OVER = 0.05
"""Unexplained share of the mismatch, above which the verdict is unknown."""
PREDICTED_POORLY = 0.5
"""Closure below which an effect keeps its name only if it explains the held-out recordings once they are fitted."""
MOST_ALIKE = 6
"""Largest number of effects in a set: if more explain the recordings equally well, the verdict is unknown."""
SURE = 5.0
"""Standard deviations by which residual power must exceed the noise to count."""
LEAST_EXCESS = 0.03
"""Share of the noise's power by which residual power must exceed it: less may be the noise's own uncertainty."""
