"""Errors of base and augmented model against the concealed plant, on drives that neither model has seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

NODES_A_PERIOD = 200
LEAST_CLOSURE = -1e3
"""Lower limit of the closure; also that of a model whose response to a fresh drive is unbounded."""
UNPREDICTABLE = tuple(effect.id for effect in catalogue() if not effect.predictable)
"""Effects that do not show on fresh drives, which have no neighbour's drive: both models predict the same there."""


@dataclass(frozen=True, eq=False)
class Model:
    """A head, with or without effects, and its sensors; made by `model_of`.

    Attributes
    ----------
    head : Printhead or AugmentedPrinthead
        The head.
    plant : Plant
        The simulated head with its sensors.
    order : int
        Order of the recording at which the model is valid.
    channels : frozenset of str
        Channels with a known gain.
    """

    head: Printhead | AugmentedPrinthead
    plant: Plant
    order: int
    channels: frozenset[str]

    def signal(self, drive_V: Real, step_s: float, channel: str, initial_state: str) -> Real:
        """Predicted sensor signal up to an offset, in the channel's unit, shape (n,).

        Raises
        ------
        FloatingPointError
            The motion grows without bound.
        """
        substeps = 2 * max(1, math.ceil(NODES_A_PERIOD * self.plant.printhead.frequency_Hz * step_s / 2))
        substeps = substeps if channel != "strain_gauge" else 2
        return self.plant.signal(Excitation(channel, initial_state, step_s, drive_V, self.order, substeps=substeps))


def model_of(data: Mapping[str, Any]) -> Model:
    """The model that a ``printhead/1`` describes; ``ValueError`` if `printhead_of` refuses it."""
    head = printhead_of(data)
    channels = (data.get("fit") or {}).get("channels") or {}
    gains = {channel: float(entry["gain"]["value"]) for channel, entry in channels.items() if "gain" in entry}
    known = frozenset({"self_sensing", *gains})
    if isinstance(head, AugmentedPrinthead):
        return Model(
            head, Plant(head.printhead, gains, effects=head.effects, remainder=head.remainder), head.order, known
        )
    return Model(head, Plant(head, gains), 1, known)


def closure(base: Model, augmented: Model, plant: Any, seed: int) -> dict[str, Any]:
    """Fraction of the base model's error on fresh drives that the augmented model removes.

    One offset per model and drive is free. Errors are relative to each drive's own signal before they are pooled over
    the drives, so that volts of a strain gauge and of a current count alike.

    Parameters
    ----------
    base, augmented : Model
        The two models.
    plant : object
        The concealed plant, with ``fresh_drives`` and ``response``.
    seed : int
        Seed of the fresh drives.

    Returns
    -------
    dict
        ``closure`` (1: all, 0: nothing, negative: the error grew; at least `LEAST_CLOSURE`); the number of ``drives``;
        and for each model the pooled RMS error relative to the signal's RMS, None if its response is unbounded. If the
        base model has no error to compare with, ``closure`` is None and ``reason`` explains why.
    """
    errors: dict[str, list[float]] = {"base": [], "augmented": []}
    for drive in plant.fresh_drives(np.random.default_rng(seed)):
        if drive.channel not in base.channels & augmented.channels:
            continue
        true = plant.response(drive.drive_V, drive.step_s, drive.channel, drive.initial_state)
        if np.ptp(true) == 0:
            continue  # a constant drive
        size = float(np.mean((true - true.mean()) ** 2))
        for name, model in (("base", base), ("augmented", augmented)):
            try:
                residuals = true - model.signal(drive.drive_V, drive.step_s, drive.channel, drive.initial_state)
            except FloatingPointError:
                residuals = np.full(true.size, np.nan)
            errors[name].append(float(np.mean((residuals - residuals.mean()) ** 2)) / size)
    found: dict[str, Any] = {"closure": None, "drives": len(errors["base"]), "base_rms": None, "augmented_rms": None}
    if not found["drives"]:
        return found | {"reason": "no fresh drive moves the head on a channel whose gain both models know"}
    before, after = (float(np.mean(errors[name])) for name in ("base", "augmented"))
    found["base_rms"], found["augmented_rms"] = _rms(before), _rms(after)
    if not math.isfinite(before):
        return found | {"reason": "the base model has no bounded answer to a fresh drive"}
    if before == 0:
        return found | {"reason": "the base model leaves no error on fresh drives"}
    share = 1 - after / before if math.isfinite(after) else LEAST_CLOSURE
    return found | {"closure": max(share, LEAST_CLOSURE)}


def _rms(mean_square: float) -> float | None:
    return math.sqrt(mean_square) if math.isfinite(mean_square) else None
