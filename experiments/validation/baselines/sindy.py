"""SINDy baseline: a sparse polynomial force on the resonator, and the effects that its terms stand for.

It uses pysindy's library and STLSQ. Every term passes through the base model's resonator before the regression, so that
noise is never differentiated.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inkjet_env.experiments.validation.baselines.base_fit import ASIDE_EVERY, over_noise, put_aside
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.plant import Excitation, Resonance
from inkjet_env.typing import Real

THRESHOLDS = (2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 2.0)
"""Smallest size of a term relative to the norm of the residual to explain; the last value removes all terms."""
MOST_ROUNDS = 60
SETTLED = 1e-6
"""Change of the variables, relative to the largest, at which force and motion are consistent."""
MOST_CHANGE_V = 1e6
NEVER = 50.0
"""Logarithm of the error assigned to a force without a steady motion."""
STIFFER, LOSSIER = {"x^3", "x p^2"}, {"p^3", "x^2 p"}
LATE = ("amplifier_bandwidth", "feedthrough", "sensor_bandwidth", "trigger_delay")


@dataclass(frozen=True, eq=False)
class SparseForce:
    """A polynomial force on the resonator of one channel.

    Attributes
    ----------
    joint : OutputErrorFit
        Fit to whose base model the force is added.
    sizes : ndarray, shape (k,)
        Scales by which the variables are divided.
    coefficients : ndarray, shape (terms,)
        Coefficients of the terms in hysteretic volts.
    """

    joint: OutputErrorFit
    sizes: Real
    coefficients: Real

    def terms(self, variables: Real) -> Real:
        """Values of all terms, shape (n, terms)."""
        scaled = variables / self.sizes
        powers = _library(self.sizes.size - 1).transform(scaled[:, :-1])
        return np.column_stack([np.asarray(powers, dtype=np.float64), scaled[:, -1]])

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the terms with a nonzero coefficient."""
        variables = list("xpv")[-(self.sizes.size - 1) :]
        names = [*_library(len(variables)).get_feature_names(variables), "w"]
        return tuple(name for name, c in zip(names, self.coefficients, strict=True) if c)

    def signal(self, o: ObservedRecording) -> Real:
        """Free-run signal, shape (n,), by fixed-point iteration of motion and force; NaN if it does not converge."""
        plant = self.joint.base.head.plant()
        shown, variables = _motion(self.joint, o, np.zeros(_fine(o).samples))
        for _ in range(MOST_ROUNDS):
            before = variables
            shown, variables = _motion(self.joint, o, self.terms(before) @ self.coefficients)
            change = float(np.abs(variables - before).max())
            if change <= SETTLED * float(np.abs(before).max()):
                return plant.gain(o.channel) * shown + plant.offsets[o.channel]
            if not change < MOST_CHANGE_V:
                break
        return np.full(o.excitation.samples, np.nan)


def _library(variables: int) -> Any:
    from pysindy import PolynomialLibrary

    return PolynomialLibrary(degree=3).fit(np.zeros((2, variables)))


def _fine(o: ObservedRecording) -> Excitation:
    """The excitation resampled so that every second node is a sample."""
    excitation, pairs = o.excitation, o.excitation.substeps // 2
    drive_V = np.ascontiguousarray(excitation.drive_at_nodes_V[::2])
    return replace(excitation, step_s=excitation.step_s / pairs, drive_V=drive_V, substeps=2, cache={})


def _motion(joint: OutputErrorFit, o: ObservedRecording, force_V: Real) -> tuple[Real, Real]:
    """The channel's signal at the samples for a gain of 1, and the variables, shape (fine samples, k)."""
    printhead = joint.base.head.printhead
    fine, pairs = _fine(o), o.excitation.substeps // 2
    drive_V = joint.base.head.plant().hysteretic_V(o.excitation.drive_at_nodes_V, o.excitation)
    omega0 = math.sqrt(printhead.a0)
    hysteretic_V = fine.sampled(drive_V)
    rate_V = np.gradient(hysteretic_V) / np.float64(fine.step_s * omega0)
    if not o.excitation.fast:
        return (hysteretic_V - force_V)[::pairs], np.column_stack([hysteretic_V, rate_V])
    fine = replace(fine, start=joint.base.end.states.get(o.name, (0.0, 0.0)))
    resonance = Resonance(printhead.a0, printhead.a1, printhead.a0)
    pushed_V = np.ascontiguousarray(drive_V - fine.refined(force_V))
    deflection_V = resonance.motion(pushed_V, replace(fine, channel="displacement"))
    speed = resonance.motion(pushed_V, replace(fine, channel="self_sensing"))
    shown = (speed if o.channel == "self_sensing" else deflection_V)[::pairs]
    return shown, np.column_stack([deflection_V, speed * omega0, hysteretic_V, rate_V])


