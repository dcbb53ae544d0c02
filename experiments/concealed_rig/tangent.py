"""What a refit of the base model absorbs: its tangent space over a campaign, and a mismatch without it."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from experiments.concealed_rig.grid import Grid, grid_of
from experiments.concealed_rig.head import LARGEST_DRIVE_V, Head
from experiments.concealed_rig.linear import linear_motion
from experiments.concealed_rig.measurement import CHANNELS, Measurement
from experiments.concealed_rig.play import play_sums_V

DENSITIES = 9  # polynomials of degree 0 … 8, beside the reversible part
RELATIVE_STEP = 1e-5


@njit(cache=True)
def _without(row, directions, count):
    """Take the first `count` orthonormal directions out of a row, in place."""
    for k in range(count):
        product = 0.0
        for i in range(row.size):
            product += directions[k, i] * row[i]
        for i in range(row.size):
            row[i] -= product * directions[k, i]


@njit(cache=True)
def _orthonormal(rows, smallest):
    """Modified Gram–Schmidt, twice over, in place; the number of directions, which come first."""
    count = 0
    for k in range(rows.shape[0]):
        row = rows[k].copy()
        before = np.sqrt(np.sum(row * row))
        if before == 0.0:
            continue
        row /= before
        _without(row, rows, count)
        after = np.sqrt(np.sum(row * row))
        if after <= smallest:
            continue
        row /= after
        _without(row, rows, count)
        rows[count] = row / np.sqrt(np.sum(row * row))
        count += 1
    return count


@dataclass(frozen=True)
class BaseTangent:
    """Orthonormal directions over all samples of a campaign, each sample in units of its channel's noise.

    Parameters
    ----------
    directions : ndarray, shape (parameters, samples)
    """

    directions: np.ndarray

    def unexplained(self, mismatch: np.ndarray) -> np.ndarray:
        """A weighted mismatch, shape (samples,), less what a refit of the base absorbs."""
        left = np.array(mismatch, dtype=float)
        _without(left, self.directions, self.directions.shape[0])
        return left


def _hysteretic_components(head: Head, drive_V: np.ndarray, periodic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Reversible part and polynomial densities, shape (10, n), and the head's own hysteretic drive, shape (n,)."""
    threshold, weight = head.plays()
    share = threshold / LARGEST_DRIVE_V
    densities = np.polynomial.legendre.legvander(2 * share - 1, DENSITIES - 1).T / threshold.size
    sums = play_sums_V(drive_V, threshold, np.vstack((densities, weight)), periodic)
    return np.vstack((drive_V, sums[:-1])), head.reversible * drive_V + sums[-1]


def _sensor(channel: str, head: Head, omega: float, zeta: float, h: np.ndarray, grid: Grid) -> np.ndarray:
    x, v = linear_motion(omega, zeta, h, grid)
    return head.b1_per_s / omega * v if channel == "self_sensing" else head.displacement_nm_per_V * x


def _block(head: Head, row: Measurement) -> np.ndarray:
    """Derivatives of one recording, shape (n, 13 + offsets and gains of the channels)."""
    channels = list(CHANNELS)
    slow = row.channel == "strain_gauge"
    grid = grid_of(row.drive_V.size, row.step_s, row.periodic, 0.0 if slow else head.resonance_Hz, per_period=1)
    components, whole = _hysteretic_components(head, grid.halves(row.drive_V), row.periodic)
    block = np.zeros((row.drive_V.size, 12 + 2 * len(channels)))
    if slow:
        block[:, :10] = head.gauge_gain_V_per_V * np.stack([grid.at_samples(c[::2]) for c in components], axis=1)
        gain = grid.at_samples(whole[::2])
    else:
        omega, zeta = head.angular_rad_per_s, head.damping_ratio
        block[:, :10] = np.stack(
            [grid.at_samples(c) for c in _sensor(row.channel, head, omega, zeta, components, grid)], axis=1
        )
        up, down = 1 + RELATIVE_STEP, 1 - RELATIVE_STEP
        # a0 with a1 kept: ζ falls as ω rises. The displacement is b0/a0 times its static one.
        for column, (ends, dampings) in enumerate((((up, down), (1 / up, 1 / down)), ((1, 1), (up, down)))):
            plus, minus = (
                _sensor(row.channel, head, omega * w, zeta * z, whole, grid)
                / (w**2 if row.channel == "displacement" else 1.0)
                for w, z in zip(ends, dampings, strict=True)
            )
            block[:, 10 + column] = grid.at_samples(plus - minus) / RELATIVE_STEP
        gain = grid.at_samples(_sensor(row.channel, head, omega, zeta, whole, grid))
    place = channels.index(row.channel)
    block[:, 12 + 2 * place] = gain
    block[:, 13 + 2 * place] = 1.0
    return block


def base_tangent(head: Head, rows: list[Measurement], sigma: dict[str, float]) -> BaseTangent:
    """Tangent space of the base model: ten components of the hysteresis, a0, a1, gains and offsets of the channels.

    Parameters
    ----------
    head : Head
        Where the tangent is taken.
    rows : list of Measurement
    sigma : dict
        Standard deviation of the noise by channel.
    """
    matrix = np.hstack([_block(head, row).T / sigma[row.channel] for row in rows])
    return BaseTangent(matrix[: _orthonormal(matrix, 1e-6)].copy())
