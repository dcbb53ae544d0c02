"""A campaign as the diagnosis sees it: each recording with its excitation, condition, noise and held-out samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inkjet_env.identification.errors import UnidentifiableError
from inkjet_env.identification.measurements import measurements
from inkjet_env.plant import Excitation
from inkjet_env.recordings import Campaign
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class ObservedRecording:
    """One recording.

    Attributes
    ----------
    name, channel, unit : str
        Name of the recording, its channel and the unit of its signal; nanometres are converted to micrometres.
    condition : int
        Number of the condition: recordings of the same drive on the same channel share one.
    excitation : Excitation
        Drive and initial state.
    measured : ndarray, shape (n,)
        Recorded signal, in ``unit``, without the mean error of a coarse converter's rounding.
    fitted : int
        Number of samples from the start that a fit may see: n, 0 (held out) or between (its end is held out).
    rounding : ndarray, shape (n,), optional
        The mean error that was taken off, in ``unit``; see `without_rounding`.
    """

    name: str
    channel: str
    unit: str
    condition: int
    excitation: Excitation
    measured: Real
    fitted: int
    rounding: Real | None = None

    @property
    def told(self) -> Real:
        """The signal as its converter told it, shape (n,)."""
        return self.measured if self.rounding is None else self.measured + self.rounding

    @property
    def still(self) -> bool:
        """Whether the drive never changes."""
        return bool(np.ptp(self.excitation.drive_V) == 0)

    @property
    def at_rest(self) -> bool:
        """Whether it holds nothing but noise: neither its drive nor the neighbour's ever changes."""
        neighbour_V = self.excitation.neighbour_V
        return self.still and (neighbour_V is None or bool(np.ptp(neighbour_V) == 0))

    @property
    def noise_key(self) -> tuple[str, float]:
        """Channel and sampling step in seconds; recordings with the same key share a noise model."""
        return self.channel, float(f"{self.excitation.step_s:.4g}")

    def rows(self, held_out: bool) -> slice:
        """Slice of the held-out samples, or of the fitted ones."""
        return slice(self.fitted, None) if held_out else slice(0, self.fitted)


def observe(
    campaign: Campaign, held_out: Sequence[str] | None = None, substeps: int = 2
) -> tuple[ObservedRecording, ...]:
    """The recordings of a campaign in their order, held out as by `identification.measurements`.

    A voltage measured at the head counts as a recording of its own, on the channel ``drive_monitor``.

    Parameters
    ----------
    campaign : Campaign
        The recordings.
    held_out : sequence of str, optional
        Names of the held-out recordings; chosen by `identification.measurements` unless given.
    substeps : int
        Even number of nodes per sampling step.
    """
    by_name = {recording.name: recording for recording in campaign.recordings}
    found: dict[str, list[ObservedRecording]] = {}
    for condition, measurement in enumerate(measurements(campaign, held_out)):
        for name, signal in zip(measurement.names, measurement.signals, strict=True):
            recording = by_name[name]
            excitation = Excitation(
                measurement.channel,
                measurement.initial_state,
                measurement.step_s,
                measurement.drive_V,
                recording.order,
                recording.neighbour_V,
                substeps,
                signal_range=(float(signal.min()), float(signal.max())),
                quasi_static=measurement.quasi_static,
            )
            found[name] = [
                ObservedRecording(
                    name, measurement.channel, measurement.unit, condition, excitation, signal, measurement.fitted
                )
            ]
            if recording.drive_monitor_V is not None:
                if np.ptp(recording.drive_monitor_V) == 0 < np.ptp(recording.drive_V):
                    raise UnidentifiableError(
                        f"the drive monitor of recording {name} never changes while its drive does. Connect its "
                        "probe, or remove the column drive_monitor_V."
                    )
                monitor = replace(excitation, channel="drive_monitor", cache={})
                voltage = recording.drive_monitor_V
                label = f"{name} (drive monitor)"
                found[name].append(
                    ObservedRecording(label, "drive_monitor", "V", -1 - condition, monitor, voltage, measurement.fitted)
                )
    return tuple(o for recording in campaign.recordings for o in found[recording.name])


def finer(observed: Sequence[ObservedRecording], substeps: int) -> tuple[ObservedRecording, ...]:
    """The same recordings with another number of nodes per sampling step."""
    return tuple(replace(o, excitation=replace(o.excitation, substeps=substeps, cache={})) for o in observed)
