"""Sensor signal of each power of the branch law: the model, linear in its coefficients.

With ``Q(x) = Σ c_j x^j``, Eq. (5) of docs/explanation/model.md, the hysteretic drive is ``v = Σ c_j φ_j``, where
``φ_j`` depends on the drive alone, including the tangent beyond ``x = 1``. Resonator and gains are linear too, so every
channel shows ``gain · Σ c_j ψ_j + offset``:

* strain gauge: ``ψ_j = φ_j``;
* self-sensing: ``ψ_j`` is the response of ``s / (s² + a1 s + a0)`` to ``φ_j``, and the gain is ``b1``;
* displacement: ``ψ_j`` is the response of ``a0 / (s² + a1 s + a0)`` to ``φ_j``, and the gain is ``b0 / a0``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkjet_env.printhead.resonator import pole
from inkjet_env.typing import Real


@dataclass(frozen=True, eq=False)
class DriveBasis:
    """The powers of the branch law under one sampled drive; made by `drive_basis`.

    Attributes
    ----------
    pieces : ndarray, shape (p, 6)
        Branch pieces of the recorded period; for a periodic drive including the segment from the last sample back to
        the first.
    level_V : ndarray, shape (d,)
        ``φ_j`` at the first sample, in volts, after the virgin curve and the warm-up periods.
    samples : int
        Number of samples, n.
    step_s : float
        Sampling step, in seconds.
    initial_state : str
        State at the first sample: ``demagnetised``, ``periodic`` or ``free``; see `drive_basis`.
    """

    pieces: Real
    level_V: Real
    samples: int
    step_s: float
    initial_state: str

    @property
    def degree(self) -> int:
        """Number of powers, 1 … d."""
        return self.level_V.size

    def hysteretic_V(self) -> Real:
        """``φ_j`` at every sample, in volts, shape (n, d)."""
        changes = np.zeros((self.samples, self.degree))
        row = self.pieces[:, 0].astype(np.int64) + 1
        inside = row < self.samples
        powers = _power_changes(self.pieces[inside], self.degree)
        for j in range(self.degree):
            changes[:, j] = np.bincount(row[inside], powers[:, j], minlength=self.samples)
        return self.level_V + np.cumsum(changes, axis=0)

    def response(self, channel: str, a0: float, a1: float) -> Real:
        """``ψ_j`` at every sample, shape (n, d); see the docstring of this module.

        Parameters
        ----------
        channel : {"strain_gauge", "self_sensing", "displacement"}
            Sensor of the recording.
        a0, a1 : float
            Coefficients of an underdamped resonator, in 1/s² and 1/s.
        """
        if channel == "strain_gauge":
            return self.hysteretic_V()
        from inkjet_env.identification import compiled_basis

        pole_ = pole(a0, a1)
        start = np.zeros(self.degree, dtype=np.complex128)
        periodic = self.initial_state == "periodic"
        columns = np.empty((self.samples + periodic, self.degree))
        factor = 1.0 + 0j if channel == "self_sensing" else pole_ + a1

        def run() -> None:
            compiled_basis.basis_amplitudes(
                self.pieces, self.step_s, pole_, compiled_basis.BINOMIALS, start, factor, columns
            )

        run()
        if periodic:  # the steady state is the state that one period maps to itself
            start /= -np.expm1(pole_ * self.step_s * self.samples)
            run()
        columns = columns[: self.samples]
        # Deflection as the static hysteretic drive that would hold it: v - (a1 y + y') for b1 = 1, y' = Im λA.
        return columns if channel == "self_sensing" else self.hysteretic_V() - columns

    def free_states(self, a0: float, a1: float) -> Real:
        """`free_ringing` at the samples of this drive."""
        return free_ringing(self.samples, self.step_s, a0, a1)


def free_ringing(samples: int, step_s: float, a0: float, a1: float) -> Real:
    """Free ringing from an unknown initial state of the resonator: two columns of unit initial amplitude, (n, 2)."""
    ringing = np.exp(pole(a0, a1) * step_s * np.arange(samples))
    return np.column_stack([ringing.real, ringing.imag])


def drive_basis(drive_V: Real, step_s: float, full_scale_V: float, degree: int, initial_state: str) -> DriveBasis:
    """The powers of the branch law under a sampled drive.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Drive at the samples in volts, linear between them.
    step_s : float
        Sampling step, in seconds.
    full_scale_V : float
        Change of drive at ``x = 1``, in volts.
    degree : int
        Highest power.
    initial_state : {"demagnetised", "periodic", "free"}
        ``periodic``: the drive has been repeated since the demagnetised state. ``free``: the state of the resonator is
        unknown, and the hysteresis starts from the demagnetised state.
    """
    periodic = initial_state == "periodic"
    drive = np.ascontiguousarray(np.append(drive_V, drive_V[0]) if periodic else drive_V, dtype=np.float64)
    x = 2 * abs(drive[0]) / full_scale_V
    exponents = np.arange(1, degree + 1)
    virgin = x**exponents if x <= 1 else 1 + exponents * (x - 1)
    level = np.sign(drive[0]) * full_scale_V / 2 * virgin
    pieces = _pieces(drive, full_scale_V, 0)
    if periodic:
        level = level + _power_changes(pieces, degree).sum(axis=0)
        pieces = _pieces(drive, full_scale_V, 1)
    return DriveBasis(pieces, level, len(drive_V), step_s, initial_state)


def _pieces(drive_V: Real, full_scale_V: float, warm_up_periods: int) -> Real:
    from inkjet_env.printhead import compiled

    table = np.empty((4 * drive_V.size + 32, 6))
    memory = np.empty((warm_up_periods + 1) * drive_V.size + 4)
    count = compiled.branch_pieces(drive_V, full_scale_V, warm_up_periods, False, memory, table)
    return table[:count].copy()


def _power_changes(pieces: Real, degree: int) -> Real:
    """Change of ``φ_j`` over each piece, in volts, shape (p, d)."""
    x, dx, scale = pieces[:, 3], pieces[:, 4], pieces[:, 5]
    exponents = np.arange(1, degree + 1)
    beyond = (x >= 1.0)[:, None]
    start, end = np.where(beyond, 1.0, x[:, None]), np.where(beyond, 1.0, (x + dx)[:, None])
    return scale[:, None] * np.where(beyond, exponents * dx[:, None], end**exponents - start**exponents)


def warm_up() -> None:
    """Compile the kernels of the identification, or load them from the cache."""
    drive_basis(np.array([0.0, 1.0, 0.0]), 1e-6, 2.0, 2, "periodic").response("self_sensing", 1e11, 3e4)
