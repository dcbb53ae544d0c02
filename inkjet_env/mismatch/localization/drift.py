"""Apparent drift of the resonance from recording to recording: frequency and damping of each recording by itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.settings import LocalizationSettings
from inkjet_env.typing import Real


@dataclass(frozen=True)
class Trend:
    """A straight line through the shifts of the recordings.

    Attributes
    ----------
    what : str
        Parameter that shifts: "frequency" or "damping".
    against : str
        Abscissa: "order" of the recordings or their largest "drive".
    change : float
        Relative change of ``what`` from the least to the largest value of ``against``.
    z : float
        Standard deviations by which the slope differs from 0; scatter beyond the noise counts as noise.
    power : float
        Mean square of the recordings' shifts in units of their standard errors; 1 is noise.
    """

    what: str
    against: str
    change: float
    z: float
    power: float


def shifts(
    observed: Sequence[ObservedRecording], noise: Noise, fit: FitResult, columns: Sequence[Real]
) -> dict[str, Real]:
    """Relative shifts of each fast recording's frequency and damping, with their standard errors.

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

    Returns
    -------
    dict of str to ndarray, shape (2, 2)
        By recording, rows (frequency, its error) and (damping, its error). Recordings that do not ring are absent.
    """
    ratios = np.array([[0.5, 0.0], [-0.5, 1.0]])  # f = √a0 / 2π, ζ = a1 / 2√a0
    place = fit.head.degree
    found = {}
    for o, own in zip(observed, columns, strict=True):
        if not o.excitation.fast or o.still:
            continue
        normal = own[:, place : place + 2]
        square = normal.T @ normal
        if np.linalg.matrix_rank(square) < 2:
            continue
        inverse = np.linalg.inv(square)
        moved = ratios @ inverse @ (normal.T @ fit.residuals[o.name])
        error = np.sqrt(np.diag(ratios @ inverse @ ratios.T))
        found[o.name] = np.column_stack([moved, error])
    return found


def trends(
    observed: Sequence[ObservedRecording], moved: Mapping[str, Real], settings: LocalizationSettings
) -> list[Trend]:
    """Lines through the shifts against the order of the recordings and against their largest drive."""
    mine = [o for o in observed if o.name in moved]
    axes: dict[str, Callable[[ObservedRecording], float]] = {
        "order": lambda o: float(o.excitation.order),
        "drive": lambda o: float(np.abs(o.excitation.drive_V).max()),
    }
    found = []
    for row, what in enumerate(("frequency", "damping")):
        precise = [o for o in mine if moved[o.name][row, 1] < settings.trend_error]
        if len(precise) < settings.trend_recordings:
            continue
        value = np.array([moved[o.name][row, 0] for o in precise])
        error = np.array([moved[o.name][row, 1] for o in precise])
        for against, of in axes.items():
            axis = np.array([of(o) for o in precise])
            width = float(np.ptp(axis))
            if not width:
                continue
            weight = 1 / error**2
            centred = axis - np.sum(weight * axis) / weight.sum()
            spread = float(np.sum(weight * centred**2))
            slope = float(np.sum(weight * centred * value)) / spread
            level = float(np.sum(weight * value)) / weight.sum()
            scatter = float(np.sum(((value - level - slope * centred) / error) ** 2)) / max(len(precise) - 2, 1)
            z = slope * np.sqrt(spread / max(scatter, 1.0))
            found.append(Trend(what, against, slope * width, float(z), float(np.mean((value / error) ** 2))))
    return found
