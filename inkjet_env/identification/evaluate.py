"""How far a printhead is from recordings: free-run simulation, nothing refitted but what is no part of the head."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification.basis import drive_basis, free_ringing
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign, Recording

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a recording shows beyond a printhead, in the channel's unit.

    Attributes
    ----------
    recording : Recording
    modelled : ndarray, shape (n,)
    offset : float
        Of the channel.
    """

    recording: Recording
    modelled: Real
    offset: float

    @property
    def rms(self) -> float:
        """Of measured minus modelled."""
        return float(np.sqrt(np.mean((self.recording.sensor - self.modelled) ** 2)))

    @property
    def output_rms(self) -> float:
        """Of the measured signal about the channel's offset."""
        return float(np.sqrt(np.mean((self.recording.sensor - self.offset) ** 2)))


def evaluate(
    campaign: Campaign, printhead: Printhead, gains: Mapping[str, float] | None = None
) -> tuple[tuple[Evaluation, ...], tuple[str, ...]]:
    """Simulate every recording of a campaign with a printhead.

    Refitted are one offset a channel and, where ``free``, the resonator's initial state; and the gain of a strain gauge
    or of a displacement sensor where none is given, since a printhead does not have it.

    Parameters
    ----------
    campaign : Campaign
    printhead : Printhead
    gains : mapping of str to float, optional
        By channel, in its unit per hysteretic volt; displacement in micrometres. `Identification.gains` has them.

    Returns
    -------
    evaluations : tuple of Evaluation
        In the campaign's order.
    refitted : tuple of str
        Channels whose gain was fitted.
    """
    known = {"self_sensing": printhead.b1} | {c: g for c, g in (gains or {}).items() if c != "self_sensing"}
    refitted = []
    found: dict[str, Evaluation] = {}
    for channel in sorted({recording.channel for recording in campaign.recordings}):
        mine = campaign.select(channel)
        shapes = [_shape(printhead, recording) for recording in mine]
        if channel not in known:
            refitted.append(channel)
        found |= {e.recording.name: e for e in _fitted_along(mine, shapes, printhead, known.get(channel))}
    return tuple(found[recording.name] for recording in campaign.recordings), tuple(refitted)


def _shape(printhead: Printhead, recording: Recording) -> Real:
    """The channel's signal for a gain of 1."""
    basis = drive_basis(
        recording.drive_V,
        recording.step_s,
        printhead.full_scale_V,
        len(printhead.coefficients) - 1,
        recording.initial_state,
    )
    shape: Real = basis.response(recording.channel, printhead.a0, printhead.a1) @ printhead.branch_law.ascending[1:]
    return shape


def _fitted_along(
    recordings: Sequence[Recording], shapes: Sequence[Real], printhead: Printhead, gain: float | None
) -> list[Evaluation]:
    """Least squares for the offset, the free states, and the gain where it is None; of one channel."""
    scales = [1e-3 if recording.unit == "nm" else 1.0 for recording in recordings]
    states = [_free_states(recording, printhead) for recording in recordings]
    rows = []
    for recording, shape, scale, q in zip(recordings, shapes, scales, states, strict=True):
        block = np.column_stack([np.ones(shape.size), shape, scale * recording.sensor])
        rows.append(block - q @ (q.T @ block))
    stacked = np.vstack(rows)
    if gain is None:
        size = np.maximum(np.linalg.norm(stacked[:, :2], axis=0), 1e-300)
        offset, gain = np.linalg.lstsq(stacked[:, :2] / size, stacked[:, 2], rcond=None)[0] / size
    else:
        left = stacked[:, 2] - gain * stacked[:, 1]
        offset = float(stacked[:, 0] @ left) / max(float(stacked[:, 0] @ stacked[:, 0]), 1e-300)
    evaluations = []
    for recording, shape, scale, q in zip(recordings, shapes, scales, states, strict=True):
        modelled = offset + gain * shape
        modelled = modelled + q @ (q.T @ (scale * recording.sensor - modelled))
        evaluations.append(Evaluation(recording, modelled / scale, float(offset) / scale))
    return evaluations


def _free_states(recording: Recording, printhead: Printhead) -> Real:
    """Orthonormal columns of what an unknown initial state of the resonator adds; none where it is known."""
    n = recording.time_s.size
    if recording.initial_state != "free" or recording.channel == "strain_gauge":
        return np.zeros((n, 0))
    return np.linalg.qr(free_ringing(n, recording.step_s, printhead.a0, printhead.a1)).Q
