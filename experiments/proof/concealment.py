"""The only interface to the concealed plant: it turns a draw into a campaign with its truth, or into the plant."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from inkjet_env.experiments.concealed_plant import RIG, import_rig
from inkjet_env.experiments.proof.campaign_files import ProofError, check_campaign_only, digest, pack
from inkjet_env.experiments.proof.corpus import MOST_ATTEMPTS, Draw

OUT_OF_REACH = re.compile(r" does not reach rho | cannot be as faint as rho |: no strength gives rho ")
"""Matches the message of the plant's ValueError if no strength within an effect's bounds gives the requested mismatch;
the plant raises that type for all other errors too."""


@dataclass(frozen=True)
class PackedCase:
    """One concealed case.

    Attributes
    ----------
    packed : bytes
        Files of the campaign, from `campaign_files.pack`.
    digest : str
        SHA-256 of the campaign's folder.
    truth : dict
        Description of the plant, as plain JSON values.
    attempt : int
        Number, from 0, of the first attempt at which the draw was physically possible.
    """

    packed: bytes
    digest: str
    truth: Mapping[str, Any]
    attempt: int


def conceal(draw: Draw, name: str, rig: str = RIG) -> PackedCase:
    """Draw, record and pack a case.

    Parameters
    ----------
    draw : Draw
        The case of the corpus.
    name : str
        Opaque name of the campaign.
    rig : str
        Module of the concealed plant.

    Raises
    ------
    ProofError
        None of `MOST_ATTEMPTS` attempts gave the requested strength.
    RuntimeError
        The plant refused the draw for another reason, which a further attempt would mask.
    """
    reason = ""
    for attempt in range(MOST_ATTEMPTS):
        try:
            plant = plant_of(draw, attempt, rig)
        except ValueError as error:
            if not OUT_OF_REACH.search(str(error)):
                raise RuntimeError(f"{_described(draw)} cannot be built at attempt {attempt}: {error}") from error
            reason = str(error)
            continue  # draw again
        with tempfile.TemporaryDirectory(prefix="inkjet-conceal-") as scratch:
            folder = Path(scratch) / name
            plant.write(folder, name)
            check_campaign_only(folder)
            return PackedCase(pack(folder), digest(folder), plant.truth(), attempt)
    raise ProofError(f"{_described(draw)} was drawn {MOST_ATTEMPTS} times without success: {reason}")


def _described(draw: Draw) -> str:
    return f"case {draw.number} ({draw.family} {'+'.join(draw.effects)}, {draw.strength})"


def families(rig: str = RIG, published: bool = False) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Families of effects that no catalogue contains, the plant's own hysteresis laws, and its kinds of noise.

    Parameters
    ----------
    rig : str
        Module of the concealed plant.
    published : bool
        Whether the families are those of the published corpus; development sees others.
    """
    module = import_rig(f"{rig}.case")
    outside = module.OUTSIDE if published else module.DEVELOPMENT
    return tuple(outside), tuple(module.BASES), tuple(module.NOISES)


def plant_of(draw: Draw, attempt: int, rig: str = RIG) -> Any:
    """The concealed plant of a case; the same at every call."""
    module = import_rig(rig)
    case = module.Case(
        number=draw.number,
        seed=draw.case_seed(attempt),
        family=draw.family,
        effects=draw.effects,
        strength=None if draw.strength == "none" else draw.strength,
        meagre=draw.meagre,
        noise=draw.noise,
        slow_only=draw.slow_only,
    )
    return module.build(case)
