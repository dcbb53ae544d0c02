"""What may be concealed."""

from dataclasses import dataclass

OUTSIDE = {"coulomb_friction": None, "clock_jitter": None}
BASES = ("bouc_wen",)


@dataclass(frozen=True)
class Case:
    number: int
    seed: int
    family: str
    effects: tuple
    strength: str | None
    meagre: bool
