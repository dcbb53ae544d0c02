"""Compiled kernel: response of a resonator to each power of the branch law, sample by sample."""

from __future__ import annotations

import numpy as np

from inkjet_env.printhead.compiled_gradient import moments as fill_moments
from inkjet_env.printhead.kernel_cache import kernel_jit

MAX_DEGREE = 16
"""Largest degree of the branch law."""

BINOMIALS = np.zeros((MAX_DEGREE, MAX_DEGREE))
"""``(j + 1) · C(j, k)``: factors of ``d/dτ (x + dx τ)^(j + 1) = Σ_k (j + 1) C(j, k) x^(j - k) dx^(k + 1) τ^k``."""
for _j in range(MAX_DEGREE):
    _row = 1.0
    for _k in range(_j + 1):
        BINOMIALS[_j, _k] = (_j + 1) * _row
        _row = _row * (_j - _k) / (_k + 1)

_jit = kernel_jit(__file__)


@_jit
def basis_amplitudes(pieces, step_s, pole, binomials, start, im_factor, columns):
    """Response to ``v = Σ_j c_j φ_j``, one column for each power ``j`` of the branch law.

    The complex amplitude of each column obeys ``A' = λA + φ_j' / Im λ``, so ``Im A`` is the response of
    ``s / (s² + a1 s + a0)``: Eq. (8a) and (8b) of `inkjet_env.printhead.resonator`, exact on every piece.

    Parameters
    ----------
    pieces : ndarray, shape (p, 6)
        Branch pieces from `inkjet_env.printhead.hysteresis.branch_pieces`, in order of their segments.
    step_s : float
        Sampling step, in seconds.
    pole : complex
        λ, in 1/s.
    binomials : ndarray, shape (MAX_DEGREE, MAX_DEGREE)
        `BINOMIALS`.
    start : ndarray of complex, shape (d,)
        Amplitudes at the first sample; on return, at the last.
    im_factor : complex
        Factor of the amplitude: the columns receive ``Im(im_factor · A)``.
    columns : ndarray, shape (n, d)
        Filled with the response at every sample.
    """
    n, degree = columns.shape
    whole = np.exp(pole * step_s)
    moments = np.empty(degree, dtype=np.complex128)
    part = np.empty(degree, dtype=np.complex128)
    forced = np.empty(degree, dtype=np.complex128)
    powers = np.empty(degree)
    fill_moments(pole * step_s, degree, moments)
    inverse = 1.0 / pole.imag
    at = 0
    count = pieces.shape[0]
    for j in range(degree):
        columns[0, j] = (im_factor * start[j]).imag
    for segment in range(n - 1):
        if at >= count or pieces[at, 0] != segment:
            for j in range(degree):
                start[j] *= whole
        covered = 0.0
        while at < count and pieces[at, 0] == segment:
            length, x, dx, scale = pieces[at, 2], pieces[at, 3], pieces[at, 4], pieces[at, 5]
            if length == 1.0:
                decay = whole
                m = moments
            else:
                decay = np.exp(pole * step_s * length)
                fill_moments(pole * step_s * length, degree, part)
                m = part
            scale *= inverse
            if x >= 1.0:  # on the tangent
                for j in range(degree):
                    start[j] = start[j] * decay + scale * dx * (j + 1) * m[0]  # Eq. (8b)
            else:
                power = 1.0
                factor = scale * dx
                for k in range(degree):
                    powers[k] = power
                    power *= x
                    forced[k] = factor * m[k]
                    factor *= dx
                for j in range(degree):
                    total = 0j
                    for k in range(j + 1):
                        total += binomials[j, k] * powers[j - k] * forced[k]
                    start[j] = start[j] * decay + total  # Eq. (8b)
            covered += length
            at += 1
        if 0.0 < covered < 1.0 - 1e-12:
            decay = np.exp(pole * step_s * (1.0 - covered))
            for j in range(degree):
                start[j] *= decay
        for j in range(degree):
            columns[segment + 1, j] = (im_factor * start[j]).imag
