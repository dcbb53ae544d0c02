"""A campaign prepared for fitting: repeats gathered, noise estimated, whole recordings held out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.identification.basis import DriveBasis
from inkjet_env.identification.noise import NoiseModel, channel_noise, repeat_deviations
from inkjet_env.identification.quasi_static import may_ring
from inkjet_env.naming import nearest_name
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.typing import Real

HELD_OUT_EVERY = 4
"""Interval at which drives of a channel, sorted by strength, are held out: every fourth."""
SHORTEST_REST = 100
"""Smallest number of samples before the drive from which noise is estimated."""
HELD_OUT_SHARE = 0.25
"""Share of the longest recording that is held out if no whole recording can be."""


@dataclass(frozen=True, eq=False)
class RepeatedMeasurement:
    """One drive and the signals that a channel showed under it, once or several times.

    Attributes
    ----------
    channel, unit, initial_state : str
        As in the recordings; nanometres are converted to micrometres.
    drive_V : ndarray, shape (n,)
        Commanded drive, in volts.
    step_s : float
        Sampling step, in seconds.
    signals : tuple of ndarray, shape (n,)
        Signal of each repeat, in ``unit``.
    names : tuple of str
        Name of the recording of each repeat.
    fitted : int
        Number of samples from the start that may be fitted: n, 0 (held out), or between (its end is held out).
    quasi_static : bool
        Whether no recording of the campaign can show the resonator, so that a displacement is static too.
    """

    channel: str
    unit: str
    initial_state: str
    drive_V: Real
    step_s: float
    signals: tuple[Real, ...]
    names: tuple[str, ...]
    fitted: int
    quasi_static: bool = False

    @property
    def fast(self) -> bool:
        """Whether the resonator shows in the channel."""
        return not self.quasi_static and self.channel != "strain_gauge"

    def response(self, basis: DriveBasis, a0: float, a1: float) -> Real:
        """`DriveBasis.response` of the channel, shape (n, d); ``a0`` and ``a1`` do not matter unless it is fast."""
        return basis.response(self.channel if self.fast else "strain_gauge", a0, a1)

    @property
    def mean(self) -> Real:
        """Mean of the repeats, in ``unit``, shape (n,)."""
        mean: Real = np.mean(self.signals, axis=0)
        return mean

    @property
    def still(self) -> bool:
        """Whether the drive never changes."""
        return bool(np.ptp(self.drive_V) == 0)

    @property
    def noise_key(self) -> tuple[str, float]:
        """Channel and sampling step, for which recordings share a noise model."""
        return self.channel, float(f"{self.step_s:.4g}")


def measurements(
    campaign: Campaign, held_out: Sequence[str] | None = None, quasi_static: bool = False
) -> tuple[RepeatedMeasurement, ...]:
    """Gather the recordings of a campaign by channel and drive, and hold some out.

    Parameters
    ----------
    campaign : Campaign
        Recordings to gather.
    held_out : sequence of str, optional
        Names of the recordings that no fit may use. Their repeats are held out too. Default: every fourth drive of each
        channel, sorted by strength, but never the strongest, nor the only one with the voltage at the head; if a
        campaign has too few for that, the last quarter of its longest fast recording, or of its longest recording if
        none is fast.
    quasi_static : bool
        Whether displacement is static although a resonance could show in it. A campaign in which none can show, see
        `may_ring`, is quasi-static in any case.

    Returns
    -------
    tuple of RepeatedMeasurement
        One per channel and drive.

    Raises
    ------
    ValueError
        A name that is not a recording; a channel in volts in one recording and in micrometres in another; everything
        held out, or a whole channel.
    """
    gathered = _gathered(campaign)
    if quasi_static or not any(_shows_resonance(m) for m in gathered):
        gathered = [replace(m, quasi_static=True) for m in gathered]
    names = [recording.name for recording in campaign.recordings]
    for name in held_out or ():
        if name not in names:
            raise ValueError(
                f"held-out recording {name!r} is not in campaign {campaign.name!r}.{nearest_name(name, names)}"
            )
    chosen = set(held_out) if held_out is not None else _every_fourth(gathered) - _only_with_a_probe(gathered, campaign)
    result = [replace(m, fitted=0) if chosen & set(m.names) else m for m in gathered]
    if not any(m.fitted for m in result):
        raise ValueError(f"all recordings of campaign {campaign.name!r} are held out. Leave some to be fitted.")
    for channel in sorted({m.channel for m in result}):
        if not any(m.fitted for m in result if m.channel == channel):
            raise ValueError(
                f"all recordings of channel {channel} in campaign {campaign.name!r} are held out, so its gain "
                "and offset are unknown. Leave one to be fitted."
            )
    shown = [m for m in result if m.fast] or result
    if held_out is None and not any(m.fitted == 0 for m in shown):
        once = [m for m in shown if not m.still and m.initial_state != "periodic"]
        if once:
            longest = max(once, key=lambda m: m.drive_V.size)
            fitted = int((1 - HELD_OUT_SHARE) * longest.drive_V.size)
            result[result.index(longest)] = replace(longest, fitted=fitted)
    return tuple(result)


def _only_with_a_probe(gathered: Sequence[RepeatedMeasurement], campaign: Campaign) -> set[str]:
    """Names of the recordings of the one drive for which the voltage at the head was recorded; empty of several."""
    monitored = {recording.name for recording in campaign.recordings if recording.drive_monitor_V is not None}
    drives = [m for m in gathered if monitored & set(m.names)]
    return set(drives[0].names) if len(drives) == 1 else set()


def _shows_resonance(m: RepeatedMeasurement) -> bool:
    """Whether a recording can show the resonator."""
    if m.channel == "displacement":
        return may_ring(m.drive_V, m.step_s, m.initial_state)
    return m.channel == "self_sensing" and not m.still


def _gathered(campaign: Campaign) -> list[RepeatedMeasurement]:
    units: dict[str, str] = {}
    groups: dict[tuple, list[Recording]] = {}
    for recording in campaign.recordings:
        unit = "um" if recording.unit == "nm" else recording.unit
        if units.setdefault(recording.channel, unit) != unit:
            raise ValueError(
                f"recording {recording.name!r}: channel {recording.channel} is in {unit} here and in "
                f"{units[recording.channel]} elsewhere; a channel has one gain, so it needs one unit."
            )
        alone = recording.name if recording.initial_state == "free" else ""  # each has its own initial state
        key = (
            recording.channel,
            recording.initial_state,
            alone,
            recording.drive_V.tobytes(),
            f"{recording.step_s:.9g}",
        )
        groups.setdefault(key, []).append(recording)
    return [
        RepeatedMeasurement(
            channel=first.channel,
            unit=units[first.channel],
            initial_state=first.initial_state,
            drive_V=first.drive_V,
            step_s=first.step_s,
            signals=tuple(r.sensor * (1e-3 if r.unit == "nm" else 1.0) for r in group),
            names=tuple(r.name for r in group),
            fitted=first.drive_V.size,
        )
        for group in groups.values()
        for first in group[:1]
    ]


def _every_fourth(gathered: Sequence[RepeatedMeasurement]) -> set[str]:
    chosen: set[str] = set()
    for channel in sorted({m.channel for m in gathered}):
        moving = [m for m in gathered if m.channel == channel and not m.still]
        moving.sort(key=lambda m: (float(np.std(m.drive_V)), min(m.names)))
        strongest = max((float(np.ptp(m.drive_V)) for m in moving), default=0.0)
        alike = sum(float(np.ptp(m.drive_V)) >= strongest for m in moving)
        candidates = moving[HELD_OUT_EVERY // 2 :: HELD_OUT_EVERY] if len(moving) >= HELD_OUT_EVERY else []
        for measurement in candidates:
            is_strongest = float(np.ptp(measurement.drive_V)) >= strongest
            if not is_strongest or alike > 1:
                chosen |= set(measurement.names)
                alike -= is_strongest
    return chosen


def noise_of(gathered: Sequence[RepeatedMeasurement]) -> dict[tuple[str, float], NoiseModel]:
    """Noise models by `RepeatedMeasurement.noise_key`, from data that show nothing of the head.

    These are repeats and recordings at rest; if there are none, the samples before the first change of the drive;
    otherwise the channel's noise at the nearest sampling step is taken. Held-out recordings are included. A key without
    any such data is absent.
    """
    models: dict[tuple[str, float], NoiseModel] = {}
    seen: dict[str, dict[float, list[Real]]] = {}
    sources: dict[str, dict[float, str]] = {}
    least = least_noise(gathered)
    for key in sorted({m.noise_key for m in gathered}):
        mine = [m for m in gathered if m.noise_key == key]
        repeated = [d for m in mine if not m.still for d in repeat_deviations(m.signals)]
        resting = [signal for m in mine if m.still for signal in m.signals]
        source = " and ".join(["repeats"] * bool(repeated) + ["recordings at rest"] * bool(resting))
        if not source:
            resting = [signal[: _rest_before(m)] for m in mine for signal in m.signals]
            resting = [stretch for stretch in resting if stretch.size >= SHORTEST_REST]
            source = "samples before the drive"
        if resting:
            level = np.concatenate(resting).mean()
            repeated.extend(stretch - level for stretch in resting)
        if repeated:
            seen.setdefault(key[0], {})[key[1]] = repeated
            sources.setdefault(key[0], {})[key[1]] = source
    for channel, stretches in seen.items():
        found = channel_noise(stretches, sources[channel], least[channel])
        models |= {(channel, step_s): model for step_s, model in found.items()}
    for channel, step_s in sorted({m.noise_key for m in gathered} - set(models)):
        known = [other for mine, other in models if mine == channel]
        if known:
            nearest = min(known, key=lambda other: abs(np.log(other / step_s)))
            models[channel, step_s] = models[channel, nearest].at_step(step_s / nearest)
    return models


def _rest_before(measurement: RepeatedMeasurement) -> int:
    """Number of samples before a demagnetised head is first driven."""
    if measurement.initial_state != "demagnetised" or measurement.drive_V[0] != 0:
        return 0
    return int(np.argmax(measurement.drive_V != 0))


def smallest_step(values: Real) -> float:
    """Smallest difference between the values of a converter, in their unit; infinite if there is but one value.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Signal in any unit. Differences below 1e-8 of its range are rounding of the arithmetic.
    """
    apart = np.diff(np.sort(values))
    return float(apart[apart > 1e-8 * float(np.ptp(values))].min(initial=math.inf))


def least_noise(gathered: Sequence[RepeatedMeasurement]) -> dict[str, float]:
    """RMS of each channel's resolution: the converter's step / √12, or 1e-7 of the strongest signal, in its unit.

    The step is the smallest difference between occurring values, if they are clearly discrete.
    """
    least = {}
    for channel in sorted({m.channel for m in gathered}):
        signals = [signal for m in gathered if m.channel == channel for signal in m.signals]
        step = smallest_step(np.concatenate(signals))
        strongest = max(float(np.std(signal)) for signal in signals)
        least[channel] = max(1e-7 * strongest, step / math.sqrt(12) if math.isfinite(step) else 0.0, 1e-300)
    return least
