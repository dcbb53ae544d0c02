"""Which cases a proof holds: decided by a version, a seed and a profile, and by nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from itertools import combinations
from typing import Any

import numpy as np

from inkjet_env.printhead import check_name

VERSION = 2
"""Of the corpus: raised whenever other cases are drawn, so that results of two corpora never mix."""
PUBLISHED_SEED = 57289
"""Run once a version, when the code is done; whatever is tried before is tried on other seeds."""
DEVELOPMENT_SEED = 2001
"""Of other seeds than the published one, families outside the catalogue are those that development may see."""
RIGS = {1: "0e17b70"}
"""Commits that hold the concealed plant of earlier versions."""
PROFILES = ("full", "quick")
STRENGTHS = ("strong", "medium", "faint")
STAGES = {
    "amplifier_bandwidth": "drive", "slew_limit": "drive", "trigger_delay": "drive",
    "drive_resonance": "drive", "supply_droop": "drive", "generator_steps": "drive", "nonlinear_capacitance": "drive",
    "creep": "hysteresis", "rate_dependent_hysteresis": "hysteresis", "asymmetric_hysteresis": "hysteresis",
    "backlash": "hysteresis", "voltage_dependent_gain": "hysteresis", "depolarisation": "hysteresis",
    "cubic_stiffness": "resonator", "quadratic_damping": "resonator", "ferroelastic_softening": "resonator",
    "second_mode": "resonator", "wave_echo": "resonator", "air_bubble": "resonator", "meniscus_refill": "resonator",
    "thermal_drift": "resonator", "coulomb_friction": "resonator", "structural_damping": "resonator",
    "self_heating": "resonator",
    "feedthrough": "sensing", "sensor_bandwidth": "sensing", "sensor_saturation": "sensing", "mains_hum": "sensing",
    "baseline_drift": "sensing", "crosstalk": "sensing", "sensor_highpass": "sensing", "timebase_error": "sensing",
}  # fmt: skip
"""The ids that a verdict may name, as the contract of the command lists them."""
LATER = (
    "drive_resonance", "supply_droop", "generator_steps", "nonlinear_capacitance", "backlash",
    "voltage_dependent_gain", "depolarisation", "coulomb_friction", "structural_damping", "self_heating",
    "sensor_highpass", "timebase_error",
)  # fmt: skip
IDS = {1: tuple(name for name in STAGES if name not in LATER), 2: tuple(STAGES)}
"""The ids of the catalogue by version of the corpus."""
SLOW = ("creep", "rate_dependent_hysteresis", "asymmetric_hysteresis")
"""Effects that campaigns of the strain gauge alone conceal."""
FULL_SIZE = {1: 1200, 2: 717}
"""Number of cases of the full corpus by version."""
MOST_ATTEMPTS = 20


@dataclass(frozen=True)
class Draw:
    """One case as it is drawn; `experiments.proof.concealment` makes a campaign of it.

    Attributes
    ----------
    number : int
        From 0, within the corpus.
    family : {"null", "effect", "outside", "base", "pair"}
        Nothing concealed; an effect of the catalogue; one that no catalogue has; a hysteresis of another law; two
        effects of different stages.
    effects : tuple of str
        Ids of effects, or the name of the family outside the catalogue or of the other law.
    strength : {"none", "strong", "medium", "faint"}
    meagre : bool
        Eight recordings of one channel in place of a whole campaign.
    seed : int
        Of the proof.
    noise : str
        Kind of noise on all channels; empty in version 1, whose plant drew it.
    slow_only : bool
        The strain gauge's recordings alone.
    """

    number: int
    family: str
    effects: tuple[str, ...]
    strength: str
    meagre: bool
    seed: int
    noise: str = ""
    slow_only: bool = False

    def case_seed(self, attempt: int) -> int:
        """Seed of the case, 48 bits; another for every attempt at drawing what physics allows."""
        text = f"proof/{VERSION}|{self.seed}|{self.number}|{attempt}"
        return int.from_bytes(sha256(text.encode()).digest()[:6], "big")

    def as_json(self) -> dict[str, Any]:
        """As plain JSON values."""
        return asdict(self) | {"effects": list(self.effects)}

    @classmethod
    def from_json(cls, entry: dict[str, Any]) -> Draw:
        """What `as_json` wrote."""
        return cls(**(entry | {"effects": tuple(entry["effects"])}))


def corpus(
    seed: int, profile: str, outside: Sequence[str], bases: Sequence[str], noises: Sequence[str] = ("",)
) -> list[Draw]:
    """All cases of a corpus, in the order of their numbers.

    Parameters
    ----------
    seed : int
    profile : {"full", "quick"}
        717 cases, or 60 of every kind.
    outside, bases, noises : sequence of str
        What the concealed plant offers beyond the catalogue, as laws of hysteresis of its own, and as kinds of noise.

    Raises
    ------
    ValueError
        An unknown profile.
    """
    check_name("profile", profile, PROFILES)
    rng = np.random.default_rng([VERSION, seed])
    kinds = list(_full(rng, outside, bases) if profile == "full" else _quick(rng, outside, bases))
    drawn = _noises(rng, kinds, noises)
    return [
        Draw(number, *kind[:4], seed, noise, kind[4])
        for number, (kind, noise) in enumerate(zip(kinds, drawn, strict=True))
    ]


Kind = tuple[str, tuple[str, ...], str, bool, bool]


def _noises(rng: np.random.Generator, kinds: Sequence[Kind], noises: Sequence[str]) -> list[str]:
    """A kind of noise for each case, evenly over the nulls and over the others: round by round, each in a new order."""
    rounds: dict[bool, list[str]] = {True: [], False: []}
    drawn = []
    for kind in kinds:
        left = rounds[kind[0] == "null"]
        if not left:
            left.extend(noises[k] for k in rng.permutation(len(noises)))
        drawn.append(left.pop())
    return drawn


def _full(rng: np.random.Generator, outside: Sequence[str], bases: Sequence[str]) -> Iterator[Kind]:
    yield from [("null", (), "none", False, False)] * 192
    for strength, count in zip(STRENGTHS, (5, 4, 1), strict=True):
        yield from (("effect", (name,), strength, False, False) for name in STAGES for _ in range(count))
    for k in range(60):
        yield "outside", (outside[(k // 2) % len(outside)],), STRENGTHS[k % 2], False, False
    yield from (("pair", pair, "strong", False, False) for pair in _pairs(rng, 50))
    yield from (("base", (bases[k % len(bases)],), "none", False, False) for k in range(20))
    yield from [("null", (), "none", True, False)] * 16
    yield from (("effect", (name,), "strong", True, False) for name in STAGES)
    yield from (("outside", (outside[k % len(outside)],), "strong", True, False) for k in range(12))
    yield from [("null", (), "none", False, True)] * 6
    yield from (("effect", (name,), "strong", False, True) for name in SLOW for _ in range(3))


def _quick(rng: np.random.Generator, outside: Sequence[str], bases: Sequence[str]) -> Iterator[Kind]:
    """Of every kind, few: meagre campaigns cost a third."""
    ids = [str(name) for name in rng.permutation(list(STAGES))]
    others = [str(name) for name in rng.permutation(list(outside))]
    yield from [("null", (), "none", False, False)] * 8
    yield from (("effect", (name,), "medium" if k < 10 else "strong", False, False) for k, name in enumerate(ids))
    yield from (("outside", (others[k % len(others)],), "strong", False, False) for k in range(2))
    yield from (("pair", pair, "strong", False, False) for pair in _pairs(rng, 2))
    yield "base", (str(rng.choice(list(bases))),), "none", False, False
    yield from [("null", (), "none", True, False)] * 4
    yield from (("effect", (name,), "strong", True, False) for name in ids[:5])
    yield from (("outside", (others[(2 + k) % len(others)],), "strong", True, False) for k in range(4))
    yield "null", (), "none", False, True
    yield "effect", (str(rng.choice(list(SLOW))),), "strong", False, True


def _pairs(rng: np.random.Generator, count: int) -> list[tuple[str, ...]]:
    """Two effects of different stages at once, no pair twice."""
    pairs = [pair for pair in combinations(STAGES, 2) if STAGES[pair[0]] != STAGES[pair[1]]]
    return [pairs[k] for k in rng.permutation(len(pairs))[:count]]


def opaque_name(salt: str, draw: Draw) -> str:
    """Name of a campaign, which tells nothing without the salt."""
    return "head-" + sha256(f"{salt}|{VERSION}|{draw.seed}|{draw.number}".encode()).hexdigest()[:12]