def sparse_force(joint: OutputErrorFit, channel: str) -> SparseForce:
    """The sparse force fitted to one channel."""
    folds = [put_aside(joint, channel, fold) for fold in range(ASIDE_EVERY)]
    everything = [*folds[0][0], *folds[0][1]]
    variables = {o.name: _motion(joint, o, np.zeros(_fine(o).samples))[1] for o in everything}
    sizes = np.max([np.abs(table).max(axis=0) for table in variables.values()], axis=0)
    none = SparseForce(joint, sizes, np.zeros(_library(sizes.size - 1).n_output_features_ + 1))
    columns = {o.name: _as_seen(joint, o, none.terms(variables[o.name])) for o in everything}
    residuals = {o.name: joint.base.residuals[o.name][: o.fitted] for o in everything}

    def fitted(chosen: Sequence[ObservedRecording], threshold: float) -> SparseForce:
        table = np.concatenate([columns[o.name] for o in chosen])
        target = np.concatenate([residuals[o.name] for o in chosen])
        return replace(none, coefficients=_sparse(table, target, threshold))

    def errors(force: SparseForce, aside: Sequence[ObservedRecording]) -> list[float]:
        return [over_noise(joint, {o.name: force.signal(o)}, [o]) ** 2 for o in aside]

    tried = np.log([[error for fit, aside in folds for error in errors(fitted(fit, t), aside)] for t in THRESHOLDS])
    tried[np.isnan(tried)] = NEVER
    best = tried[int(np.argmin(tried.mean(axis=1)))]
    for threshold, found in reversed(list(zip(THRESHOLDS, tried, strict=True))):
        worse = found - best
        if worse.mean() <= np.std(worse) / math.sqrt(worse.size):
            return fitted(everything, threshold)
    return none


def _as_seen(joint: OutputErrorFit, o: ObservedRecording, terms: Real) -> Real:
    """First-order contribution of each term to a recording, whitened, over the fitted rows, shape (rows, terms)."""
    printhead, gain = joint.base.head.printhead, joint.base.head.plant().gain(o.channel)
    fine, pairs = replace(_fine(o), start=(0.0, 0.0)), o.excitation.substeps // 2
    resonance = Resonance(printhead.a0, printhead.a1, printhead.a0)
    added = []
    for term in terms.T:
        pushed = -np.ascontiguousarray(term)
        added.append(gain * (resonance.motion(fine.refined(pushed), fine) if o.excitation.fast else pushed)[::pairs])
    return joint.whitened(o, np.column_stack(added))[: o.fitted]


def _sparse(columns: Real, target: Real, threshold: float) -> Real:
    """Coefficients from pysindy's thresholded least squares on columns of unit length, shape (terms,)."""
    from pysindy import STLSQ

    sizes = np.linalg.norm(columns, axis=0)
    sizes[sizes == 0] = np.inf
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the warning that no term remains, which is a valid result
        size = float(np.linalg.norm(target))
        found = STLSQ(threshold=threshold * size, alpha=1e-8).fit(columns / sizes, target[:, None])
    return np.asarray(found.coef_, dtype=np.float64)[0] / sizes


def said(terms: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """The effects for which the terms of a `SparseForce` stand, in groups that it cannot distinguish.

    >>> said(["1", "x", "x^3"])
    (('cubic_stiffness',),)
    >>> said(["w", "x^3", "x^2 p"])
    (('ferroelastic_softening',), ('amplifier_bandwidth', 'feedthrough', 'sensor_bandwidth', 'trigger_delay'))
    """
    groups: list[tuple[str, ...]] = []
    stiffer, lossier = bool(STIFFER & set(terms)), bool(LOSSIER & set(terms))
    if stiffer or lossier:
        both = stiffer and lossier
        groups.append(("ferroelastic_softening" if both else "cubic_stiffness" if stiffer else "quadratic_damping",))
    meanings = {"v^2": ("asymmetric_hysteresis",), "w": LATE}
    groups += [meaning for term, meaning in meanings.items() if term in terms]
    return tuple(groups)
