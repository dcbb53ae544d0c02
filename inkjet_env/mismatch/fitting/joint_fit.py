"""Base model and effects fitted together: free-run output error over every recording, noise whitened.

The base parameters enter by their sensitivities, which an effect hardly changes; so they are computed once, projected
out of what is left, and Gauss–Newton steps with Levenberg's damping run in the effects' coordinates alone. The model
itself is simulated anew with every step: only the direction of a step is approximate, never what is compared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from inkjet_env.identification.basis import free_ringing
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.damped_step import damped_step
from inkjet_env.mismatch.fitting.dataset import Noise, ObservedRecording, finer
from inkjet_env.mismatch.fitting.fit_result import FitResult, ModelState
from inkjet_env.plant import Effect, Values
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import limits
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

MOST_STEPS = 25
CONVERGED = 0.01
"""A step that promises less of the log-likelihood is the last."""
FAR_FROM_RIGHT = 1e-3
"""So does one that promises less than this share of what is left beyond noise: what is wrong may be so roughly."""
DIFFERENCE = 1e-4
"""Finite-difference step of a coordinate, in parts of its scale."""
LEAST_OWN = 1e-4
"""Share of a sensitivity that the base parameters cannot stand in for, below which the parameter stays where it is."""
WORST = 1e300


class OutputErrorFit:
    """Fits on one set of recordings with one noise.

    Parameters
    ----------
    observed : sequence of ObservedRecording
    noise : Noise
    head : Head
        The base model: where every fit begins.
    random_effects : sequence of (Effect, values)
        Effects by chance that are known to be there: what their columns can explain is taken out everywhere.
    base : Fit, optional
        The base model on these recordings; fitted unless given.
    around : Fit, optional
        Whose effects are on where the base parameters' sensitivities are taken.
    """

    def __init__(
        self,
        observed: Sequence[ObservedRecording],
        noise: Noise,
        head: Head,
        random_effects: Sequence[tuple[Effect, Values]] = (),
        base: FitResult | None = None,
        around: FitResult | None = None,
    ) -> None:
        self.random_effects = tuple(random_effects)
        self.around = around
        self.observed = tuple(observed)
        self.noise = noise
        self.start = head
        self.seen = tuple(o for o in self.observed if o.fitted)
        self.ends = np.cumsum([o.fitted for o in self.seen])
        self._limits: dict[str, tuple[Real, Real]] = {}
        self.base = base or self.fit(ActiveEffects())

    @cached_property
    def basis(self) -> tuple[Real, Real]:
        """Orthonormal columns of the base sensitivities over the fitted rows, and their triangle.

        Where a recording cannot be simulated beside where the fit is, they are those without effects.
        """
        on = self.around.active.pairs if self.around else ()
        states = self.around.end.states if self.around else {}
        chosen = [
            replace(o, excitation=replace(o.excitation, start=states[o.name])) if o.name in states else o
            for o in self.seen
        ]
        columns = self.stacked({o.name: self._sensitivities(o, on) for o in chosen})
        size = np.linalg.norm(columns, axis=0)
        size[size == 0] = 1.0
        q, r = np.linalg.qr(columns / size)
        told = np.abs(np.diag(r)) > 1e-10
        return q[:, told], r[told] * size

    def _sensitivities(self, o: ObservedRecording, on: Sequence[tuple[Effect, Values]]) -> Real:
        try:
            return self.start.sensitivities(o, on)
        except NUMERICAL:
            return self.start.sensitivities(o)

    def stacked(self, signals: Mapping[str, Real], effects: Sequence[tuple[Effect, Values]] = ()) -> Real:
        """Signals (n,) or columns (n, k), whitened, chance taken out; fitted rows one recording after another."""
        return np.concatenate([self.whitened(o, signals[o.name], effects)[: o.fitted] for o in self.seen])

    def whitened(self, o: ObservedRecording, columns: Real, effects: Sequence[tuple[Effect, Values]] = ()) -> Real:
        """Of one recording: whitened, less whatever its own chance amplitudes can explain; all samples."""
        white = self.noise.whitened(o, columns)
        chance = self.chance(o, effects)
        if chance is None:
            return white
        rows = o.fitted or o.excitation.samples  # the held-out end of a recording tells nothing
        q, r = np.linalg.qr(chance[:rows])
        amplitudes = np.linalg.lstsq(r, q.T @ white[:rows], rcond=1e-12)[0]
        return white - chance @ amplitudes

    def chance(self, o: ObservedRecording, effects: Sequence[tuple[Effect, Values]] = ()) -> Real | None:
        """Whitened columns of what is free in each recording: an unknown initial state, an effect's columns."""
        if o.channel == "drive_monitor":
            return None
        on = (*self.random_effects, *effects)
        columns = [c for effect, values in on if (c := effect.random_effect_basis(values, o.excitation)) is not None]
        if o.excitation.initial_state == "free" and o.excitation.fast:
            head = self.start.printhead
            columns.append(free_ringing(o.excitation.samples, o.excitation.step_s, head.a0, head.a1))
        return self.noise.whitened(o, np.column_stack(columns)) if columns else None

    def signals(self, at: ModelState, chosen: Sequence[ObservedRecording]) -> dict[str, Real]:
        """Free-run signals by recording, in each channel's unit, shape (n,)."""
        plant, states = at.head.plant(at.active.pairs), at.states
        return {
            o.name: plant.signal(replace(o.excitation, start=states[o.name]) if o.name in states else o.excitation)
            for o in chosen
        }

    def modelled(self, fit: FitResult) -> dict[str, Real]:
        """What a fit makes of every recording, in the channel's unit: free-run, with the recording's own chance."""
        signals = self.signals(fit.end, self.observed)
        for o in self.observed:
            on = (*self.random_effects, *fit.active.pairs)
            columns = [
                c for effect, values in on if (c := effect.random_effect_basis(values, o.excitation)) is not None
            ]
            if columns and o.channel != "drive_monitor":
                table = np.column_stack(columns)
                pair = self.noise.whitened(o, np.column_stack([table, o.measured - signals[o.name]]))
                signals[o.name] = signals[o.name] + table @ np.linalg.lstsq(pair[:, :-1], pair[:, -1], rcond=1e-12)[0]
        return signals

    def numerical_error(self, fit: FitResult) -> float:
        """How far the plant on these nodes is from the plant on twice as many, in standard deviations of the noise.

        Root of the sum of squares over all fitted samples: 1 is as much as one parameter's standard error.
        Infinite where the plant on twice as many has no answer.
        """
        substeps = 2 * max(o.excitation.substeps for o in self.seen)
        fine = finer(self.seen, substeps)
        here = self.signals(fit.end, self.seen)
        try:
            there = self.signals(fit.end, fine)
        except NUMERICAL:
            return math.inf
        return float(np.linalg.norm(self.stacked({o.name: here[o.name] - there[o.name] for o in self.seen})))

    def near(self, fit: FitResult) -> OutputErrorFit:
        """The same, with the base parameters' sensitivities taken where a fit has come to, its effects on."""
        return OutputErrorFit(self.observed, self.noise, fit.head, self.random_effects, self.base, fit)

    def fit(
        self,
        active: ActiveEffects,
        head: Head | None = None,
        most_steps: int = MOST_STEPS,
        whole: bool = False,
        known: Real | None = None,
    ) -> FitResult:
        """Least squares from a starting point, by Levenberg's damped Gauss–Newton steps.

        Parameters
        ----------
        active : ActiveEffects
            Effects that are on and the coordinates to begin at.
        head : Head, optional
            Where the base parameters begin; at the base model unless given.
        most_steps : int
            Steps after which the fit ends, converged or not.
        whole : bool
            Whether terms of the effects' laws that are off may come on.
        known : ndarray, shape (rows, j), optional
            Sensitivities to the first coordinates, taken elsewhere: as good to step by as the base parameters' are.
        """
        head = head or self.start
        low, high = self._free(active, whole)
        active = active.at(np.clip(active.theta, low, high))
        states = {
            o.name: (0.0, 0.0) for o in self.observed if o.excitation.initial_state == "free" and o.excitation.fast
        }
        here = self._with_states(ModelState(head, active, states))
        residuals, nll = self._residuals(here)
        q, r = self.basis
        damping, converged = 1e-3, False
        jacobian, jacobian_at = np.zeros((residuals.size, 0)), here
        for _ in range(most_steps):
            jacobian_at = here
            jacobian = self.jacobian(here, low, high, known)
            enough = max(CONVERGED, FAR_FROM_RIGHT * (nll - 0.5 * residuals.size))
            own = residuals - q @ (q.T @ residuals)
            in_base = q.T @ jacobian
            mine = jacobian - q @ in_base
            gram, moment, toward = mine.T @ mine, mine.T @ own, q.T @ residuals
            accepted = False
            for attempt in range(8):
                theta = here.active.theta
                step = damped_step(gram, moment, damping, theta, low, high)
                base = np.linalg.lstsq(r, 0.5**attempt * toward - in_base @ step, rcond=1e-12)[0]
                promise = nll - 0.5 * float(np.sum((own - mine @ step) ** 2))
                try:
                    trial = ModelState(here.head.moved(base), active.at(np.clip(theta + step, low, high)), here.states)
                    trial = self._with_states(trial)
                    trial_residuals, trial_nll = self._residuals(trial)
                except NUMERICAL:
                    trial_nll = WORST
                if trial_nll <= nll:
                    accepted = True
                    break
                if promise < enough:
                    break
                damping = max(damping, 1e-6) * 10
            if not accepted:
                converged = promise < max(1.0, enough)
                break
            gained = nll - trial_nll
            here, residuals, nll = trial, trial_residuals, trial_nll
            damping /= 5
            if promise < enough or gained < enough:
                converged = True
                break
        if known is not None:
            jacobian = self.jacobian(jacobian_at, low, high)
        return self._ended(here, nll, jacobian, converged, jacobian_at, whole)

    def _ended(
        self, end: ModelState, nll: float, jacobian: Real, converged: bool, jacobian_at: ModelState, whole: bool
    ) -> FitResult:
        everything = self.signals(end, self.observed)
        residuals = {o.name: self.whitened(o, o.measured - everything[o.name], end.active.pairs) for o in self.observed}
        return FitResult(end, residuals, nll, jacobian, converged, jacobian_at, whole, self.start)

    def again(self, end: ModelState, jacobian_at: ModelState, started: Head, converged: bool, whole: bool) -> FitResult:
        """A fit of which it is known where it ended."""
        here = OutputErrorFit(self.observed, self.noise, started, self.random_effects, self.base)
        _, nll = here._residuals(end)
        low, high = here._free(jacobian_at.active, whole)
        return here._ended(end, nll, here.jacobian(jacobian_at, low, high), converged, jacobian_at, whole)

    def _free(self, active: ActiveEffects, whole: bool) -> tuple[Real, Real]:
        """Bounds of the coordinates in a fit, shape (k,) each; equal for terms that are off and stay so."""
        low, high = self.limits(active.effects)
        off = active.off & (not whole)
        return np.where(off, active.theta, low), np.where(off, active.theta, high)

    def limits(self, effects: Sequence[Effect]) -> tuple[Real, Real]:
        """Bounds of the effects' coordinates on the fitted recordings, shape (k,) each."""
        for effect in effects:
            if effect.id not in self._limits:
                excitations = [o.excitation for o in self.seen if o.channel != "drive_monitor"]
                self._limits[effect.id] = limits(effect, self.start.printhead, excitations)
        ends = [self._limits[effect.id] for effect in effects]
        empty = [np.zeros(0)]
        return np.concatenate([a for a, _ in ends] or empty), np.concatenate([b for _, b in ends] or empty)

    def _residuals(self, at: ModelState) -> tuple[Real, float]:
        """Whitened residuals of the fitted rows, shape (rows,), and their negative log-likelihood."""
        signals = self.signals(at, self.seen)
        residuals = self.stacked({o.name: o.measured - signals[o.name] for o in self.seen}, at.active.pairs)
        nll = 0.5 * float(residuals @ residuals)
        return residuals, nll if math.isfinite(nll) else WORST

    def _with_states(self, at: ModelState) -> ModelState:
        """Unknown initial states moved one linear step nearer to what each recording shows."""
        if not at.states:
            return at
        chosen = [o for o in self.observed if o.name in at.states]
        signals = self.signals(at, chosen)
        plant, moved = at.head.plant(), {}
        for o in chosen:
            rows = o.fitted or o.excitation.samples
            columns = state_columns(at.head.printhead, plant.gain(o.channel), o)
            pair = self.noise.whitened(o, np.column_stack([columns, o.measured - signals[o.name]]))[:rows]
            change = np.linalg.lstsq(pair[:, :2], pair[:, 2], rcond=None)[0]
            moved[o.name] = (at.states[o.name][0] + float(change[0]), at.states[o.name][1] + float(change[1]))
        return replace(at, states=moved)

    def jacobian(self, at: ModelState, low: Real, high: Real, known: Real | None = None) -> Real:
        """Whitened sensitivities of the fitted rows to the coordinates, by finite differences of the plant.

        Parameters
        ----------
        at : ModelState
            Where they are taken.
        low, high : ndarray, shape (k,)
            Bounds of the coordinates; one that cannot move gets zeros.
        known : ndarray, shape (rows, j), optional
            Sensitivities to the first coordinates, taken elsewhere.

        Returns
        -------
        ndarray, shape (rows, k)
            Zero for a coordinate for which the base parameters can stand in.
        """
        active = at.active
        columns = np.zeros((int(self.ends[-1]), active.theta.size))
        if not active.theta.size:
            return columns
        here = self.signals(at, self.seen)
        first = 0 if known is None else known.shape[1]
        if known is not None:
            columns[:, :first] = known
        values = {effect.id: own for effect, own in active.pairs}
        changed: dict[str, dict[int, Real]] = {o.name: {} for o in self.seen}
        for k, (effect, parameter) in enumerate(active.parameters):
            if k < first or low[k] == high[k]:
                continue
            size = DIFFERENCE * active.scale(k)
            if active.theta[k] + size > high[k]:
                size = -size
            touched = [o for o in self.seen if effect.changes(parameter.name, o.excitation, values[effect.id])]
            signals = self.signals(replace(at, active=active.stepped(k, size)), touched)
            for o in touched:
                changed[o.name][k] = (signals[o.name] - here[o.name]) / size
        for o, end in zip(self.seen, self.ends, strict=True):
            if changed[o.name]:
                white = self.whitened(o, np.column_stack(list(changed[o.name].values())), active.pairs)
                columns[end - o.fitted : end, list(changed[o.name])] = white[: o.fitted]
        q, _ = self.basis
        own = np.linalg.norm(columns - q @ (q.T @ columns), axis=0)
        columns[:, own < LEAST_OWN * np.linalg.norm(columns, axis=0)] = 0.0
        return columns

    def signature(self, effect: Effect, values: Values) -> Real:
        """What switching an effect on changes in the fitted rows, base parameters fixed: whitened, shape (rows,)."""
        on = self.signals(replace(self.base.end, active=ActiveEffects.of([(effect, values)])), self.seen)
        return self.stacked({o.name: on[o.name] - self._off[o.name] for o in self.seen})

    @cached_property
    def _off(self) -> dict[str, Real]:
        """Signals of the base model, which are those with any effect switched off."""
        return self.signals(self.base.end, self.seen)


def state_columns(printhead: Printhead, gain: float, o: ObservedRecording) -> Real:
    """What a unit of initial deflection and of scaled speed adds to a signal, shape (n, 2); without any effect."""
    from inkjet_env.plant.resonance import amplitude
    from inkjet_env.printhead.resonator import pole

    lam, omega0 = pole(printhead.a0, printhead.a1), math.sqrt(printhead.a0)
    ringing = np.exp(lam * o.excitation.step_s * np.arange(o.excitation.samples))
    columns = []
    for x, p in ((1.0, 0.0), (0.0, 1.0)):
        motion = amplitude(lam, x, p * omega0) * ringing
        shown = (lam * motion).imag / printhead.a0 if o.channel == "self_sensing" else motion.imag
        columns.append(gain * shown)
    return np.column_stack(columns)
