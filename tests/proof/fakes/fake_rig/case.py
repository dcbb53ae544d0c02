"""What may be concealed."""

from dataclasses import dataclass

OUTSIDE = {"one_sided_stop": None, "doppler_delay": None}
DEVELOPMENT = {"cavitation": None, "clock_jitter": None}
BASES = ("bouc_wen",)
NOISES = ("white", "flicker")


@dataclass(frozen=True)
class Case:
    number: int
    seed: int
    family: str
    effects: tuple
    strength: str | None
    meagre: bool
    noise: str = ""
    slow_only: bool = False
