"""Base hysteresis that is no Prandtl–Ishlinskii law: Bouc–Wen, and a Preisach plane of product density."""

import numpy as np
from numba import njit

from experiments.concealed_rig.head import Head
from experiments.concealed_rig.play import play_sum_V


@njit(cache=True)
def _bouc_wen(drive, scale, order, beta, laps, out):
    z = 0.0
    for _ in range(laps):
        out[0] = z
        for k in range(1, drive.size):
            step = (drive[k] - drive[k - 1]) / scale
            pieces = int(abs(step) / 0.02) + 1
            du = step / pieces
            side = 1.0 if du > 0 else -1.0
            for _ in range(pieces):
                # Classical fourth order in u: the law is rate-independent.
                total = 0.0
                slope = 0.0
                for stage in range(4):
                    at = z + (0.0 if stage == 0 else (du if stage == 3 else 0.5 * du)) * slope
                    slope = 1.0 - abs(at) ** order * (beta * side * np.sign(at) + 1.0 - beta)
                    total += slope * (1.0 if stage in (0, 3) else 2.0)
                z += du * total / 6.0
            out[k] = z


def bouc_wen(drive_V: np.ndarray, periodic: bool, scale_V: float, order: float, beta: float) -> np.ndarray:
    """The inner variable z of Bouc–Wen, within ±1: dz/du = [1 − |z|ⁿ(β sgn(du z) + 1 − β)]/scale.

    Source: Y. K. Wen, J. Eng. Mech. Div. 102 (1976) 249; for piezo actuators T. S. Low, W. Guo, J. Microelectromech.
    Syst. 4 (1995) 230, whose output is a line minus z.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
    periodic : bool
        Twelve laps are gone through first: the minor loops of Bouc–Wen creep, and settle.
    scale_V, order, beta : float
    """
    out = np.zeros(drive_V.size)
    _bouc_wen(np.ascontiguousarray(drive_V, dtype=float), scale_V, order, beta, 13 if periodic else 1, out)
    return out


@njit(cache=True)
def _product_preisach(g, laps, out):
    at = np.empty(g.size + 2)
    value = np.empty(g.size + 2)
    count = 0
    last = 0.0
    rising = True
    for _ in range(laps):
        for k in range(g.size):
            u = g[k]
            if u != last:
                up = u > last
                if count == 0:
                    # On the virgin curve: it is left where the direction turns back to zero.
                    if last != 0.0 and up != (last > 0.0):
                        at[0], value[0], count = last, 2.0 * last * abs(last), 1
                elif up != rising:
                    span = last - at[count - 1]
                    value[count] = value[count - 1] + span * abs(span)
                    at[count] = last
                    count += 1
                rising = up
                # Wiping-out: a loop that is closed is forgotten, and so is the symmetric outermost one.
                while count > 1 and ((up and u >= at[count - 2]) or (not up and u <= at[count - 2])):
                    count -= 2
                if count == 1 and abs(u) >= abs(at[0]) and (u > 0.0) != (at[0] > 0.0):
                    count = 0
                last = u
            if count == 0:
                out[k] = 2.0 * u * abs(u)
            else:
                span = u - at[count - 1]
                out[k] = value[count - 1] + span * abs(span)


def product_preisach(warped: np.ndarray, periodic: bool) -> np.ndarray:
    """Preisach's plane with the product density μ(α, β) = g(α)g(β), from its Everett function.

    With G the integral of an even g, the Everett function is (G(α) − G(β))²/2, so a branch from a turning point at
    G₀ moves by (G − G₀)|G − G₀|, and the virgin curve is 2G|G|. With G(u) = u this is Rayleigh's law, or a
    Prandtl–Ishlinskii law of constant density.

    Source: I. D. Mayergoyz, Mathematical Models of Hysteresis (Springer 1991); G. Biorci, D. Pescetti,
    Nuovo Cimento 7 (1958) 829, for the product density.

    Parameters
    ----------
    warped : ndarray, shape (n,)
        G of the drive, point by point.
    periodic : bool
    """
    out = np.empty(warped.size)
    _product_preisach(np.ascontiguousarray(warped, dtype=float), 2 if periodic else 1, out)
    return out


def _opening(rising_falling: np.ndarray) -> float:
    quarter = rising_falling.size // 4
    return float(abs(rising_falling[quarter] - rising_falling[3 * quarter]))


def _full_loop_V() -> np.ndarray:
    return 90.0 * np.concatenate((np.linspace(-1, 1, 401)[:-1], np.linspace(1, -1, 401)))


def plays_opening_V(head: Head) -> float:
    """Opening, at 0 V, of the ±90 V loop of a head's own plays."""
    return _opening(play_sum_V(_full_loop_V(), *head.plays(), periodic=True))


def bouc_wen_opening(scale_V: float, order: float, beta: float) -> float:
    """Opening of the ±90 V loop of z."""
    return _opening(bouc_wen(_full_loop_V(), True, scale_V, order, beta))


def preisach_opening(scale_V: float) -> float:
    """Opening of the ±90 V loop of the product Preisach plane with G(u) = scale·tanh(u/scale)."""
    return _opening(product_preisach(scale_V * np.tanh(_full_loop_V() / scale_V), True))
