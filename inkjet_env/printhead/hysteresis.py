"""Rate-independent hysteresis of the ceramic: Prandtl–Ishlinskii as a branch law, and as play operators.

Between turning points ``u_k`` of the drive, the hysteretic drive ``v`` follows one law (Zhu et al. 2024, section 2.2.1;
equations are numbered as in docs/explanation/model.md), with ``F`` the full scale in volts and ``Q`` a polynomial::

    F_r[u](t) = max(u - r, min(u + r, F_r[u](t_k)))        play operator                            (1)
    v = ∫ p(r) F_r[u] dr                                   classic PI operator                      (2)
    v = v_k ± F Q(|u - u_k| / F)                           branch law, + rising, - falling          (3)
    p(r) = 2 Q''(2r)                                       density of the play operators            (4)
    Q(x) = Σ q_n x^n,  x = |u - u_k| / F                   polynomial                               (5)

Equation (3) is the classic Prandtl–Ishlinskii (PI) operator (2) with the density (4), *provided* that all turning
points are remembered: a minor loop that closes is wiped out, and the branch that it interrupted continues (Madelung's
rules). From the demagnetised state the virgin curve is ``F Q(2|u|/F) / 2``.

`branch_pieces` is the only place that keeps this memory; `PlayOperators` is the O(n) reference, which needs none.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from inkjet_env.naming import check_name
from inkjet_env.typing import Real

INITIAL_STATES = ("periodic", "demagnetised")
"""``periodic``: the drive has repeated for ever. ``demagnetised``: at rest at 0 V, so the virgin curve comes first."""

HYSTERESIS_MODELS = ("full_memory", "one_point", "play_operators")
"""``full_memory``: branch law with all turning points. ``one_point``: the paper's formula, which remembers only the
last turning point. ``play_operators``: the classic PI sum."""

SMALLEST_CHANGE_V = 1e-30
"""A drive that changes by less, in volts, is taken as constant; products of smaller numbers would underflow."""

PIECE_FIELDS = ("segment", "start", "length", "x_start", "x_change", "scale_V")
"""Columns of the table that `branch_pieces` fills; all dimensionless but the last, which is in volts."""


def periods_before_recording(initial_state: str) -> int:
    """Number of warm-up periods that bring the memory into ``initial_state``: 1 for periodic, 0 for demagnetised."""
    check_name("initial_state", initial_state, INITIAL_STATES)
    return 1 if initial_state == "periodic" else 0


def branch_pieces(drive_V, full_scale_V, warm_up_periods, one_point, memory_V, pieces):
    """Cut a piecewise-linear drive into pieces on which the branch law is one polynomial.

    Plain Python that also compiles as it stands. On a piece that covers the fractions ``start … start + length`` of
    drive segment ``segment``, the argument of ``Q`` grows linearly from ``x_start`` to ``x_start + x_change`` and
    ``dv = scale_V · dQ``, Eq. (3). A piece ends where the segment ends, where a loop closes, or at ``x = 1``, beyond
    which the law continues along its tangent.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Drive at the knots, in volts.
    full_scale_V : float
        ``F``: the change of drive at ``x = 1``, in volts.
    warm_up_periods : int
        Warm-up periods before the recorded one: 0 starts from the demagnetised state; 1 settles a periodic drive.
    one_point : bool
        Remember only the last turning point; the first sample counts as one.
    memory_V : ndarray, shape (≥ n + 1,)
        Scratch for the turning points, in volts.
    pieces : ndarray, shape (≥ 4 n + 16, 6)
        Filled with `PIECE_FIELDS`, one row per piece; segments at constant drive give none.

    Returns
    -------
    int
        Number of pieces.
    """
    n = drive_V.shape[0]
    depth = 0  # number of remembered turning points; zero on the virgin curve
    direction = 0
    count = 0
    u = 0.0
    if one_point:
        u = drive_V[0]
        memory_V[0] = u
        depth = 1
    for period in range(warm_up_periods + 1):
        recording = period == warm_up_periods
        # Segment -1 leads to the first sample: from 0 V when demagnetised, from the last sample when periodic.
        for segment in range(-1, n - 1):
            target = drive_V[segment + 1]
            whole = target - u
            start = u
            while u != target:
                heading = 1 if target > u else -1
                if direction != 0 and heading != direction:
                    if one_point:
                        memory_V[0] = u
                    else:
                        memory_V[depth] = u
                        depth += 1
                direction = heading
                end = target
                if depth == 0:  # virgin curve, from 0 V outwards: F Q(2|u|/F) / 2
                    x_start, x_end, scale = 2.0 * abs(u), 2.0 * abs(end), 0.5 * full_scale_V
                else:
                    origin = memory_V[depth - 1]
                    if not one_point:
                        limit = memory_V[depth - 2] if depth >= 2 else -memory_V[0]
                        if (limit - target) * heading <= 0.0:  # the loop closes on the way
                            end = limit
                            depth = depth - 2 if depth >= 2 else 0
                    x_start, x_end, scale = abs(u - origin), abs(end - origin), full_scale_V  # Eq. (3)
                if recording and segment >= 0 and abs(end - u) > SMALLEST_CHANGE_V:
                    x_start /= full_scale_V
                    x_end /= full_scale_V
                    at = (u - start) / whole
                    length = (end - u) / whole
                    split = (1.0 - x_start) / (x_end - x_start) if x_start < 1.0 < x_end else 1.0
                    pieces[count, 0] = segment
                    pieces[count, 1] = at
                    pieces[count, 2] = length * split
                    pieces[count, 3] = x_start
                    pieces[count, 4] = (x_end - x_start) * split
                    pieces[count, 5] = scale * heading
                    count += 1
                    if split < 1.0:
                        pieces[count, 0] = segment
                        pieces[count, 1] = at + length * split
                        pieces[count, 2] = length * (1.0 - split)
                        pieces[count, 3] = 1.0
                        pieces[count, 4] = x_end - 1.0
                        pieces[count, 5] = scale * heading
                        count += 1
                u = end
    return count


@dataclass(frozen=True)
class BranchLaw:
    """The polynomial ``Q`` of the improved PI model, Eq. (5), continued along its tangent beyond ``x = 1``.

    Parameters
    ----------
    coefficients : tuple of float
        Dimensionless coefficients of ``Q`` on ``x = |Δu| / full_scale_V``, highest power first; the last, the constant,
        is zero. Degree 1 to 16.
    full_scale_V : float
        Change of drive at ``x = 1``, in volts; the output of ``Q`` is scaled by it too.

    Examples
    --------
    >>> BranchLaw((1.0, 0.0), 180.0).hysteretic_V([0.0, 90.0, -90.0], "demagnetised")
    array([  0.,  90., -90.])
    """

    coefficients: tuple[float, ...]
    full_scale_V: float

    def __post_init__(self) -> None:
        values = tuple(float(c) for c in self.coefficients)
        object.__setattr__(self, "coefficients", values)
        if not 2 <= len(values) <= 17:
            raise ValueError(
                f"hysteresis coefficients must be 2 to 17 numbers (degree 1 to 16, highest power first); "
                f"got {len(values)}."
            )
        if not np.isfinite(values).all():
            raise ValueError(f"hysteresis coefficients must be finite; got {values}.")
        if values[-1] != 0.0:
            raise ValueError(
                "the last hysteresis coefficient must be 0, because without a change of drive nothing moves; "
                f"got {values[-1]:g}."
            )
        if max(map(abs, values)) > 1e9:
            raise ValueError(f"hysteresis coefficients must be within ±1e9, since x is at most about 1; got {values}.")
        if not 1e-3 <= self.full_scale_V <= 1e6:
            raise ValueError(f"full_scale_V must be a voltage of 1e-3 to 1e6 V; got {self.full_scale_V!r}.")

    @property
    def ascending(self) -> Real:
        """Coefficients, lowest power first, shape (degree + 1,)."""
        return np.array(self.coefficients[::-1])

    def Q(self, x: ArrayLike) -> Real:
        """Normalised branch ``Q(x)``, x ≥ 0, Eq. (5)."""
        x = np.asarray(x, dtype=np.float64)
        inside = np.minimum(x, 1.0)
        return poly.polyval(inside, self.ascending) + self.slope(1.0) * (x - inside)  # Eq. (5)

    def slope(self, x: ArrayLike) -> Real:
        """``Q'(x)``; constant beyond ``x = 1``."""
        return poly.polyval(np.minimum(np.asarray(x, dtype=np.float64), 1.0), poly.polyder(self.ascending))

    def curvature(self, x: ArrayLike) -> Real:
        """``Q''(x)``; zero beyond ``x = 1``."""
        x = np.asarray(x, dtype=np.float64)
        return np.where(x <= 1.0, poly.polyval(x, poly.polyder(self.ascending, 2)), 0.0)

    def density(self, r: ArrayLike) -> Real:
        """PI density ``p(r) = 2 Q''(2r)``, Eq. (4), at the normalised threshold ``r`` = threshold / full scale."""
        return 2.0 * self.curvature(2.0 * np.asarray(r, dtype=np.float64))  # Eq. (4)

    def strengthened(self, factor: float) -> BranchLaw:
        """The law with its hysteresis (all but the linear term, and so ``p(r)``) multiplied by ``factor``."""
        scaled = np.array(self.coefficients) * factor
        scaled[-2] = self.coefficients[-2]
        return BranchLaw(tuple(scaled), self.full_scale_V)

    def pieces(self, drive_V: ArrayLike, initial_state: str = "periodic", one_point: bool = False) -> Real:
        """`branch_pieces` of a drive in volts at its knots: array of shape (pieces, 6), columns `PIECE_FIELDS`."""
        drive = np.ascontiguousarray(drive_V, dtype=np.float64)
        warm_up_periods = periods_before_recording(initial_state)
        table = np.empty((4 * drive.size + 16, 6))
        memory = np.empty((warm_up_periods + 1) * drive.size + 2)
        return table[: branch_pieces(drive, self.full_scale_V, warm_up_periods, one_point, memory, table)]

    def hysteretic_V(self, drive_V: ArrayLike, initial_state: str = "periodic", one_point: bool = False) -> Real:
        """Hysteretic drive in volts at the knots of a drive, shape (n,).

        From the demagnetised state the first value lies on the virgin curve; otherwise it is 0 V, since the response
        depends on changes alone.
        """
        drive = np.asarray(drive_V, dtype=np.float64)
        pieces = self.pieces(drive, initial_state, one_point)
        segment, x, dx, scale = pieces[:, 0].astype(int), pieces[:, 3], pieces[:, 4], pieces[:, 5]
        # Eq. (3), piece by piece.
        change = np.bincount(segment, scale * (self.Q(x + dx) - self.Q(x)), minlength=max(drive.size - 1, 0))
        first = 0.0
        if initial_state == "demagnetised" and not one_point and drive.size:
            first = np.sign(drive[0]) * self.full_scale_V * float(self.Q(2 * abs(drive[0]) / self.full_scale_V)) / 2
        return first + np.concatenate([[0.0], np.cumsum(change)])


