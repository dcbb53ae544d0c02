"""Free-run residuals of a printhead on recordings; only parameters that are not part of the head are refitted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.identification.basis import drive_basis, free_ringing
from inkjet_env.plant import Excitation, Plant
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.recorded_motion import session_of
from inkjet_env.printhead import Printhead, QuasiStaticPrinthead
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.typing import Real

MOST_ROUNDS = 12
"""Largest number of Gauss–Newton steps for a free initial state."""
NODES_A_PERIOD = 100
"""Least number of nodes in a period of the resonance: a recording may have fewer than ten samples there."""
MOST_PAIRS = 32
"""Largest number of pairs of nodes in a sampling step."""
SETTLED = 1e-6
"""Change of a free initial state below which it has converged, as a share of the full scale."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A recording beside the free-run simulation of a printhead, in the channel's unit.

    Attributes
    ----------
    recording : Recording
        The measured recording.
    modelled : ndarray, shape (n,)
        Simulated signal, in the recording's unit.
    offset : float
        Fitted offset of the channel, in the same unit.
    """

    recording: Recording
    modelled: Real
    offset: float

    @property
    def rms(self) -> float:
        """Root mean square of measured minus modelled, in the recording's unit."""
        return float(np.sqrt(np.mean((self.recording.sensor - self.modelled) ** 2)))

    @property
    def output_rms(self) -> float:
        """Root mean square of the measured signal about the channel's offset, in the recording's unit."""
        return float(np.sqrt(np.mean((self.recording.sensor - self.offset) ** 2)))


def evaluate(
    campaign: Campaign, printhead: Printhead | AugmentedPrinthead, gains: Mapping[str, float] | None = None
) -> tuple[tuple[Evaluation, ...], tuple[str, ...]]:
    """Simulate every recording of a campaign with a printhead.

    One offset per channel and, if ``free``, the resonator's initial state are refitted. So is the gain of a strain
    gauge or a displacement sensor if none is given, since a printhead has no such gain. With a `QuasiStaticPrinthead`,
    displacement is simulated as static, and self-sensing is refused.

    Parameters
    ----------
    campaign : Campaign
        Recordings to simulate.
    printhead : Printhead or AugmentedPrinthead
        The head. Random effects, such as a hum, explain nothing here.
    gains : mapping of str to float, optional
        Gain of each channel, in its unit per hysteretic volt; displacement in micrometres. `Identification.gains`
        provides them, and an augmented head has its own.

    Returns
    -------
    evaluations : tuple of Evaluation
        One per recording, in the campaign's order.
    refitted : tuple of str
        Channels whose gain was fitted.

    Raises
    ------
    UnknownDynamicsError
        Self-sensing needs the dynamics, which the head lacks.
    """
    if isinstance(printhead, AugmentedPrinthead):
        base, known = printhead.printhead, {**printhead.gains, **(gains or {})}
    else:
        base, known = printhead, dict(gains or {})
    if campaign.select("self_sensing"):
        known["self_sensing"] = base.b1
    refitted = []
    found: dict[str, Evaluation] = {}
    for channel in sorted({recording.channel for recording in campaign.recordings}):
        mine = campaign.select(channel)
        if channel not in known:
            refitted.append(channel)
        if isinstance(printhead, AugmentedPrinthead):
            evaluations = _with_effects(mine, printhead, known.get(channel))
        else:
            shapes = [_shape(base, recording) for recording in mine]
            states = [_free_states(recording, base) for recording in mine]
            evaluations, _ = _fitted_along(mine, shapes, states, known.get(channel))
        found |= {e.recording.name: e for e in evaluations}
    return tuple(found[recording.name] for recording in campaign.recordings), tuple(refitted)


def _shape(printhead: Printhead, recording: Recording) -> Real:
    """Signal of the channel for a gain of 1, shape (n,)."""
    basis = drive_basis(
        recording.drive_V,
        recording.step_s,
        printhead.full_scale_V,
        len(printhead.coefficients) - 1,
        recording.initial_state,
    )
    columns = (
        basis.hysteretic_V()
        if _static(recording, printhead)
        else basis.response(recording.channel, printhead.a0, printhead.a1)
    )
    shape: Real = columns @ printhead.branch_law.ascending[1:]
    return shape


def _static(recording: Recording, printhead: Printhead) -> bool:
    """Whether a recording is simulated as static: a strain gauge, or anything else with a head without dynamics."""
    return recording.channel == "strain_gauge" or not printhead.has_dynamics


