"""The problems on which optimisers are compared: named instances in families, versioned."""

from __future__ import annotations

import functools
from collections.abc import Mapping

from inkjet_env.experiments.benchmark.augmented_heads import HEADS, augmented_head
from inkjet_env.experiments.benchmark.problem import Problem, Spread
from inkjet_env.printhead import Bounds, PeakCost, Printhead, check_name

VERSION = 2
"""Version of the suite, raised when an instance changes or is removed; a new instance leaves other results valid."""
BENCHED = ("nominal", "literal-5-1", "literal-10-5", "stiff-head", "soft-head")
"""Names of the instances that a comparison uses by default."""


def _durations(longest_s: float) -> Bounds:
    return Bounds(upper=(100.0, 0.0, *[longest_s] * 5))


@functools.cache
def families() -> Mapping[str, tuple[Problem, ...]]:
    """The instances by family.

    ``cost``
        The default problem, and the cost as printed in the paper ("first" peak) with weights at which a zero waveform
        is not the optimum.
    ``head``, ``hysteresis``, ``damping``
        The published head with another resonance, damping, gain and hysteresis; a single property in the last two.
    ``durations``
        Edges and dwells of at most 10 or 40 µs instead of 20 µs.
    ``reading``
        Peak heights are measured with an error of the named standard deviation.
    ``drop``
        The effective peak must reach the named height, and more is no better: one volt less costs more than all
        ringing.
    ``lot``
        Sixteen heads within 5 % of the published one, judged by the worst or by the mean.
    ``train``
        Drops at a jetting frequency, in the steady state: each waveform starts in the ringing of those before it.
    ``augmented``
        Heads with an effect, as a diagnosis found them; see `inkjet_env.experiments.benchmark.augmented_heads`.
    """
    published = Printhead.published()
    varied = published.varied
    return {
        "cost": (
            Problem("nominal"),
            Problem("literal-5-1", cost=PeakCost(-5.0, 1.0, "first")),
            Problem("literal-10-5", cost=PeakCost(-10.0, 5.0, "first")),
        ),
        "head": (
            Problem("stiff-head", varied(65e3, 0.035, 1.2, 0.7)),
            Problem("soft-head", varied(38e3, 0.07, 0.8, 1.3)),
            Problem("fast-head", varied(70e3, 0.03, 1.3, 1.4)),
            Problem("slow-head", varied(35e3, 0.08, 0.7, 0.6)),
        ),
        "hysteresis": tuple(
            Problem(f"hysteresis-{100 * strength:.0f}", varied(hysteresis_strength=strength))
            for strength in (0.0, 0.5, 1.5)
        ),
        "damping": tuple(Problem(f"damping-{ratio:g}", varied(damping_ratio=ratio)) for ratio in (0.02, 0.01)),
        "durations": tuple(Problem(f"durations-{us}us", bounds=_durations(us * 1e-6)) for us in (10, 40)),
        "reading": tuple(Problem(f"reading-{mV}mV", measurement_noise_V=1e-3 * mV) for mV in (50, 200)),
        "drop": tuple(Problem(f"drop-{V}V", cost=PeakCost(-50.0, 5.0, target_height_V=float(V))) for V in (4, 6)),
        "lot": tuple(Problem(f"lot-{judged}", spread=Spread(judged=judged)) for judged in ("worst", "mean")),
        "train": tuple(
            Problem(f"train-{kHz}kHz", bounds=_durations(min(20e-6, 0.2e-3 / kHz)), jetting_Hz=1e3 * kHz)
            for kHz in (5, 10, 20)
        ),
        "augmented": tuple(Problem(name, augmented_head(name)) for name in HEADS),
    }


@functools.cache
def suite() -> dict[str, Problem]:
    """All instances by name."""
    return {problem.name: problem for family in families().values() for problem in family}


def problem(name: str) -> Problem:
    """The instance of that name; an unknown name raises a ``ValueError`` that suggests the nearest."""
    check_name("problem", name, suite())
    return suite()[name]


def family_of(name: str) -> str:
    """The family of an instance."""
    return next(family for family, problems in families().items() if any(one.name == name for one in problems))
