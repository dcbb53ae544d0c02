"""The converter that every recording goes through."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Converter:
    """Analogue-to-digital converter: range ± and number of bits."""

    range: float
    bits: int

    @property
    def step(self) -> float:
        """Quantisation step."""
        return 2 * self.range / 2**self.bits


def next_range(reach: float) -> float:
    """The next range 1-2-5 that holds a value."""
    decade = 10.0 ** np.floor(np.log10(reach))
    return float(next(decade * m for m in (1, 2, 5, 10) if decade * m >= reach))


def drawn_converter(largest: float, sigma: float, rng: np.random.Generator) -> Converter:
    """Converter of 12 … 16 bits with the next range above the signal, and a step no coarser than the noise."""
    span = next_range(1.15 * largest + 5 * sigma)
    bits = int(rng.integers(12, 17))
    while bits < 16 and Converter(span, bits).step > sigma:
        bits += 1
    return Converter(span, bits)


def converted(signal: np.ndarray, converter: Converter) -> np.ndarray:
    """Samples as the converter gives them, in the signal's unit."""
    code = np.clip(np.round(signal / converter.step), -(2 ** (converter.bits - 1)), 2 ** (converter.bits - 1) - 1)
    return code * converter.step
