"""Evaluation of a given printhead, with or without effects, on a campaign: the format ``evaluation/1``."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.cli.campaign_reading import Reading, warn
from inkjet_env.identification import evaluate
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import chosen_head, remainder_sentence


def evaluation_json(
    folder: Path, head_file: Path | None, reading: Reading, remainder: bool = True
) -> tuple[dict[str, Any], str]:
    """The ``evaluation/1`` of a printhead on the campaign in a folder, and the unit of its overall ``rms``.

    The overall ``rms`` is over all samples of the fast channel: self-sensing, else displacement, else the strain gauge.
    ``remainder`` says whether a remainder that the file has is used. Warnings go to standard error.
    """
    campaign = reading.campaign(folder)
    head = chosen_head(head_file, remainder)
    warn(reading.warnings(campaign, head))
    gains = {} if head_file is None or isinstance(head, AugmentedPrinthead) else _gains(head_file)
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
    recordings = {e.recording.name: {"rms": e.rms, "output_rms": e.output_rms, "unit": e.recording.unit} for e in found}
    rms = float(np.sqrt(np.mean(residuals**2)))
    return {"format": "evaluation/1", "recordings": recordings, "rms": rms}, mine[0].recording.unit


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
