"""Evaluation of a given printhead, with or without effects, on a campaign: the format ``evaluation/1``."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.cli.campaign_reading import Reading, print_notes, warn
from inkjet_env.identification import evaluate
from inkjet_env.identification.agreement import agreement_sentence, agreements
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import chosen_head, remainder_sentence
from inkjet_env.printhead import Printhead
from inkjet_env.progress import shown_steps
from inkjet_env.recordings import Campaign


def evaluation_json(
    folder: Path, head_file: Path | None, reading: Reading, remainder: bool = True
) -> tuple[dict[str, Any], str]:
    """The ``evaluation/1`` of a printhead on the campaign in a folder, and the unit of its overall ``rms``.

    The overall ``rms`` is over all samples of the fast channel: self-sensing, else displacement, else the strain gauge.
    ``remainder`` says whether a remainder that the file has is used. Warnings go to standard error.
    """
    head = chosen_head(head_file, remainder)
    with shown_steps(f"evaluate {folder}") as step:
        return _evaluated(reading.campaign(folder, step), head, head_file, reading, step)


def _evaluated(
    campaign: Campaign,
    head: Printhead | AugmentedPrinthead,
    head_file: Path | None,
    reading: Reading,
    step: Callable[[str], None],
) -> tuple[dict[str, Any], str]:
    """The ``evaluation/1`` of a head from that file, if from any, on a campaign; and the unit of its ``rms``."""
    warn(reading.warnings(campaign, head))
    print_notes(campaign)
    gains = {} if head_file is None or isinstance(head, AugmentedPrinthead) else _gains(head_file)
    step("simulating")
    try:
        found, refitted = evaluate(campaign, head, gains)
    except FloatingPointError as error:
        raise ValueError(f"{head_file}: the printhead cannot be simulated on these recordings: {error}") from None
    for channel in refitted:
        print(f"warning: the printhead file gives no gain for {channel}; it was fitted here.", file=sys.stderr)
    channels = {e.recording.channel for e in found}
    largest_V = max(float(np.abs(e.recording.drive_V).max()) for e in found)
    if (said := remainder_sentence(head, channels, largest_V)) is not None:
        print(said, file=sys.stderr)
    main = next(c for c in ("self_sensing", "displacement", "strain_gauge") if c in channels)
    mine = [e for e in found if e.recording.channel == main]
    residuals = np.concatenate([e.recording.sensor - e.modelled for e in mine])
    agreed = agreements(campaign, found, {} if head_file is None else _residuals(head_file, main))
    recordings = {
        one.name: {
            "rms": one.rms,
            "output_rms": one.output_rms,
            "unit": one.unit,
            "noise_rms": None if math.isnan(one.noise_rms) else one.noise_rms,
            "differs": one.differs,
        }
        for one in agreed
    }
    told = {
        "format": "evaluation/1",
        "recordings": recordings,
        "rms": float(np.sqrt(np.mean(residuals**2))),
        "same_head": not any(one.differs for one in agreed),
        "sentence": agreement_sentence(agreed),
    }
    return told, mine[0].recording.unit


def _gains(head_file: Path) -> dict[str, float]:
    """Gains of the channels from which a ``printhead.json`` was identified; empty if the file does not give them."""
    fit = json.loads(head_file.read_text(encoding="utf-8")).get("fit")
    channels = fit.get("channels") if isinstance(fit, dict) else None
    gains = {}
    for channel, entry in channels.items() if isinstance(channels, dict) else ():
        try:
            gains[channel] = float(entry["gain"]["value"])
        except (KeyError, TypeError, ValueError, OverflowError):
            raise ValueError(f"{head_file}: fit.channels.{channel}.gain.value must be a number.") from None
        if not math.isfinite(gains[channel]):
            raise ValueError(f"{head_file}: fit.channels.{channel}.gain.value must be finite; got {gains[channel]}.")
    return gains


def _residuals(head_file: Path, main: str) -> dict[str, float]:
    """By channel, the residual beyond noise that a head left in recordings held out from its own identification."""
    fit = json.loads(head_file.read_text(encoding="utf-8")).get("fit")
    channels = fit.get("channels") if isinstance(fit, dict) else None
    told = {channel: (entry.get("heldout_rms"), entry.get("noise_rms")) for channel, entry in (channels or {}).items()}
    if isinstance(fit, dict) and "augmented_heldout_rms_V" in fit:  # as a diagnosis writes it, for the main channel
        told[main] = fit["augmented_heldout_rms_V"], fit.get("noise_rms_V")
    return {
        channel: math.sqrt(max(left**2 - noise**2, 0.0))
        for channel, (left, noise) in told.items()
        if isinstance(left, (int, float)) and isinstance(noise, (int, float))
    }
