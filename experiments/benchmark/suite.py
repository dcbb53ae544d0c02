"""The problems on which optimisers are compared: named instances in families, versioned.

Besides these, `problem` takes those that other packages offer as entry points of the group ``inkjet_env.problems``, and
``module:name`` for one of your own; see `inkjet_env.plugins`."""

from __future__ import annotations

import copy
import functools
from collections.abc import Mapping

from inkjet_env import plugins
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
    ``greyscale``
        Two to seven drops, 35 µs apart, that merge to one dot; see `inkjet_env.experiments.benchmark.grey_level`.
    ``late``
        The named number of instruments read beside each other; their readings come late, in another order or never,
        and time is what a search spends; see `inkjet_env.experiments.benchmark.late_benches`.
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
        "greyscale": tuple(
            Problem(f"greyscale-{pulses}", bounds=_durations(7e-6), jetting_Hz=1 / 35e-6, pulses=pulses)
            for pulses in range(2, 8)
        ),
        "late": tuple(Problem(f"late-{count}", instruments=count) for count in (8, 32)),
        "augmented": tuple(Problem(name, augmented_head(name)) for name in HEADS),
    }


@functools.cache
def suite() -> dict[str, Problem]:
    """All instances by name."""
    return {problem.name: problem for family in families().values() for problem in family}


def problem(name: str) -> Problem:
    """The problem of that name.

    Parameters
    ----------
    name : str
        One of `suite` or `installed`; or ``module:name`` of a `Problem`, or of something that returns one when called.

    Raises
    ------
    ValueError
        There is no such problem; the message suggests the nearest name.
    """
    if name in suite():
        return suite()[name]
    return _problem_elsewhere(name)


@functools.cache
def _problem_elsewhere(name: str) -> Problem:
    found = _plugin(name)
    if found is None:
        check_name("problem", name, [*suite(), *installed()])
    assert found is not None
    try:
        made = found.load()
        if callable(made):
            made = made()
    except Exception as error:
        reason = error if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        raise ValueError(f"problem {name}: {reason}") from error
    if not isinstance(made, Problem):
        raise ValueError(
            f"problem {name}: it must be an inkjet_env.experiments.benchmark.problem.Problem; got {made!r}."
        )
    named = copy.copy(made)
    object.__setattr__(named, "name", name)  # a subclass may have another constructor than `dataclasses.replace` needs
    return named


def _plugin(name: str) -> plugins.Plugin | None:
    try:
        return plugins.plugin(plugins.PROBLEMS, name, suite())
    except ValueError as error:
        raise ValueError(f"problem {name}: {error}") from None


def installed() -> tuple[str, ...]:
    """Names of the problems that other installed packages offer."""
    return tuple(plugins.installed(plugins.PROBLEMS, suite()))


def provenance(name: str) -> dict[str, str] | None:
    """Place, code and package of a problem that is not of the suite; None for one that is."""
    if name in suite():
        return None
    found = _plugin(name)
    return None if found is None else found.provenance()


def family_of(name: str) -> str:
    """The family of an instance; "own" for a problem that is not of the suite."""
    return next((family for family, problems in families().items() if any(p.name == name for p in problems)), "own")