def play_operators(drive_V, thresholds_V, weights, states_V, output_V):
    """Classic PI: weighted play operators, one after another, O(n) per sample. Compiles as it stands.

    ``F_r[u](t) = max(u - r, min(u + r, w))``, Eq. (1), and ``v = Σ weight · F_r``, the sum for the integral of Eq. (2)
    (Zhu et al. 2024, section 2.2.1). ``states_V`` (k,) holds ``w`` on entry and on return; ``output_V`` (n,) receives
    ``v`` in volts.
    """
    for i in range(drive_V.shape[0]):
        u = drive_V[i]
        total = 0.0
        for k in range(thresholds_V.shape[0]):
            w = max(u - thresholds_V[k], min(u + thresholds_V[k], states_V[k]))  # Eq. (1)
            states_V[k] = w
            total += weights[k] * w  # Eq. (2)
        output_V[i] = total


@dataclass(frozen=True)
class PlayOperators:
    """The classic PI model: a finite sum of play operators, the reference for the branch law.

    Parameters
    ----------
    thresholds_V, weights : ndarray, shape (k,)
        Thresholds in volts (a threshold of 0 is the linear part) and dimensionless weights.
    """

    thresholds_V: Real
    weights: Real

    @classmethod
    def of_branch_law(cls, law: BranchLaw, operators: int) -> PlayOperators:
        """Quadrature of the PI integral, Eq. (2), with ``operators`` plays, plus the linear part.

        Thresholds are the midpoints of equal cells of ``0 … full_scale / 2``; a weight is the exact integral of the
        density over its cell, ``Q'(2 r_right) - Q'(2 r_left)``. The difference from the branch law falls as
        ``operators⁻²``.
        """
        if operators < 1:
            raise ValueError(f"operators must be at least 1; got {operators}.")
        r = np.linspace(0.0, 0.5, operators + 1)
        slopes = law.slope(2 * r)
        thresholds = np.concatenate([[0.0], (r[1:] + r[:-1]) / 2]) * law.full_scale_V
        return cls(thresholds, np.concatenate([[slopes[0]], np.diff(slopes)]))

    def hysteretic_V(self, drive_V: ArrayLike, initial_state: str = "periodic") -> Real:
        """Hysteretic drive in volts at the knots of a drive, shape (n,)."""
        drive = np.asarray(drive_V, dtype=np.float64)
        states = np.zeros_like(self.thresholds_V)
        for _ in range(periods_before_recording(initial_state) + 1):
            output = np.empty_like(drive)
            for i, u in enumerate(drive):
                states = np.maximum(u - self.thresholds_V, np.minimum(u + self.thresholds_V, states))  # Eq. (1)
                output[i] = self.weights @ states  # Eq. (2)
        return output

    def pieces(self, drive_V: ArrayLike, initial_state: str = "periodic") -> Real:
        """Pieces on which the hysteretic drive is linear: columns segment, start, length, change in volts."""
        drive = np.asarray(drive_V, dtype=np.float64)
        r, states = self.thresholds_V, np.zeros_like(self.thresholds_V)
        rows: list[tuple[float, ...]] = []
        for _ in range(periods_before_recording(initial_state) + 1):
            rows.clear()
            states = np.maximum(drive[0] - r, np.minimum(drive[0] + r, states))
            for segment, (u, target) in enumerate(itertools.pairwise(drive)):
                if u == target:
                    continue
                heading = np.sign(target - u)
                # A play moves once the drive has moved away from it by its threshold.
                engaged_at = np.clip((states + heading * r - u) / (target - u), 0.0, 1.0)
                breaks = np.unique(np.concatenate([[0.0], engaged_at, [1.0]]))
                for a, b in itertools.pairwise(breaks):
                    slope = self.weights[engaged_at <= a].sum()
                    rows.append((segment, a, b - a, slope * (b - a) * (target - u)))
                states = np.maximum(target - r, np.minimum(target + r, states))
        return np.array(rows).reshape(-1, 4)
