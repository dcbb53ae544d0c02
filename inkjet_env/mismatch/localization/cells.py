"""Residual power of a fitted model compared with that of noise alone: by sample, by spectral line, by cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification.basis import free_ringing
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.settings import LocalizationSettings
from inkjet_env.typing import Real

Whole = NDArray[np.intp]

PARTS = ("time", "time in the waveform", "pulse")
"""Views that cut recordings into parts."""


@dataclass(frozen=True)
class Cell:
    """A part of the residuals.

    Attributes
    ----------
    view, label : str
        The view that it belongs to, such as "time", and its name within the view, in words.
    power : float
        Residual power relative to that of noise alone; 1 is noise.
    z : float
        Standard deviations by which the power exceeds the noise.
    span : tuple of float
        Lower and upper end of its time in seconds, frequency in hertz, drive in volts or slope in volts per second;
        empty if it has none.
    group : str
        Channel, or channel and sampling step, that the cell belongs to.
    names : tuple of str
        Names of the recordings that it covers.
    surplus : float
        Residual power beyond that of noise alone, summed over its rows.
    """

    view: str
    label: str
    power: float
    z: float
    span: tuple[float, ...] = ()
    group: str = ""
    names: tuple[str, ...] = ()
    surplus: float = 0.0


@dataclass(frozen=True, eq=False)
class Rows:
    """Squared whitened residuals and their expectation under noise alone; one recording after another.

    Attributes
    ----------
    power, expected : ndarray, shape (rows,)
        Squared residuals, and what noise alone would leave. The fit removes part of it from fitted rows; in predicted
        rows its error adds to it.
    key, record : ndarray of int, shape (rows,)
        Index of each row's noise model and of its recording.
    noise_degrees : ndarray, shape (keys,)
        Number of independent samples that each noise was estimated from.
    noise_degrees_of_parts : ndarray, shape (keys,)
        The same for cells that cut recordings, where a level of noise that grows with the signal is less sure.
    scatter : ndarray, shape (keys,)
        Variance of the sum of a cell's power relative to that of independent, normally distributed samples; at least 1.
    by_line : bool
        Whether rows are lines of a spectrum: then only a cell's share of the noise's samples determines its noise.
    smooth : ndarray, shape (keys,)
        Least such share, because neighbouring lines help to determine a smooth noise spectrum.
    axis : ndarray, shape (rows,)
        Time within the recording in seconds, or frequency in hertz.
    settings : LocalizationSettings
        Thresholds of the localisation.
    """

    power: Real
    expected: Real
    key: Whole
    record: Whole
    noise_degrees: Real
    noise_degrees_of_parts: Real
    scatter: Real
    by_line: bool
    smooth: Real
    axis: Real
    settings: LocalizationSettings

    def cells(
        self,
        view: str,
        place: Whole,
        labels: Sequence[str],
        spans: Sequence[tuple[float, ...]] = (),
        groups: Sequence[str] = (),
        names: Sequence[tuple[str, ...]] = (),
    ) -> list[Cell]:
        """Cells of a view.

        Parameters
        ----------
        view : str
            Name of the view.
        place : ndarray of int, shape (rows,)
            Index of each row's cell into ``labels``; −1 for a row that belongs to none.
        labels : sequence of str
            Name of each cell.
        spans : sequence of tuple of float
            Lower and upper end of each cell, if the view has an axis.
        groups : sequence of str
            Group of each cell, if the view has several.
        names : sequence of tuple of str
            Recordings of each cell, if it covers only some.

        Returns
        -------
        list of Cell
            Cells with enough degrees of freedom; see `LocalizationSettings`.
        """
        count, keys = len(labels), self.noise_degrees.size
        seen = place >= 0
        flat = place[seen] * keys + self.key[seen]
        power = np.bincount(flat, self.power[seen], count * keys).reshape(count, keys)
        expected = np.bincount(flat, self.expected[seen], count * keys).reshape(count, keys)
        of_parts = view in PARTS and not self.by_line
        noise_degrees = self.noise_degrees_of_parts if of_parts else self.noise_degrees
        noise_degrees = np.broadcast_to(noise_degrees, expected.shape)
        if self.by_line:
            every = np.bincount(self.key, self.expected, keys)
            noise_degrees = np.maximum(
                noise_degrees * np.maximum(expected / np.maximum(every, 1e-300), self.smooth), 1.0
            )
        total = expected.sum(axis=1)
        found = []
        for i in np.flatnonzero(total >= self.settings.least_degrees_of_freedom):
            doubt = float(np.sum(expected[i] ** 2 / noise_degrees[i])) / total[i] ** 2
            samples = float(total[i] ** 2 / np.sum(expected[i] * self.scatter))
            ratio = float(power[i].sum() / total[i])
            found.append(
                Cell(
                    view,
                    labels[i],
                    ratio,
                    surplus(ratio, samples, 1 / doubt),
                    spans[i] if spans else (),
                    groups[i] if groups else "",
                    names[i] if names else (),
                    float(power[i].sum() - total[i]),
                )
            )
        return found


def surplus(ratio: float, samples: float, noise_degrees: float) -> float:
    """Standard deviations by which a ratio of two variances is above 1.

    Paulson's normal approximation of Fisher's distribution (Ann. Math. Stat. 13, 1942).

    Parameters
    ----------
    ratio : float
        Ratio of the variances.
    samples, noise_degrees : float
        Degrees of freedom of its numerator and of its denominator.
    """
    a, b = 2 / (9 * samples), 2 / (9 * noise_degrees)
    root = ratio ** (1 / 3)
    return float(((1 - b) * root - (1 - a)) / np.sqrt(b * root**2 + a))


def sample_rows(
    observed: Sequence[ObservedRecording],
    noise: Noise,
    fit: FitResult,
    taken: Sequence[Real],
    settings: LocalizationSettings,
) -> Rows:
    """Residual power of each sample against noise; ``taken`` as from `taken_by_fit`."""
    keys = sorted({o.noise_key for o in observed})
    power, expected = [], []
    for o, columns in zip(observed, taken, strict=True):
        power.append(fit.residuals[o.name] ** 2 / _uncertain(o, noise, fit).mean())
        leverage = np.sum(columns**2, axis=1)
        expected_share = np.where(np.arange(leverage.size) < o.fitted, 1 - leverage, 1 + leverage)
        expected_share[: noise.models[o.noise_key].lost] = 0.0
        expected.append(expected_share)
    sizes = [o.excitation.samples for o in observed]
    axis = np.concatenate([o.excitation.step_s * np.arange(o.excitation.samples) for o in observed])
    return _rows(observed, noise, fit, keys, power, expected, sizes, axis, by_line=False, settings=settings)


def line_rows(
    observed: Sequence[ObservedRecording],
    noise: Noise,
    fit: FitResult,
    taken: Sequence[Real],
    settings: LocalizationSettings,
) -> Rows:
    """Residual power at each line of each recording's spectrum, without the mean; ``taken`` as from `taken_by_fit`."""
    keys = sorted({o.noise_key for o in observed})
    power, expected, axis = [], [], []
    for o, columns in zip(observed, taken, strict=True):
        n, lost = o.excitation.samples, noise.models[o.noise_key].lost
        weight = np.full(n // 2 + 1, 2.0)
        if n % 2 == 0:
            weight[-1] = 1.0
        predicted = np.zeros_like(columns)
        predicted[o.fitted :] = columns[o.fitted :]
        change = _spectrum(predicted, weight).sum(axis=1) - _spectrum(columns - predicted, weight).sum(axis=1)
        power.append(_spectrum(fit.residuals[o.name][:, None], weight)[:, 0] / _uncertain(o, noise, fit))
        expected.append(np.maximum(weight[1:] * (n - lost) / n + change, 0.0))
        axis.append(np.fft.rfftfreq(n, o.excitation.step_s)[1:])
    sizes = [p.size for p in power]
    return _rows(
        observed, noise, fit, keys, power, expected, sizes, np.concatenate(axis), by_line=True, settings=settings
    )


def background(residuals: Real, least: int = 8) -> Real:
    """Level of the lines of a recording's spectrum, without the mean, above which a line stands out; at least 1.

    Where noise was not measured at a recording's sampling step, the shape of its spectrum is not known. Then only what
    is narrower than half an octave counts as mismatch: the level is the median of the lines within that, at least of
    ``least`` on either side.
    """
    power = np.abs(np.fft.rfft(residuals))[1:] ** 2 / residuals.size
    line = np.arange(power.size)
    low = np.minimum(np.floor((line + 1) / 2**0.25).astype(np.intp) - 1, line - least)
    high = np.maximum(np.ceil((line + 1) * 2**0.25).astype(np.intp), line + least + 1)
    centres = np.unique(np.round(np.geomspace(1, power.size, 80)).astype(np.intp)) - 1
    level = [np.median(power[max(low[k], 0) : high[k]]) / np.log(2) for k in centres]  # of an exponential distribution
    return np.maximum(np.interp(line, centres, level), 1.0)


def _uncertain(o: ObservedRecording, noise: Noise, fit: FitResult) -> Real:
    """Factor by which the noise at each line may exceed its model; 1 where it was measured."""
    if o.noise_key not in noise.borrowed:
        return np.ones(o.excitation.samples // 2)
    return background(fit.residuals[o.name])


def _spectrum(rows: Real, weight: Real) -> Real:
    return (weight[:, None] * np.abs(np.fft.rfft(rows, axis=0)) ** 2 / rows.shape[0])[1:]


def _rows(
    observed: Sequence[ObservedRecording],
    noise: Noise,
    fit: FitResult,
    keys: Sequence[tuple[str, float]],
    power: Sequence[Real],
    expected: Sequence[Real],
    sizes: Sequence[int],
    axis: Real,
    by_line: bool,
    settings: LocalizationSettings,
) -> Rows:
    key = np.repeat([keys.index(o.noise_key) for o in observed], sizes)
    record = np.repeat(np.arange(len(observed)), sizes)
    squares, alone = np.concatenate(power), np.concatenate(expected)
    noise_degrees = np.array([max(float(noise.samples[k]), 1.0) for k in keys])
    parameters = [1 + noise.models[k].lost + 3 * len(noise.models[k].bands) for k in keys]
    smooth = np.array([1 / (settings.smooth_spectrum * count) for count in parameters])
    for i, k in enumerate(keys):
        if noise.samples[k]:
            continue
        mine = key == i  # noise known from residuals alone: each cell is compared with all
        degrees = float(alone[mine].sum())  # none may remain where a fit has as many parameters as samples
        level = squares[mine].sum() / degrees if degrees > 1e-9 else 1.0
        squares[mine] /= level or 1.0
        noise_degrees[i] = max(degrees, 1.0)
    scatter = np.array([1.0 if by_line else _scatter(observed, noise, fit, k) for k in keys])
    grows = [any(o.noise_key == k and np.ptp(noise.levels.get(o.name, 1.0)) > 0 for o in observed) for k in keys]
    of_parts = np.where(grows, np.minimum(noise_degrees, settings.growing_noise), noise_degrees)
    return Rows(squares, alone, key, record, noise_degrees, of_parts, scatter, by_line, smooth, axis, settings)


def _scatter(observed: Sequence[ObservedRecording], noise: Noise, fit: FitResult, key: tuple[str, float]) -> float:
    """Variance of a cell's power relative to that of white normal noise: of correlated noise, and of heavy tails."""
    mine = [o for o in observed if o.noise_key == key]
    result = 1.0
    if key in noise.borrowed:
        level = np.concatenate([background(fit.residuals[o.name]) for o in mine])
        result = float(np.mean(level**2) / np.mean(level) ** 2)
    if noise.tail(mine[0]) > 1:
        resting = [fit.residuals[o.name] for o in observed if o.channel == key[0] and o.at_rest]
        squares = np.concatenate([*resting, np.zeros(0)])
        squares = squares[squares != 0] ** 2  # spikes have been cut down
        own = float(squares.var() / (2 * squares.mean() ** 2)) if squares.size else noise.tail(mine[0])
        result *= min(max(own, 1.0), noise.tail(mine[0]))
    return result


def taken_by_fit(
    observed: Sequence[ObservedRecording], noise: Noise, fit: FitResult, columns: Sequence[Real], q: Real
) -> list[Real]:
    """Columns (n, k) of each recording whose sum of squares is the share of a sample's noise that the fit removes.

    In predicted rows it is the share that the fit's error adds.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        All recordings of the fit, in its order.
    noise : Noise
        Noise that whitens them.
    fit : FitResult
        The fitted model.
    columns : sequence of ndarray, shape (n, size)
        Whitened sensitivities of each recording to the base parameters.
    q : ndarray, shape (rows, k)
        Orthonormal columns of the fitted rows, as `OutputErrorFit.basis` has them.

    Raises
    ------
    ValueError
        ``q`` belongs to other recordings.
    """
    rows = np.concatenate([c[: o.fitted] for o, c in zip(observed, columns, strict=True) if o.fitted])
    if rows.shape[0] != q.shape[0]:
        raise ValueError(
            f"q must have a row for each fitted sample, {rows.shape[0]}; got {q.shape[0]}. It belongs to other "
            "recordings."
        )
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    back = np.linalg.pinv(q.T @ (rows / size), rcond=1e-10)
    found, at = [], 0
    for o, own in zip(observed, columns, strict=True):
        taken = (own / size) @ back
        taken[: o.fitted] = q[at : at + o.fitted]
        at += o.fitted
        free = _amplitude_columns(o, noise, fit)
        if free is not None:
            noise_degrees = o.fitted or o.excitation.samples
            extra = np.zeros((o.excitation.samples, free.shape[1]))
            extra[:noise_degrees] = np.linalg.qr(free[:noise_degrees])[0]
            taken = np.column_stack([taken, extra])
        found.append(taken)
    return found


def _amplitude_columns(o: ObservedRecording, noise: Noise, fit: FitResult) -> Real | None:
    """Whitened columns, shape (n, j), with amplitudes fitted to each recording by itself; None if there are none."""
    if o.channel == "drive_monitor":
        return None
    columns = [
        c for effect, values in fit.active.pairs if (c := effect.random_effect_basis(values, o.excitation)) is not None
    ]
    if o.excitation.initial_state == "free" and o.excitation.fast:
        head = fit.head.printhead
        columns.append(free_ringing(o.excitation.samples, o.excitation.step_s, head.a0, head.a1))
    return noise.whitened(o, np.column_stack(columns)) if columns else None
