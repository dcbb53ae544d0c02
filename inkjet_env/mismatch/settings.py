"""Thresholds of a diagnosis."""

from __future__ import annotations

LEFT_OVER = 0.05
"""Share of the mismatch from which on what is left unexplained makes a verdict unknown."""
PREDICTED_POORLY = 0.5
"""Closure from which on down an effect keeps its name only if it explains held-out recordings once they are fitted."""
MOST_ALIKE = 6
"""Effects in a set: where each of more explains it as well as another, nothing is known."""
SURE = 5.0
"""Standard deviations by which what is left must exceed the noise to count."""
LEAST_EXCESS = 0.03
"""Of the noise's power: less is taken for its own uncertainty."""
