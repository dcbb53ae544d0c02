"""Base model and effects fitted together: free-run output error over every recording, noise whitened.

Minimised is half the sum of squares of Eq. (1) of docs/explanation/identification.md, over the fitted samples,

    Σ_j ‖W_j (y_j − ŷ_j(θ))‖²                                                                                    (1)

where ``W_j`` whitens the noise of recording ``j``. An effect hardly changes the sensitivities to the base parameters.
These are therefore computed once and projected out of the residuals, and Gauss–Newton steps with Levenberg's damping
run in the effects' coordinates alone. The model itself is simulated anew at every step: only the direction of a step is
approximate, never the residuals that are compared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from inkjet_env.identification.basis import free_ringing
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.damped_step import damped_step
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, finer
from inkjet_env.mismatch.fitting.fit_result import FitResult, ModelState
from inkjet_env.mismatch.settings import DiagnosisSettings
from inkjet_env.plant import Effect, Plant, Values
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import limits
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.plant.remainder import Remainder
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

DIFFERENCE = 1e-4
"""Finite-difference step of a coordinate, relative to its scale."""
WORST = 1e300
MOST_RECENT = 3
"""Number of states whose signals are kept: where a fit is, where it was, and what it tries."""


class OutputErrorFit:
    """Fits on one set of recordings with one noise.

    Parameters
    ----------
    observed : sequence of ObservedRecording
        All recordings, those held out too.
    noise : Noise
        Noise that whitens them.
    head : Head
        Base parameters at which every fit starts and the base sensitivities are taken.
    settings : DiagnosisSettings
        Settings of the diagnosis that these fits belong to.
    random_effects : sequence of (Effect, values)
        Random effects that are known to be present; what their bases can explain is projected out everywhere.
    base : FitResult, optional
        The base model on these recordings; fitted unless given.
    around : FitResult, optional
        Fit with whose effects on the base sensitivities are taken; without effects unless given.
    root : OutputErrorFit, optional
        The same fits with the base sensitivities of the base model.
    plain : Head, optional
        Base parameters at which the fits of a first effect begin; ``head`` unless given. A mismatch bends the law of
        the base model wherever that helps; what an effect does to a law so bent says little of what it does to another.
    """

    def __init__(
        self,
        observed: Sequence[ObservedRecording],
        noise: Noise,
        head: Head,
        settings: DiagnosisSettings,
        random_effects: Sequence[tuple[Effect, Values]] = (),
        base: FitResult | None = None,
        around: FitResult | None = None,
        root: OutputErrorFit | None = None,
        plain: Head | None = None,
    ) -> None:
        self.settings = settings
        self.root = root
        self.plain = plain
        self.random_effects = tuple(random_effects)
        self.around = around
        self.observed = tuple(observed)
        self.noise = noise
        self.start = head
        self.seen = tuple(o for o in self.observed if o.fitted)
        self.ends = np.cumsum([o.fitted for o in self.seen])
        self._limits: dict[str, tuple[Real, Real]] = {}
        self._recent: list[tuple[ModelState, dict[str, Real]]] = []
        self.base = base or self.fit(ActiveEffects())

    @cached_property
    def basis(self) -> tuple[Real, Real]:
        """QR factors of the base sensitivities over the fitted rows: shapes (rows, rank) and (rank, size).

        Where a recording cannot be simulated near the fit, its sensitivities are those without effects.
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
        identifiable = np.abs(np.diag(r)) > 1e-10
        return q[:, identifiable], r[identifiable] * size

    @cached_property
    def base_rank(self) -> int:
        """Number of base parameters that these recordings determine, effects or not."""
        return self.root.base_rank if self.root else int(self.basis[0].shape[1])

    def _sensitivities(self, o: ObservedRecording, on: Sequence[tuple[Effect, Values]]) -> Real:
        try:
            return self.start.sensitivities(o, on)
        except NUMERICAL:
            return self.start.sensitivities(o)

    def stacked(self, signals: Mapping[str, Real], effects: Sequence[tuple[Effect, Values]] = ()) -> Real:
        """Signals (n,) or columns (n, k), whitened, random effects projected out; fitted rows of all recordings."""
        return np.concatenate([self.whitened(o, signals[o.name], effects)[: o.fitted] for o in self.seen])

    def whitened(self, o: ObservedRecording, columns: Real, effects: Sequence[tuple[Effect, Values]] = ()) -> Real:
        """Columns of one recording, whitened, less what its own random-effect amplitudes explain; all samples."""
        white = self.noise.whitened(o, columns)
        amplitude_columns = self.amplitude_columns(o, effects)
        if amplitude_columns is None:
            return white
        rows = o.fitted or o.excitation.samples  # the held-out end of a recording is not used
        q, r = np.linalg.qr(amplitude_columns[:rows])
        amplitudes = np.linalg.lstsq(r, q.T @ white[:rows], rcond=1e-12)[0]
        return white - amplitude_columns @ amplitudes

    def amplitude_columns(self, o: ObservedRecording, effects: Sequence[tuple[Effect, Values]] = ()) -> Real | None:
        """Whitened columns, shape (n, j), with amplitudes of their own in each recording; None if there are none.

        They are the free ringing from an unknown initial state and the random-effect bases.
        """
        if o.channel == "drive_monitor":
            return None
        on = (*self.random_effects, *effects)
        columns = [c for effect, values in on if (c := effect.random_effect_basis(values, o.excitation)) is not None]
        if o.excitation.initial_state == "free" and o.excitation.fast:
            head = self.start.printhead
            columns.append(free_ringing(o.excitation.samples, o.excitation.step_s, head.a0, head.a1))
        return self.noise.whitened(o, np.column_stack(columns)) if columns else None

    def signals(
        self, at: ModelState, chosen: Sequence[ObservedRecording], remainder: Remainder | None = None
    ) -> dict[str, Real]:
        """Free-run signals by recording, in each channel's unit, shape (n,), with a remainder if one is given."""
        return _signals(replace(at.head.plant(at.active.pairs), remainder=remainder), at.states, chosen)

    def _kept(self, at: ModelState, chosen: Sequence[ObservedRecording]) -> dict[str, Real]:
        """`signals` of this fit's own recordings; those of the last few states are kept."""
        known = next((known for state, known in self._recent if state is at), None)
        if known is None:
            known = {}
            self._recent = [(at, known), *self._recent[: MOST_RECENT - 1]]
        known.update(self.signals(at, [o for o in chosen if o.name not in known]))
        return {o.name: known[o.name] for o in chosen}

    def modelled(self, fit: FitResult, remainder: Remainder | None = None) -> dict[str, Real]:
        """A fit's signal of every recording, in the channel's unit: free-run, plus its own random-effect amplitudes.

        A remainder, if one is given, corrects the free-run signals; unknown initial states are fitted anew with it.
        """
        end = fit.end if remainder is None else self._with_states(self._with_states(fit.end, remainder), remainder)
        signals = self.signals(end, self.observed, remainder)
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

    def numerical_error(self, fit: FitResult, substeps: int) -> float:
        """Distance between simulations on this many nodes per sample and on twice as many, in standard deviations.

        The standard deviations are those of the noise. The distance is the root of the sum of squares over all fitted
        samples: 1 corresponds to one parameter's standard error. It is infinite if the plant cannot be simulated on
        twice as many nodes.
        """
        here = self.signals(fit.end, finer(self.seen, substeps))
        try:
            there = self.signals(fit.end, finer(self.seen, 2 * substeps))
        except NUMERICAL:
            return math.inf
        return float(np.linalg.norm(self.stacked({o.name: here[o.name] - there[o.name] for o in self.seen})))

    @cached_property
    def from_plain(self) -> OutputErrorFit:
        """The same fits, begun at the plain base parameters."""
        if self.plain is None or self.plain.printhead.full_scale_V != self.start.printhead.full_scale_V:
            return self
        return self.anew(head=self.plain, base=self.base, root=self.root or self)

    def near(self, fit: FitResult) -> OutputErrorFit:
        """The same fits, with the base sensitivities taken at the end of another fit, its effects on."""
        return self.anew(head=fit.head, base=self.base, around=fit, root=self.root or self)

    def anew(
        self,
        observed: Sequence[ObservedRecording] | None = None,
        noise: Noise | None = None,
        head: Head | None = None,
        random_effects: Sequence[tuple[Effect, Values]] | None = None,
        base: FitResult | None = None,
        around: FitResult | None = None,
        root: OutputErrorFit | None = None,
    ) -> OutputErrorFit:
        """Fits of the same diagnosis with other recordings, noise, start or random effects; the others stay.

        Parameters are those of the class. The base model is fitted anew, and its sensitivities are taken without
        effects, unless ``base`` and ``around`` are given.
        """
        return OutputErrorFit(
            self.observed if observed is None else observed,
            noise or self.noise,
            head or self.start,
            self.settings,
            self.random_effects if random_effects is None else random_effects,
            base,
            around,
            root,
            self.plain,
        )

    def fit(
        self,
        active: ActiveEffects,
        head: Head | None = None,
        most_steps: int | None = None,
        whole: bool = False,
        known: Real | None = None,
    ) -> FitResult:
        """Least squares, Eq. (1), from a starting point, by Levenberg's damped Gauss–Newton steps.

        Parameters
        ----------
        active : ActiveEffects
            Effects that are on and their starting coordinates.
        head : Head, optional
            Starting base parameters; those of the base model unless given.
        most_steps : int, optional
            Number of steps after which the fit ends, converged or not; ``settings.fitting.most_steps`` unless given.
        whole : bool
            Whether terms of the effects' laws that are off may be switched on.
        known : ndarray, shape (rows, j), optional
            Sensitivities to the first j coordinates, taken elsewhere; good enough to step by, as the base
            sensitivities are.
        """
        head, settings = head or self.start, self.settings.fitting
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
        for _ in range(settings.most_steps if most_steps is None else most_steps):
            try:
                jacobian = self.jacobian(here, low, high, known)
            except NUMERICAL:
                if here is jacobian_at:  # at the start: nothing is known of this fit
                    raise
                break
            jacobian_at = here
            enough = max(settings.step_gain, settings.step_gain_share * (nll - 0.5 * residuals.size))
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
        everything = self._kept(end, self.observed)
        residuals = {o.name: self.whitened(o, o.measured - everything[o.name], end.active.pairs) for o in self.observed}
        return FitResult(end, residuals, nll, jacobian, converged, jacobian_at, whole, self.start)

    def again(self, end: ModelState, jacobian_at: ModelState, started: Head, converged: bool, whole: bool) -> FitResult:
        """The result of a fit whose end is known, restored by simulating there.

        Parameters
        ----------
        end, jacobian_at : ModelState
            As `FitResult` has them.
        started : Head
            As `FitResult` has it.
        converged, whole : bool
            As `FitResult` has them.
        """
        here = self.anew(head=started, base=self.base)
        _, nll = here._residuals(end)
        low, high = here._free(jacobian_at.active, whole)
        return here._ended(end, nll, here.jacobian(jacobian_at, low, high), converged, jacobian_at, whole)

    def _free(self, active: ActiveEffects, whole: bool) -> tuple[Real, Real]:
        """Bounds of the coordinates in a fit, shape (k,) each; equal for terms that are off and stay off."""
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
        signals = self._kept(at, self.seen)
        residuals = self.stacked({o.name: o.measured - signals[o.name] for o in self.seen}, at.active.pairs)
        nll = 0.5 * float(residuals @ residuals)  # Eq. (1), halved
        return residuals, nll if math.isfinite(nll) else WORST

    def adapted_nll(self, fit: FitResult, active: ActiveEffects) -> float:
        """Negative log-likelihood at a fit with other effects, its base parameters adapted to first order."""
        try:
            residuals, _ = self._residuals(replace(fit.end, active=active))
        except NUMERICAL:
            return WORST
        left = residuals - self.basis[0] @ (self.basis[0].T @ residuals)
        return 0.5 * float(left @ left)

    def explained_first(self, fit: FitResult, active: ActiveEffects, first: Sequence[int]) -> float:
        """Sum of squares that effects explain in the first fitted samples of each recording, beyond a fit with others.

        Both have the fit's base parameters, adapted to these samples to first order. It is 0 if the effects cannot be
        simulated.
        """
        try:
            residuals, _ = self._residuals(replace(fit.end, active=active))
        except NUMERICAL:
            return 0.0
        if not np.isfinite(residuals).all():
            return 0.0
        begins = self.ends - [o.fitted for o in self.seen]
        chosen = np.concatenate([np.arange(begin, begin + n) for begin, n in zip(begins, first, strict=True)])
        before = np.concatenate([fit.residuals[o.name][:n] for o, n in zip(self.seen, first, strict=True)])
        pair = np.column_stack([before, residuals[chosen]])
        columns = self.basis[0][chosen]
        pair -= columns @ np.linalg.lstsq(columns, pair, rcond=1e-9)[0]
        return float(pair[:, 0] @ pair[:, 0] - pair[:, 1] @ pair[:, 1])

    def _with_states(self, at: ModelState, remainder: Remainder | None = None) -> ModelState:
        """Unknown initial states after one linear least-squares step towards each recording."""
        if not at.states:
            return at
        chosen = [o for o in self.observed if o.name in at.states]
        signals = self._kept(at, chosen) if remainder is None else self.signals(at, chosen, remainder)
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
            State at which they are taken.
        low, high : ndarray, shape (k,)
            Bounds of the coordinates; the column of one that cannot move is zero.
        known : ndarray, shape (rows, j), optional
            Sensitivities to the first j coordinates, taken elsewhere.

        Returns
        -------
        ndarray, shape (rows, k)
            The column of a coordinate whose influence the base parameters can reproduce is zero.
        """
        active = at.active
        columns = np.zeros((int(self.ends[-1]), active.theta.size))
        if not active.theta.size:
            return columns
        here = self._kept(at, self.seen)
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
            try:
                signals = self.signals(replace(at, active=active.stepped(k, size)), touched)
            except NUMERICAL:  # the plant may be simulated on the other side alone
                if not low[k] <= active.theta[k] - size <= high[k]:
                    raise
                size = -size
                signals = self.signals(replace(at, active=active.stepped(k, size)), touched)
            for o in touched:
                changed[o.name][k] = (signals[o.name] - here[o.name]) / size
        for o, end in zip(self.seen, self.ends, strict=True):
            if changed[o.name]:
                white = self.whitened(o, np.column_stack(list(changed[o.name].values())), active.pairs)
                columns[end - o.fitted : end, list(changed[o.name])] = white[: o.fitted]
        q, _ = self.basis
        own = np.linalg.norm(columns - q @ (q.T @ columns), axis=0)
        columns[:, own < self.settings.fitting.own_sensitivity * np.linalg.norm(columns, axis=0)] = 0.0
        return columns

    def signature(self, effect: Effect, values: Values) -> Real:
        """Change of the fitted rows when an effect is switched on, base parameters fixed: whitened, shape (rows,).

        This is ``W (ŷ(θ) − ŷ(0))`` of the score test, Eq. (1) of docs/explanation/diagnosis.md.
        """
        base = self.base.end  # the values as they are given, not as their coordinates round them
        on = _signals(base.head.plant([(effect, values)]), base.states, self.seen)
        return self.stacked({o.name: on[o.name] - self._off[o.name] for o in self.seen})

    @cached_property
    def _off(self) -> dict[str, Real]:
        """Signals of the base model, by recording: those with every effect switched off."""
        return self.signals(self.base.end, self.seen)


def _signals(
    plant: Plant, states: Mapping[str, tuple[float, float]], chosen: Sequence[ObservedRecording]
) -> dict[str, Real]:
    return {
        o.name: plant.signal(replace(o.excitation, start=states[o.name]) if o.name in states else o.excitation)
        for o in chosen
    }


def state_columns(printhead: Printhead, gain: float, o: ObservedRecording) -> Real:
    """What one hysteretic volt of initial deflection and of scaled speed adds to a signal, without effects: (n, 2)."""
    from inkjet_env.plant.oscillator import amplitude
    from inkjet_env.printhead.resonator import pole

    lam, omega0 = pole(printhead.a0, printhead.a1), math.sqrt(printhead.a0)
    ringing = np.exp(lam * o.excitation.step_s * np.arange(o.excitation.samples))
    columns = []
    for x, p in ((1.0, 0.0), (0.0, 1.0)):
        motion = amplitude(lam, x, p * omega0) * ringing
        shown = (lam * motion).imag / printhead.a0 if o.channel == "self_sensing" else motion.imag
        columns.append(gain * shown)
    return np.column_stack(columns)
