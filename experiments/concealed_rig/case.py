"""A case: what is concealed, how strongly, and from which seed everything is drawn."""

from dataclasses import dataclass

import numpy as np

from experiments.concealed_rig.effects.catalogue import CATALOGUE, DEVELOPMENT, OUTSIDE
from experiments.concealed_rig.noise_kinds import NOISES

BASES = ("bouc_wen", "preisach")
STRENGTHS = {"strong": 2.0, "medium": 0.5, "faint": 0.1}
FAMILIES = {"null": 0, "effect": 1, "outside": 1, "base": 1, "pair": 2}


@dataclass(frozen=True)
class Case:
    """One case of the proof.

    Parameters
    ----------
    number : int
        For people, and for the draws: two numbers are two draws of one seed.
    seed : int
    family : str
        "null", "effect", "outside", "base" or "pair".
    effects : tuple of str
        Ids of the catalogue (effect: one, pair: two of different stages), a family outside it (`OUTSIDE`, or
        `DEVELOPMENT` where it is no secret), or a base law.
    strength : str or float or None
        "strong", "medium", "faint", or rho itself; None where nothing is planted, and for a base law in full.
    meagre : bool
        Eight recordings of self-sensing alone.
    displacement : bool
        Three more recordings, by a vibrometer.
    noise : str
        Kind of noise on all channels, one of `NOISES`; empty: drawn.
    slow_only : bool
        The strain gauge's recordings alone.

    Raises
    ------
    ValueError
        Where these do not go together.
    """

    number: int
    seed: int
    family: str = "null"
    effects: tuple[str, ...] = ()
    strength: str | float | None = None
    meagre: bool = False
    displacement: bool = False
    noise: str = ""
    slow_only: bool = False

    def __post_init__(self) -> None:
        if self.number < 0 or self.seed < 0:
            raise ValueError(f"number and seed must be 0 or larger; got {self.number} and {self.seed}.")
        if self.family not in FAMILIES:
            raise ValueError(f"family must be one of {', '.join(FAMILIES)}; got {self.family!r}.")
        if len(self.effects) != FAMILIES[self.family]:
            wanted = FAMILIES[self.family]
            raise ValueError(f"A case of the family {self.family} conceals {wanted}; got {self.effects}.")
        allowed = {"outside": (*OUTSIDE, *DEVELOPMENT), "base": BASES}.get(self.family, tuple(CATALOGUE))
        for name in self.effects:
            if name not in allowed:
                raise ValueError(f"{name!r} is not of the family {self.family}: {', '.join(allowed)}.")
        if self.family == "pair" and len({CATALOGUE[name].stage for name in self.effects}) < 2:
            raise ValueError(f"The effects of a pair must act in different stages; got {self.effects}.")
        if self.noise and self.noise not in NOISES:
            raise ValueError(f"noise must be one of {', '.join(NOISES)}, or empty; got {self.noise!r}.")
        if self.slow_only and (self.meagre or self.displacement):
            raise ValueError("slow_only is the strain gauge alone: neither meagre nor with a vibrometer.")
        if self.rho is None and self.family not in ("null", "base"):
            raise ValueError("strength must be given where something is planted: strong, medium, faint or a number.")
        if self.rho is not None and self.family == "null":
            raise ValueError("strength must be None where nothing is planted.")

    @property
    def noise_kind(self) -> str:
        """The kind of noise, as asked or as drawn."""
        return self.noise or str(self.generator("kind of noise").choice(NOISES))

    @property
    def rho(self) -> float | None:
        """RMS of the mismatch over the noise that is asked for."""
        if self.strength is None:
            return None
        value = STRENGTHS.get(self.strength) if isinstance(self.strength, str) else float(self.strength)
        if value is None or not 0 < value < 100:
            raise ValueError(f"strength must be strong, medium, faint or 0 … 100; got {self.strength!r}.")
        return value

    def generator(self, purpose: str) -> np.random.Generator:
        """Random numbers of one purpose: what is concealed changes none of the others'."""
        purposes = ("head", "plan", "effect", "chance", "noise", "instruments", "fresh", "kind of noise")
        return np.random.default_rng([self.seed, self.number, purposes.index(purpose)])
