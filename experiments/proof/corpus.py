"""Which cases a proof holds: decided by a version, a seed and a profile, and by nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from itertools import combinations
from typing import Any

import numpy as np

from inkjet_env.printhead import check_name

VERSION = 1
"""Of the corpus: raised whenever other cases are drawn, so that results of two corpora never mix."""
PUBLISHED_SEED = 1192
"""Run once a version, when the code is done; whatever is tried before is tried on other seeds."""
DEVELOPMENT_SEED = 1
PROFILES = ("full", "quick")
STRENGTHS = ("strong", "medium", "faint")
STAGES = {
    "amplifier_bandwidth": "drive", "slew_limit": "drive", "trigger_delay": "drive",
    "creep": "hysteresis", "rate_dependent_hysteresis": "hysteresis", "asymmetric_hysteresis": "hysteresis",
    "cubic_stiffness": "resonator", "quadratic_damping": "resonator", "ferroelastic_softening": "resonator",
    "second_mode": "resonator", "wave_echo": "resonator", "air_bubble": "resonator", "meniscus_refill": "resonator",
    "thermal_drift": "resonator",
    "feedthrough": "sensing", "sensor_bandwidth": "sensing", "sensor_saturation": "sensing", "mains_hum": "sensing",
    "baseline_drift": "sensing", "crosstalk": "sensing",
}  # fmt: skip
"""The ids that a verdict may name, as the contract of the command lists them."""
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
    """

    number: int
    family: str
    effects: tuple[str, ...]
    strength: str
    meagre: bool
    seed: int

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


def corpus(seed: int, profile: str, outside: Sequence[str], bases: Sequence[str]) -> list[Draw]:
    """All cases of a corpus, in the order of their numbers.

    Parameters
    ----------
    seed : int
    profile : {"full", "quick"}
        1,200 cases, or 60 of every kind.
    outside, bases : sequence of str
        What the concealed plant offers beyond the catalogue, and as laws of hysteresis of its own.

    Raises
    ------
    ValueError
        An unknown profile.
    """
    check_name("profile", profile, PROFILES)
    rng = np.random.default_rng([VERSION, seed])
    kinds = _full(rng, outside, bases) if profile == "full" else _quick(rng, outside, bases)
    return [Draw(number, *kind, seed) for number, kind in enumerate(kinds)]


Kind = tuple[str, tuple[str, ...], str, bool]


def _full(rng: np.random.Generator, outside: Sequence[str], bases: Sequence[str]) -> Iterator[Kind]:
    yield from [("null", (), "none", False)] * 300
    for strength in STRENGTHS:
        yield from (("effect", (name,), strength, False) for name in STAGES for _ in range(10))
    for k in range(120):
        yield "outside", (outside[(k // 2) % len(outside)],), STRENGTHS[k % 2], False
    yield from (("pair", pair, "strong", False) for pair in _pairs(rng, 100))
    yield from (("base", (bases[k % len(bases)],), "none", False) for k in range(40))
    yield from [("null", (), "none", True)] * 10
    yield from (("effect", (name,), "strong", True) for name in STAGES)
    yield from (("outside", (outside[k % len(outside)],), "strong", True) for k in range(10))


def _quick(rng: np.random.Generator, outside: Sequence[str], bases: Sequence[str]) -> Iterator[Kind]:
    """Of every kind, as many as two cores diagnose in a quarter of an hour: meagre campaigns cost a third."""
    ids = [str(name) for name in rng.permutation(list(STAGES))]
    others = [str(name) for name in rng.permutation(list(outside))]
    yield from [("null", (), "none", False)] * 8
    yield from (("effect", (name,), "medium" if k < 6 else "strong", False) for k, name in enumerate(ids))
    yield from (("outside", (others[k % len(others)],), "strong", False) for k in range(2))
    yield from (("pair", pair, "strong", False) for pair in _pairs(rng, 2))
    yield "base", (str(rng.choice(list(bases))),), "none", False
    yield from [("null", (), "none", True)] * 8
    yield from (("effect", (name,), "strong", True) for name in ids[:13])
    yield from (("outside", (others[(2 + k) % len(others)],), "strong", True) for k in range(6))


def _pairs(rng: np.random.Generator, count: int) -> list[tuple[str, ...]]:
    """Two effects of different stages at once, no pair twice."""
    pairs = [pair for pair in combinations(STAGES, 2) if STAGES[pair[0]] != STAGES[pair[1]]]
    return [pairs[k] for k in rng.permutation(len(pairs))[:count]]


def opaque_name(salt: str, draw: Draw) -> str:
    """Name of a campaign, which tells nothing without the salt."""
    return "head-" + sha256(f"{salt}|{VERSION}|{draw.seed}|{draw.number}".encode()).hexdigest()[:12]
