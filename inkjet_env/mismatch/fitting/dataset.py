"""A campaign as the diagnosis sees it: each recording with its excitation, condition, noise and held-out samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inkjet_env.identification.measurements import least_noise, measurements
from inkjet_env.identification.noise import NoiseModel, channel_noise, repeat_deviations
from inkjet_env.mismatch.settings import FittingSettings
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
        Recorded signal, in ``unit``.
    fitted : int
        Number of samples from the start that a fit may see: n, 0 (held out) or between (its end is held out).
    """

    name: str
    channel: str
    unit: str
    condition: int
    excitation: Excitation
    measured: Real
    fitted: int

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
                largest_signal=float(np.abs(signal).max()),
                quasi_static=measurement.quasi_static,
            )
            found[name] = [
                ObservedRecording(
                    name, measurement.channel, measurement.unit, condition, excitation, signal, measurement.fitted
                )
            ]
            if recording.drive_monitor_V is not None:
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


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a campaign.

    Attributes
    ----------
    models : dict
        Noise model by `ObservedRecording.noise_key`.
    samples : dict
        Number of samples from which each model was estimated, by the same key; 0 if it comes from a fit's residuals.
    notes : tuple of str
        Sentences for the user about how the noise was estimated.
    least : dict of str to float
        By channel, the least RMS that can be resolved, in the channel's unit: that of its converter's step.
    """

    models: Mapping[tuple[str, float], NoiseModel]
    samples: Mapping[tuple[str, float], int]
    notes: tuple[str, ...] = ()
    least: Mapping[str, float] = field(default_factory=dict)
    _kept: dict[tuple[tuple[str, float], int], Real] = field(default_factory=dict, init=False, repr=False)

    def known(self, observed: ObservedRecording) -> bool:
        """Whether the noise was estimated from anything but a fit's own residuals."""
        return self.samples[observed.noise_key] > 0

    def whitened(self, observed: ObservedRecording, columns: Real) -> Real:
        """Columns of shape (n, k) or (n,), filtered so that the noise in them is white with unit variance.

        The shape is kept: the first samples, at which the filter is not yet full, are zero.
        """
        model = self.models[observed.noise_key]
        flat = columns.ndim == 1
        table = columns[:, None] if flat else columns
        white = model.whitened(table)
        result = np.zeros(table.shape)
        result[table.shape[0] - white.shape[0] :] = white
        if model.colour != (1.0, 0.0, 0.0) and white.size:
            from scipy.fft import irfft, next_fast_len, rfft

            length = next_fast_len(table.shape[0], real=True)
            lines = rfft(result, length, axis=0) / self._roots(observed.noise_key, length)
            result = irfft(lines, length, axis=0)[: table.shape[0]]
            result[: table.shape[0] - white.shape[0]] = 0.0
        return result[:, 0] if flat else result

    def _roots(self, key: tuple[str, float], length: int) -> Real:
        """Amplitude of whitened noise at each line of a real Fourier transform, shape (length // 2 + 1, 1)."""
        if (key, length) not in self._kept:
            self._kept[key, length] = np.sqrt(self.models[key].levels(length)[: length // 2 + 1])[:, None]
        return self._kept[key, length]

    def log_scale(self, observed: ObservedRecording) -> float:
        """Mean logarithm of the noise's innovation: the log-likelihood that larger noise costs per sample."""
        model = self.models[observed.noise_key]
        scale = float(np.log(model.innovation))
        if model.colour != (1.0, 0.0, 0.0):
            scale += 0.5 * float(np.mean(np.log(model.levels(observed.excitation.samples))))
        return scale


def noise_seen(
    observed: Sequence[ObservedRecording],
    residuals: Mapping[str, Real],
    otherwise: Mapping[tuple[str, float], NoiseModel],
    settings: FittingSettings,
    least: Mapping[str, float] | None = None,
) -> Noise:
    """Noise of each channel and sampling step, estimated from what no model of the head can explain.

    It is estimated from recordings at rest and from the differences between the residuals of repeats. Where repeats
    differ by more than the noise at rest, recordings at rest alone count, and a note says so. If there are neither, the
    rest before the drive is used, then the channel's noise at another sampling step, then the residuals themselves.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        Recordings whose noise is estimated.
    residuals : mapping of str to ndarray
        Measured minus modelled of each recording, in the channel's unit, shape (n,).
    otherwise : mapping
        Noise models by `ObservedRecording.noise_key`, used where nothing but residuals is available.
    settings : FittingSettings
        Thresholds of the estimate.
    least : mapping, optional
        ``Noise.least``; computed from these recordings unless given. Pass the campaign's if these are only part of it.
    """
    models: dict[tuple[str, float], NoiseModel] = {}
    samples: dict[tuple[str, float], int] = {}
    notes: list[str] = []
    least = least or _least(observed)
    seen: dict[str, dict[float, list[Real]]] = {}
    sources: dict[str, dict[float, str]] = {}
    for key in sorted({o.noise_key for o in observed}):
        mine = [o for o in observed if o.noise_key == key]
        resting = [residuals[o.name] for o in mine if o.at_rest]
        source = ["recordings at rest"] if resting else []
        if resting:
            level = np.concatenate(resting).mean()
            resting = [stretch - level for stretch in resting]
        repeated = []
        for condition in {o.condition for o in mine if not o.still}:
            same = [residuals[o.name] for o in mine if o.condition == condition]
            repeated.extend(repeat_deviations(same))
        if resting and repeated:
            ratio = _power(repeated) / max(_power(resting), least[key[0]] ** 2, 1e-300)
            if ratio > settings.repeats_to_rest_variance:
                notes.append(
                    f"{key[0]}: repeats of the same drive differ by {np.sqrt(ratio):.2g} times the noise at rest; "
                    "something changes between recordings."
                )
                repeated = []
        if repeated:
            source.append("repeats")
        if not (resting or repeated):
            before = [residuals[o.name][: _rest_before(o)] for o in mine]
            resting = [stretch - stretch.mean() for stretch in before if stretch.size >= settings.shortest_rest]
            source = ["samples before the drive"]
        stretches = resting + repeated
        if stretches:
            seen.setdefault(key[0], {})[key[1]] = stretches
            sources.setdefault(key[0], {})[key[1]] = " and ".join(source)
            samples[key] = sum(stretch.size for stretch in stretches)
    for channel, by_step in seen.items():
        # noise that wanders more than 1/f is left for the diagnosis to find
        found = channel_noise(by_step, sources[channel], least[channel], exponents=(1,))
        longest = max(o.excitation.samples for o in observed if o.channel == channel)
        for step_s, model in found.items():
            slight = model.colour[1] * longest < settings.slight_1_f * model.colour[0]
            models[channel, step_s] = replace(model, colour=(1.0, 0.0, 0.0)) if slight else model
    for key in sorted({o.noise_key for o in observed} - set(models)):
        known = [other for channel, other in models if channel == key[0] and samples[channel, other]]
        if known:
            nearest = known[int(np.argmin(np.abs(np.log(np.array(known) / key[1]))))]
            models[key], samples[key] = models[key[0], nearest], samples[key[0], nearest]
        else:
            stretches = [residuals[o.name] for o in observed if o.noise_key == key]
            models[key], samples[key] = otherwise.get(key) or _of_most(stretches, least[key[0]]), 0
            notes.append(
                f"{key[0]}: the noise is unknown without repeats or recordings at rest; residuals were taken for it."
            )
    return Noise(models, samples, tuple(notes), least)


def _of_most(stretches: Sequence[Real], least: float) -> NoiseModel:
    """White noise as large as most samples' residuals: the few samples where a model fails do not count."""
    size = np.abs(np.concatenate([stretch - np.median(stretch) for stretch in stretches]))
    rms = max(1.4826 * float(np.median(size)), least)
    return NoiseModel(np.ones(1), rms, rms, "the level of most residuals")


def _power(stretches: Sequence[Real]) -> float:
    return float(np.mean(np.concatenate(stretches) ** 2))


def _rest_before(observed: ObservedRecording) -> int:
    drive = observed.excitation.drive_V
    if observed.excitation.initial_state != "demagnetised" or drive[0] != 0:
        return 0
    return int(np.argmax(drive != 0))


def _least(observed: Sequence[ObservedRecording]) -> dict[str, float]:
    """By channel, the least RMS that can be resolved, in the channel's unit."""
    from inkjet_env.identification.measurements import RepeatedMeasurement

    return least_noise(
        [
            RepeatedMeasurement(
                o.channel,
                o.unit,
                o.excitation.initial_state,
                o.excitation.drive_V,
                o.excitation.step_s,
                (o.measured,),
                (o.name,),
                o.fitted,
            )
            for o in observed
        ]
    )
