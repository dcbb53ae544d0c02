"""What a remainder does on held-out recordings, in plain words."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from inkjet_env.identification.modelled_recording import ModelledRecording
from inkjet_env.plant.wording import CHANNEL_WORDS, percent, with_prefix


def remainder_sentence(
    recordings: Sequence[ModelledRecording], channels: Collection[str], carrier: str, share: float
) -> str:
    """One sentence about a remainder.

    Parameters
    ----------
    recordings : sequence of ModelledRecording
        Recordings with the signals of the models "base", "augmented" and "with_remainder".
    channels : collection of str
        Channels with a remainder; each has held-out samples.
    carrier : {"base", "augmented"}
        Model that the remainder corrects.
    share : float
        Share of the held-out sum of squared residuals that it removes.
    """
    falls = []
    for channel in channels:
        mine = [r for r in recordings if r.channel == channel and r.held_out]
        rows = [r.measured.size - r.fitted for r in mine]
        before, after = (
            float(np.sqrt(np.average([r.rms(model, True) ** 2 for r in mine], weights=rows)))
            for model in (carrier, "with_remainder")
        )
        told = (with_prefix(rms, mine[0].unit, 3) for rms in (before, after))
        falls.append(f"{CHANNEL_WORDS[channel]} from {' to '.join(told)}")
    beside = "the base model" if carrier == "base" else "the named effects"
    return (
        f"An unexplained remainder beside {beside} removes {percent(share)} of the squared residuals of held-out "
        f"recordings (RMS: {', '.join(falls)}); it corrects without explaining."
    )
