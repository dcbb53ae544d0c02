"""The printhead of a case: its constants, drawn over the whole range that is met in practice."""

from dataclasses import dataclass

import numpy as np

LARGEST_DRIVE_V = 110.0
PLAYS = 600


@dataclass(frozen=True)
class Head:
    """Constants of one printhead.

    The hysteretic drive, in volts, is ``reversible * u`` and a density of play operators over the thresholds
    0 … `LARGEST_DRIVE_V`; the resonator is ``x'' + a1 x' + a0 x = a0 h`` with the deflection x in volts of
    static drive.

    Parameters
    ----------
    resonance_Hz, damping_ratio : float
        Undamped natural frequency and share of critical damping.
    b1_per_s : float
        Gain of self-sensing, b1 s/(s² + a1 s + a0) on the hysteretic drive.
    gauge_gain_V_per_V, gauge_offset_V, self_sensing_offset_V : float
        Strain gauge on the hysteretic drive; constant offsets of the two channels.
    displacement_nm_per_V, displacement_offset_nm : float
        Position sensor: static deflection a volt of hysteretic drive, and its offset.
    reversible : float
        Slope of the loops at a turning point.
    loop_V : float
        What the plays add to a full swing of 180 V.
    density : str
        "exponential", "polynomial" or "smooth": the exponential of a random cosine series.
    shape : tuple of float
        Of the density, over the threshold as a share of `LARGEST_DRIVE_V`.
    """

    resonance_Hz: float
    damping_ratio: float
    b1_per_s: float
    gauge_gain_V_per_V: float
    gauge_offset_V: float
    self_sensing_offset_V: float
    displacement_nm_per_V: float
    displacement_offset_nm: float
    reversible: float
    loop_V: float
    density: str
    shape: tuple[float, ...]

    @property
    def angular_rad_per_s(self) -> float:
        """Undamped natural frequency in rad/s."""
        return 2 * np.pi * self.resonance_Hz

    @property
    def a0_per_s2(self) -> float:
        """Square of the natural frequency."""
        return self.angular_rad_per_s**2

    @property
    def a1_per_s(self) -> float:
        """Twice the decay rate."""
        return 2 * self.damping_ratio * self.angular_rad_per_s

    def density_per_V(self, threshold_V: np.ndarray) -> np.ndarray:
        """Density of the plays at thresholds, shape (r,), before its scale is set."""
        share = threshold_V / LARGEST_DRIVE_V
        if self.density == "exponential":
            return np.exp(-share / self.shape[0])
        if self.density == "polynomial":
            return np.polynomial.polynomial.polyval(share, np.array(self.shape))
        if self.density == "smooth":
            orders = np.arange(1, len(self.shape) + 1)
            return np.exp(np.cos(np.pi * np.multiply.outer(share, orders)) @ np.array(self.shape))
        raise ValueError(f'density must be "exponential", "polynomial" or "smooth"; got {self.density!r}.')

    def plays(self, count: int = PLAYS) -> tuple[np.ndarray, np.ndarray]:
        """Thresholds in volts and weights, shape (count,) each, by the midpoint rule.

        The scale follows from Q(180 V) - reversible·180 V = `loop_V` with Q(Δ) = 2∫p(r)(Δ/2 − r)dr.
        """
        width = LARGEST_DRIVE_V / count
        threshold = (np.arange(count) + 0.5) * width
        weight = self.density_per_V(threshold) * width
        reach = 2 * np.sum(weight * np.maximum(90.0 - threshold, 0.0))
        return threshold, weight * (self.loop_V / reach)


def drawn_head(rng: np.random.Generator) -> Head:
    """Draw a printhead: 35 … 70 kHz, damping 0.03 … 0.08, gains ±30 %, hysteresis ±40 %.

    Parameters
    ----------
    rng : numpy.random.Generator
    """
    choice = rng.random()
    if choice < 0.5:
        # Any positive density: each further order smaller with its inverse, so that it stays smooth.
        density = "smooth"
        orders = np.arange(1, 7)
        shape: tuple[float, ...] = tuple((rng.standard_normal(6) * 0.8 / orders).tolist())
    elif choice < 0.75:
        density = "exponential"
        shape = (float(rng.uniform(0.35, 1.5)),)
    else:
        # 1 + c (1 − 2x) + d (1 − 2x)² stays positive on 0 … 1 for |c| + |d| < 1.
        c, d = rng.uniform(-0.2, 0.5), rng.uniform(-0.3, 0.3)
        density = "polynomial"
        shape = (float(1 + c + d), float(-2 * c - 4 * d), float(4 * d))
    return Head(
        resonance_Hz=float(rng.uniform(35e3, 70e3)),
        damping_ratio=float(rng.uniform(0.03, 0.08)),
        b1_per_s=float(1.907e4 * rng.uniform(0.7, 1.3)),
        gauge_gain_V_per_V=float(0.02 * rng.uniform(0.7, 1.3)),
        gauge_offset_V=float(rng.normal(0.0, 0.05)),
        self_sensing_offset_V=float(rng.normal(0.0, 0.02)),
        displacement_nm_per_V=float(1.5 * rng.uniform(0.7, 1.3)),
        displacement_offset_nm=float(rng.normal(0.0, 2.0)),
        reversible=float(0.75 * rng.uniform(0.9, 1.1)),
        loop_V=float(180 * 0.25 * rng.uniform(0.6, 1.4)),
        density=density,
        shape=shape,
    )
