"""Hysteresis stage: creep, rate and asymmetry of the ceramic's loops."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numba import njit

from experiments.concealed_rig.effects.effect import Effect, PlaySettings, Situation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.linear import relaxations
from experiments.concealed_rig.play import following, play_sum_V

GROWING_V = 20.0  # growth of the thresholds a decade of rate at strength 1


@njit(cache=True)
def _creep_lap(h, share, late, threshold, y, out):
    for k in range(h.size):
        if k > 0:
            at = h[k] - late * (h[k] - h[k - 1])
            y += share * (max(at - threshold, min(at + threshold, y)) - y)
        out[k] = y
    return y


@njit(cache=True)
def _creep_operator(h, share, late, threshold, periodic, out):
    start = 0.0
    if periodic:
        # The state after a lap is a monotone, contracting function of the state before: its fixed point by secants.
        low, gap = start, _creep_lap(h, share, late, threshold, start, out) - start
        at = low + gap
        for _ in range(60):
            further = _creep_lap(h, share, late, threshold, at, out) - at
            if abs(further) <= 1e-12 * (1.0 + abs(at)) or further == gap:
                break
            slope = (further - gap) / (at - low)
            low, gap = at, further
            at -= further / slope
        start = at
    _creep_lap(h, share, late, threshold, start, out)


@dataclass(frozen=True)
class Creep(Effect):
    """Displacement goes on after the voltage has come to rest; its strength is the share of the hysteretic drive.

    Variants: "kelvin_voigt", a chain of a few elements; "logarithmic", so many of them that a step is followed by
    γ·lg(t); "fractional", a springpot, followed by t^α with α of 0.12 … 0.35; "creep_operators", elements that relax
    only towards their own dead band.

    Source: K. Kuhnen, P. Krejčí, IEEE Trans. Automat. Control 54 (2009) 537 (creep operators; log-type creep);
    W. N. Findley et al., Creep and Relaxation of Nonlinear Viscoelastic Materials (1976) (chains); F. Mainardi,
    Fractional Calculus and Waves in Linear Viscoelasticity (2010), chapter 3 (spectrum of the springpot, τ^(α−1)).
    """

    id = "creep"
    stage = "hysteresis"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.5

    times_s: tuple[float, ...] = field(default=(1.0,), kw_only=True)
    weights: tuple[float, ...] = field(default=(1.0,), kw_only=True)
    thresholds_V: tuple[float, ...] = field(default=(), kw_only=True)
    power: float = field(default=0.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "Creep":
        """Times over several decades, around the recordings' own lengths."""
        low, high = (2e-6, 2e-3) if situation.meagre else (2e-2, 2e1)
        variant = str(rng.choice(["kelvin_voigt", "logarithmic", "fractional", "creep_operators"]))
        if variant == "logarithmic":
            decades = np.log10(high / low)
            times = np.geomspace(low, high, int(8 * decades) + 1)
            return cls(variant=variant, times_s=tuple(times.tolist()), weights=(1 / 8,) * times.size)
        if variant == "fractional":
            power = float(rng.uniform(0.12, 0.35))
            times = np.geomspace(low, high, int(6 * np.log10(high / low)) + 1)
            spectrum = (times / high) ** power
            shares = tuple((spectrum / np.sum(spectrum)).tolist())
            return cls(variant=variant, times_s=tuple(times.tolist()), weights=shares, power=power)
        count = int(rng.integers(3, 6))
        times = np.geomspace(low, high, count) * 10 ** rng.uniform(-0.25, 0.25, count)
        weights = rng.dirichlet(np.full(count, 4.0))
        thresholds = rng.uniform(0.0, 8.0, count) if variant == "creep_operators" else np.empty(0)
        return cls(
            variant=variant,
            times_s=tuple(times.tolist()),
            weights=tuple(weights.tolist()),
            thresholds_V=tuple(thresholds.tolist()),
        )

    def on_hysteretic(self, hysteretic_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Add what creeps."""
        if not self.strength:
            return hysteretic_V
        times, weights = np.array(self.times_s), np.array(self.weights)
        if not self.thresholds_V:
            return hysteretic_V + self.strength * (
                weights @ relaxations(hysteretic_V, times, grid.half_s, grid.periodic)
            )
        total = np.zeros(hysteretic_V.size)
        for time, weight, threshold in zip(times, weights, self.thresholds_V, strict=True):
            out = np.zeros(hysteretic_V.size)
            _creep_operator(hysteretic_V, *following(time / grid.half_s), threshold, grid.periodic, out)
            total += weight * out
        return hysteretic_V + self.strength * total

    def parameters(self) -> dict[str, Any]:
        """Times, and the creep in one decade or in all."""
        if self.variant == "logarithmic":
            return {
                "creep_per_decade": self.strength,
                "shortest_s": self.times_s[0],
                "longest_s": self.times_s[-1],
            }
        if self.variant == "fractional":
            return {"creep": self.strength, "power": self.power, "longest_s": self.times_s[-1]}
        creep = [self.strength * w for w in self.weights]
        return {"times_s": list(self.times_s), "creep": creep, "thresholds_V": list(self.thresholds_V)}


@dataclass(frozen=True)
class RateDependentHysteresis(Effect):
    """The loop widens with the drive's rate; its strength is the growth a decade of rate, or a relaxation time.

    Variants: "thresholds" and "weights" grow with lg(1 + |dU/dt|/rate); "power_law", thresholds that grow with a power
    of the rate; "relaxing", plays that follow with a delay.

    Source: M. Al Janaideh, C.-Y. Su, S. Rakheja, Smart Mater. Struct. 17 (2008) 035026 (thresholds); W. T. Ang et al.,
    IEEE/ASME Trans. Mechatronics 12 (2007) 134 (weights); G. Bertotti, Hysteresis in Magnetism (1998), chapter 12
    (excess field as a power of the rate; operators that relax).
    """

    id = "rate_dependent_hysteresis"
    stage = "hysteresis"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.5

    rate_V_per_s: float = field(default=100.0, kw_only=True)
    rate_time_s: float = field(default=2e-6, kw_only=True)
    period_s: float = field(default=2e-5, kw_only=True)
    power: float = field(default=0.15, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "RateDependentHysteresis":
        """One of four."""
        return cls(
            variant=str(rng.choice(["thresholds", "weights", "power_law", "relaxing"])),
            power=float(rng.uniform(0.08, 0.2)),
            rate_V_per_s=float(10 ** rng.uniform(1.5, 3.0)),
            rate_time_s=float(rng.uniform(1e-6, 4e-6)),
            period_s=1 / situation.head.resonance_Hz,
        )

    def on_plays(self, settings: PlaySettings) -> PlaySettings:
        """Change the plays."""
        if not self.strength:
            return settings
        if self.variant == "relaxing":
            return replace(settings, relaxation_s=self.strength * self.period_s)
        rate = {"rate_V_per_s": self.rate_V_per_s, "rate_time_s": self.rate_time_s}
        if self.variant == "thresholds":
            return replace(settings, threshold_growth_V=self.strength * GROWING_V, **rate)
        if self.variant == "power_law":
            return replace(settings, threshold_growth_V=self.strength * GROWING_V, rate_power=self.power, **rate)
        return replace(settings, weight_growth=self.strength, **rate)

    def parameters(self) -> dict[str, Any]:
        """Growth a decade, or the time."""
        if self.variant == "relaxing":
            return {"relaxation_s": self.strength * self.period_s}
        if self.variant == "thresholds":
            growth = {"growth_V_per_decade": self.strength * GROWING_V}
        elif self.variant == "power_law":
            growth = {"growth_V": self.strength * GROWING_V, "power": self.power}
        else:
            growth = {"growth_per_decade": self.strength}
        return {**growth, "rate_V_per_s": self.rate_V_per_s, "rate_time_s": self.rate_time_s}


@dataclass(frozen=True)
class AsymmetricHysteresis(Effect):
    """Rising and falling, or positive and negative, branches differ.

    Variants: "dead_zones", one-sided dead zones superposed on the hysteretic drive; "unequal_slopes", plays whose
    thresholds grow with the voltage, so that their two envelopes have unequal slopes; "bent_input", a parabola before
    the plays; "exponential_input", V(exp(u/V) − 1) before them; "one_polarity", further plays that only one polarity
    moves.

    Source: K. Kuhnen, Eur. J. Control 9 (2003) 407 (dead zones); M. Al Janaideh, S. Rakheja, C.-Y. Su, IEEE/ASME
    Trans. Mechatronics 16 (2011) 734 (generalised play).
    """

    id = "asymmetric_hysteresis"
    stage = "hysteresis"
    start = 1e-2
    weakest = 1e-6
    strongest = 0.6

    thresholds_V: tuple[float, ...] = field(default=(), kw_only=True)
    weights: tuple[float, ...] = field(default=(), kw_only=True)
    side: float = field(default=1.0, kw_only=True)

    @classmethod
    def drawn(cls, situation: Situation, rng: np.random.Generator) -> "AsymmetricHysteresis":
        """One of three, on either side."""
        kinds = ["dead_zones", "unequal_slopes", "bent_input", "exponential_input", "one_polarity"]
        variant = str(rng.choice(kinds))
        # Dead zones, or plays.
        widest = {"dead_zones": 45.0, "one_polarity": 20.0}.get(variant, 0.0)
        thresholds = np.sort(rng.uniform(0, widest, 3)) if widest else np.empty(0)
        return cls(
            variant=variant,
            thresholds_V=tuple(thresholds.tolist()),
            weights=tuple(rng.dirichlet(np.full(thresholds.size, 3.0)).tolist()) if thresholds.size else (),
            side=float(rng.choice([-1.0, 1.0])),
        )

    def on_hysteresis_input(self, drive_V: np.ndarray, grid: Grid) -> np.ndarray:
        """The bend."""
        if not self.strength:
            return drive_V
        if self.variant == "exponential_input":
            scale = 50.0 / (self.side * self.strength)  # the parabola's curvature at 0 V
            return scale * np.expm1(drive_V / scale)
        if self.variant != "bent_input":
            return drive_V
        return drive_V + self.side * self.strength * drive_V**2 / 100.0

    def on_plays(self, settings: PlaySettings) -> PlaySettings:
        """Envelopes of unequal slope."""
        return replace(settings, skew=self.side * self.strength) if self.variant == "unequal_slopes" else settings

    def on_hysteretic(self, hysteretic_V: np.ndarray, grid: Grid) -> np.ndarray:
        """Dead zones, or plays, on one side."""
        if self.variant not in ("dead_zones", "one_polarity") or not self.strength:
            return hysteretic_V
        if self.variant == "one_polarity":
            there = np.maximum(self.side * hysteretic_V, 0.0)
            slips = play_sum_V(there, np.array(self.thresholds_V), np.array(self.weights), grid.periodic)
            return hysteretic_V + self.side * self.strength * slips
        added = sum(
            weight * np.maximum(self.side * hysteretic_V - threshold, 0.0)
            for weight, threshold in zip(self.weights, self.thresholds_V, strict=True)
        )
        return hysteretic_V + self.side * self.strength * np.asarray(added)

    def parameters(self) -> dict[str, Any]:
        """Share of the voltage, or of the thresholds."""
        named = {"asymmetry": self.side * self.strength}
        return {**named, "thresholds_V": list(self.thresholds_V), "weights": list(self.weights)}