def _fitted_along(
    recordings: Sequence[Recording], shapes: Sequence[Real], states: Sequence[Real], gain: float | None
) -> tuple[list[Evaluation], float]:
    """Least squares for one channel's offset, free states and, if it is None, gain; returns the gain as well."""
    scales = [_scale(recording) for recording in recordings]
    rows = []
    for recording, shape, scale, q in zip(recordings, shapes, scales, states, strict=True):
        block = np.column_stack([np.ones(shape.size), shape, scale * recording.sensor])
        rows.append(block - q @ (q.T @ block))
    stacked = np.vstack(rows)
    if gain is None:
        size = np.maximum(np.linalg.norm(stacked[:, :2], axis=0), 1e-300)
        offset, gain = np.linalg.lstsq(stacked[:, :2] / size, stacked[:, 2], rcond=None)[0] / size
    else:
        remainder = stacked[:, 2] - gain * stacked[:, 1]
        offset = float(stacked[:, 0] @ remainder) / max(float(stacked[:, 0] @ stacked[:, 0]), 1e-300)
    evaluations = []
    for recording, shape, scale, q in zip(recordings, shapes, scales, states, strict=True):
        modelled = offset + gain * shape
        modelled = modelled + q @ (q.T @ (scale * recording.sensor - modelled))
        evaluations.append(Evaluation(recording, modelled / scale, float(offset) / scale))
    return evaluations, float(gain)


def _scale(recording: Recording) -> float:
    """Factor from the unit of a displacement to micrometres."""
    return 1e-3 if recording.unit == "nm" else 1.0


def _free_states(recording: Recording, printhead: Printhead) -> Real:
    """Orthonormal columns of the free ringing from an unknown initial state, (n, 2); no columns if it is known."""
    n = recording.time_s.size
    if recording.initial_state != "free" or _static(recording, printhead):
        return np.zeros((n, 0))
    return np.linalg.qr(free_ringing(n, recording.step_s, printhead.a0, printhead.a1)).Q


def _with_effects(recordings: Sequence[Recording], head: AugmentedPrinthead, gain: float | None) -> list[Evaluation]:
    """`_fitted_along` for a head with effects, whose free states need not superpose and are found by Gauss–Newton.

    If the gain is None it is fitted first, as if the sensor's effects were proportional to it.
    """
    base = head.printhead
    whole = base.with_placeholder() if isinstance(base, QuasiStaticPrinthead) else base
    plant = Plant(whole, {recordings[0].channel: 1.0 if gain is None else gain}, effects=head.effects)
    # A gain that is still to be fitted is fitted without the remainder, whose weights have the unit of the signal.
    plant = replace(plant, remainder=None if gain is None else head.remainder)
    excitations = [_shot(recording, plant, not base.has_dynamics) for recording in recordings]
    session = session_of(plant.printhead, excitations)
    excitations = [replace(excitation, session=session) for excitation in excitations]
    small_V = 1e-4 * head.printhead.full_scale_V
    for _ in range(MOST_ROUNDS):
        shapes = [plant.signal(excitation) for excitation in excitations]
        slopes = [
            _start_slopes(plant, excitation, shape, small_V)
            for excitation, shape in zip(excitations, shapes, strict=True)
        ]
        states = [np.linalg.qr(slope).Q for slope in slopes]
        if gain is None:
            return _with_effects(recordings, head, _fitted_along(recordings, shapes, states, None)[1])
        evaluations, _ = _fitted_along(recordings, shapes, states, 1.0)
        changes = []
        for i, (found, slope) in enumerate(zip(evaluations, slopes, strict=True)):
            if slope.size:
                moved = _scale(found.recording) * (found.modelled - found.offset) - shapes[i]
                change = np.linalg.lstsq(slope, moved, rcond=None)[0]
                x, p = excitations[i].start
                excitations[i] = replace(excitations[i], start=(x + float(change[0]), p + float(change[1])))
                changes.append(float(np.abs(change).max()))
        if max(changes, default=0.0) <= SETTLED * head.printhead.full_scale_V:
            break
    return evaluations


def _shot(recording: Recording, plant: Plant, quasi_static: bool) -> Excitation:
    """A recording as the plant sees it; a free resonator starts at rest under the first value of the drive."""
    excitation = Excitation(
        recording.channel,
        recording.initial_state,
        recording.step_s,
        recording.drive_V,
        recording.order,
        recording.neighbour_V,
        quasi_static=quasi_static,
    )
    if excitation.fast:
        pairs_a_sample = math.ceil(NODES_A_PERIOD / 2 * plant.printhead.frequency_Hz * recording.step_s)
        excitation = replace(excitation, substeps=2 * min(max(pairs_a_sample, 1), MOST_PAIRS))
    if excitation.initial_state != "free":
        return excitation
    return replace(excitation, start=(float(plant.hysteretic_V(plant.at_ceramic_V(excitation), excitation)[0]), 0.0))


def _start_slopes(plant: Plant, excitation: Excitation, signal: Real, small_V: float) -> Real:
    """Jacobian of the signal with respect to a free initial state, (n, 2), per volt; no columns if it is known."""
    if excitation.initial_state != "free" or not excitation.fast:
        return np.zeros((excitation.samples, 0))
    x, p = excitation.start
    moved = [plant.signal(replace(excitation, start=start)) for start in ((x + small_V, p), (x, p + small_V))]
    return np.column_stack([(other - signal) / small_V for other in moved])
