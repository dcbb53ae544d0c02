"""Lumped elements of the head: mass, damper, spring and capacitance behind the identified ``a0, a1, b1``.

Deflection and current obey (Zhu et al. 2024, section 2.2.2; equations are numbered as in docs/explanation/model.md)

    m x'' + c x' + k x = f,   f = K_d U,   i = C_e U' + C_e K_V x'.                                 (6)

Deflection counts along the force here; the paper's ``… + f = 0`` counts it against the force. The self-sensing circuit
subtracts ``C_e U'`` and converts the rest to a voltage, ``K_s`` volts per ampere (section 3.2):

    G_s(s) = b1 s / (s² + a1 s + a0),   a0 = k/m,   a1 = c/m,   b1 = K_s K_V K_d C_e / m.           (7)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkjet_env.printhead.resonator import check_resonator


@dataclass(frozen=True)
class LumpedElements:
    """A second-order piezo actuator and its transfer functions.

    Parameters
    ----------
    mass_kg, damping_N_s_per_m, stiffness_N_per_m : float
        Mass ``m`` in kg, damping ``c`` in N s/m and stiffness ``k`` in N/m; the system must be underdamped.
    force_N_per_V : float
        ``K_d``: force per volt of drive, in N/V.
    voltage_V_per_m : float
        ``K_V``: change of voltage per deflection, in V/m.
    capacitance_F : float
        ``C_e``: equivalent capacitance of the head, in farads.
    sensing_V_per_A : float
        ``K_s``: gain of the current-to-voltage converter, in V/A.

    Examples
    --------
    >>> head = LumpedElements(1e-6, 0.03, 1e5, 0.1, 1e5, 2e-9, 1e3)
    >>> [float(f"{value:.3g}") for value in (head.a0, head.a1, head.b1)]
    [100000000000.0, 30000.0, 20000.0]
    """

    mass_kg: float
    damping_N_s_per_m: float
    stiffness_N_per_m: float
    force_N_per_V: float
    voltage_V_per_m: float
    capacitance_F: float
    sensing_V_per_A: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise ValueError(f"{field.name} must be finite; got {value!r}.")
        if self.mass_kg <= 0:
            raise ValueError(f"mass_kg must be above 0 kg; got {self.mass_kg!r}.")
        check_resonator(self.a0, self.a1)

    @property
    def a0(self) -> float:
        """``k / m``, in 1/s²."""
        return self.stiffness_N_per_m / self.mass_kg  # Eq. (7)

    @property
    def a1(self) -> float:
        """``c / m``, in 1/s."""
        return self.damping_N_s_per_m / self.mass_kg  # Eq. (7)

    @property
    def b1(self) -> float:
        """``K_s K_V K_d C_e / m``, in 1/s."""
        coupling = self.voltage_V_per_m * self.force_N_per_V * self.capacitance_F
        return self.sensing_V_per_A * coupling / self.mass_kg  # Eq. (7)

    def G_V(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Force to deflection, ``1 / (m s² + c s + k)`` in m/N, at complex frequencies ``s`` in 1/s, same shape."""
        s = np.asarray(s, dtype=np.complex128)
        return 1.0 / ((self.mass_kg * s + self.damping_N_s_per_m) * s + self.stiffness_N_per_m)  # Eq. (6)

    def G_I(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Drive to current, ``K_V K_d C_e s G_V(s) + C_e s`` in A/V, at ``s`` in 1/s, same shape."""
        s = np.asarray(s, dtype=np.complex128)
        return self.capacitance_F * s * (1.0 + self.voltage_V_per_m * self.force_N_per_V * self.G_V(s))  # Eq. (6)

    def G_s(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Drive to self-sensed voltage, ``b1 s / (s² + a1 s + a0)``: ``K_s (G_I(s) - C_e s)``, dimensionless."""
        s = np.asarray(s, dtype=np.complex128)
        return self.b1 * s / ((s + self.a1) * s + self.a0)  # Eq. (7)
