"""Noise of one channel: parts with a memory in seconds, tails, spikes, levels that follow signal or recording."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from scipy.linalg import expm, solve_continuous_lyapunov

MOST_SPIKES = 0.05  # share of the samples


@dataclass(frozen=True)
class Colour:
    """A part of the noise that is an autoregression in continuous time, the same at every sampling rate.

    White noise through 1/Π(s − p): one real pole is a memory that fades exponentially, a pair a bump of the spectrum.

    Source: P. J. Brockwell, R. A. Davis, Introduction to Time Series and Forecasting (2016), section 11.5.

    Parameters
    ----------
    share : float
        Of the noise's variance.
    poles_per_s : tuple of complex
        In 1/s, real parts negative, complex ones in pairs.
    """

    share: float
    poles_per_s: tuple[complex, ...]

    def sampled(self, step_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x → Φx + Qw at an interval, of unit variance in x[0]: Φ and Q, and the root of the stationary covariance."""
        poles = np.array(self.poles_per_s) * step_s
        scale = float(np.prod(np.abs(poles)) ** (1 / poles.size))  # the time in units in which the states are alike
        polynomial = np.real(np.poly(poles / scale))
        order = poles.size
        companion = np.diag(np.ones(order - 1), 1)
        companion[-1] = -polynomial[:0:-1]
        driven = np.zeros((order, order))
        driven[-1, -1] = 1.0
        covariance = solve_continuous_lyapunov(companion, -driven)
        covariance /= covariance[0, 0]
        step = expm(companion * scale)
        return step, _root(covariance - step @ covariance @ step.T), _root(covariance)

    def row(self, samples: int, step_s: float, rng: np.random.Generator) -> np.ndarray:
        """One recording's part, of unit variance, shape (samples,), stationary from its first sample."""
        step, innovation, start = self.sampled(step_s)
        order = len(self.poles_per_s)
        white = rng.standard_normal(order * (samples + 1)).reshape(samples + 1, order)
        out = np.empty(samples)
        _propagate(step, white[1:] @ innovation.T, start @ white[0], out)
        return out


def _root(covariance: np.ndarray) -> np.ndarray:
    """R with R Rᵀ = covariance, semidefinite up to rounding."""
    value, vector = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))


@njit(cache=True)
def _propagate(step, drive, state, out):
    n = state.size
    new = np.empty(n)
    for k in range(out.size):
        out[k] = state[0]
        for i in range(n):
            total = drive[k, i]
            for j in range(n):
                total += step[i, j] * state[j]
            new[i] = total
        state[:] = new


@dataclass(frozen=True)
class Noise:
    """Noise of one channel.

    Parameters
    ----------
    sigma : float
        Standard deviation over a campaign in the sensor's unit, that of the converter's rounding included.
    kind : str
        For the record.
    colours : tuple of Colour
        What they leave of the variance is white.
    tail_freedom : float
        Degrees of freedom of Student's t, in place of the white part's normal distribution; 0: normal.
    spikes_per_s, spike_size : float
        Rate, and height over sigma, of single samples of either sign.
    growth, reference : float
        Share of the variance that follows the squared signal (its offset taken out), and that square's mean.
    spread : float
        Of the logarithm of the level from recording to recording.
    rounding_share : float
        Of the variance: the converter's, which is not added here.
    dither : float
        Half width of a triangular dither in the sensor's unit.
    """

    sigma: float
    kind: str = "white"
    colours: tuple[Colour, ...] = ()
    tail_freedom: float = 0.0
    spikes_per_s: float = 0.0
    spike_size: float = 0.0
    growth: float = 0.0
    reference: float = 1.0
    spread: float = 0.0
    rounding_share: float = 0.0
    dither: float = 0.0

    def described(self) -> dict[str, Any]:
        """Ready for JSON: what is not zero."""
        named: dict[str, Any] = {"kind": self.kind, "rms": self.sigma}
        if self.colours:
            named["colours"] = [
                {"variance_share": c.share, "poles_per_s": [[p.real, p.imag] for p in c.poles_per_s]}
                for c in self.colours
            ]
        others = ("tail_freedom", "spikes_per_s", "spike_size", "growth", "spread", "rounding_share", "dither")
        return named | {name: getattr(self, name) for name in others if getattr(self, name)}


def _white(noise: Noise, samples: int, rng: np.random.Generator) -> np.ndarray:
    if not noise.tail_freedom:
        return rng.standard_normal(samples)
    return rng.standard_t(noise.tail_freedom, samples) * np.sqrt(1 - 2 / noise.tail_freedom)


def noise_row(noise: Noise, signal: np.ndarray, step_s: float, rng: np.random.Generator) -> np.ndarray:
    """One recording's noise, shape (n,).

    Parameters
    ----------
    noise : Noise
    signal : ndarray, shape (n,)
        Noise-free, which a level that grows with the signal follows.
    step_s : float
        Sampling interval.
    rng : numpy.random.Generator
    """
    samples = signal.size
    likely = min(noise.spikes_per_s * step_s, MOST_SPIKES)
    left = 1 - sum(colour.share for colour in noise.colours) - likely * noise.spike_size**2
    row = np.sqrt(max(left, 0.0)) * _white(noise, samples, rng)
    for colour in noise.colours:
        row = row + np.sqrt(colour.share) * colour.row(samples, step_s, rng)
    if likely:
        row = row + noise.spike_size * np.sign(rng.standard_normal(samples)) * (rng.random(samples) < likely)
    if noise.growth:
        size = (signal - np.median(signal)) ** 2 / noise.reference
        row = row * np.sqrt(1 - noise.growth + noise.growth * size)
    if noise.spread:
        # exp(s n − s²) is of unit mean square.
        row = row * np.exp(noise.spread * rng.standard_normal() - noise.spread**2)
    row = noise.sigma * np.sqrt(1 - noise.rounding_share) * row
    if noise.dither:
        row = row + noise.dither * (rng.random(samples) - rng.random(samples))
    return row
