"""The door to the concealed plant, the only one: a draw becomes a campaign and its truth, or the plant itself again."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from experiments.proof.campaign_files import ProofError, check_campaign_only, digest, pack
from experiments.proof.corpus import MOST_ATTEMPTS, Draw

RIG = "experiments.concealed_rig"
OUT_OF_REACH = re.compile(r" does not reach rho | cannot be as faint as rho |: no strength gives rho ")
"""In the plant's ValueError where no strength within an effect's bounds gives the mismatch that is asked for; it raises
that type for everything else too."""


@dataclass(frozen=True)
class Concealed:
    """What one case has become.

    Attributes
    ----------
    packed : bytes
        The campaign, see `campaign_files.pack`.
    digest : str
        Of its folder.
    truth : dict
        What the plant tells of itself, as plain JSON values.
    attempt : int
        At which physics allowed the draw, from 0.
    """

    packed: bytes
    digest: str
    truth: Mapping[str, Any]
    attempt: int


def conceal(draw: Draw, name: str, rig: str = RIG) -> Concealed:
    """Draw, record and pack a case.

    Parameters
    ----------
    draw : Draw
    name : str
        Of the campaign: opaque.
    rig : str
        Module of the concealed plant.

    Raises
    ------
    ProofError
        No attempt of `MOST_ATTEMPTS` gave the strength that was asked for.
    RuntimeError
        The plant refused the draw for another reason, which another draw would hide.
    """
    reason = ""
    for attempt in range(MOST_ATTEMPTS):
        try:
            plant = plant_of(draw, attempt, rig)
        except ValueError as error:
            if not OUT_OF_REACH.search(str(error)):
                raise RuntimeError(f"{_told(draw)} cannot be built at attempt {attempt}: {error}") from error
            reason = str(error)
            continue  # draw again
        with tempfile.TemporaryDirectory(prefix="inkjet-conceal-") as scratch:
            folder = Path(scratch) / name
            plant.write(folder, name)
            check_campaign_only(folder)
            return Concealed(pack(folder), digest(folder), plant.truth(), attempt)
    raise ProofError(f"{_told(draw)} was drawn {MOST_ATTEMPTS} times in vain: {reason}")


def _told(draw: Draw) -> str:
    return f"case {draw.number} ({draw.family} {'+'.join(draw.effects)}, {draw.strength})"


def families(rig: str = RIG) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the plant can conceal that no catalogue has, and the laws of hysteresis of its own."""
    module = import_module(f"{rig}.case")
    return tuple(module.OUTSIDE), tuple(module.BASES)


def plant_of(draw: Draw, attempt: int, rig: str = RIG) -> Any:
    """The concealed plant of a case: the same at every call."""
    module = import_module(rig)
    case = module.Case(
        number=draw.number,
        seed=draw.case_seed(attempt),
        family=draw.family,
        effects=draw.effects,
        strength=None if draw.strength == "none" else draw.strength,
        meagre=draw.meagre,
    )
    return module.build(case)
