"""Baselines for a mismatch, tried on the campaigns of the proof: refit, SINDy, ridge regression, neural network."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from inkjet_env.experiments.proof.campaign_files import unpack


def baselines(packed: bytes, truth: Sequence[str], verdict: Mapping[str, Any]) -> dict[str, Any]:
    """Held-out RMS over the noise of each baseline on a campaign, and the judgement of the effects it names.

    The baselines need the base model of a diagnosis, so the campaign is diagnosed once more here.

    Parameters
    ----------
    packed : bytes
        Files of the campaign.
    truth : sequence of str
        Ids of the concealed effects.
    verdict : dict
        The ``diagnosis/1`` of the blind run.

    Returns
    -------
    dict
        ``over_noise`` and ``judged`` by baseline, the groups that ``pysindy`` names, and whether the diagnosis gave the
        ``same`` verdict again.
    """
    from inkjet_env.experiments.validation.baselines.compare import METHODS, compared, verdict_on
    from inkjet_env.experiments.validation.baselines.sindy import said
    from inkjet_env.mismatch import diagnose
    from inkjet_env.recordings import read_campaign

    with tempfile.TemporaryDirectory(prefix="inkjet-peers-") as scratch:
        folder = Path(scratch) / "campaign"
        unpack(packed, folder)
        campaign = read_campaign(folder)
    found = diagnose(campaign, rng=0, workers=1)
    row = compared(campaign, found, 0)
    named = said([term for terms in row["terms"].values() for term in terms])
    groups = [[effect.effect.id] for effect in found.effects]
    words = {baseline: verdict_on(named if baseline == "pysindy" else (), truth) for baseline in METHODS}
    words["diagnosis"] = (
        "nothing" if not groups and found.verdict == "unknown" else verdict_on(_with_sets(found), truth)
    )
    same = [effect["id"] for effect in verdict["effects"]] == [effect.effect.id for effect in found.effects]
    return {
        "over_noise": row["over_noise"],
        "judged": words,
        "pysindy": [list(group) for group in named],
        "same": same and verdict["verdict"] == found.verdict,
    }


def _with_sets(found: Any) -> list[tuple[str, ...]]:
    """The named effects, each with those from which it could not be distinguished."""
    groups = []
    for effect in found.effects:
        mine = next((group for group in found.candidates if effect.effect.id in group), (effect.effect.id,))
        groups.append(tuple(mine))
    return groups
