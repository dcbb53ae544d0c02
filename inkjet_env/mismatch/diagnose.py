"""From a campaign to a diagnosis: noise, base model, where recordings and model differ, which effect is missing."""

from __future__ import annotations

import math
import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from inkjet_env.identification.identify import doubtful_states
from inkjet_env.mismatch.design.next_experiment import next_experiment
from inkjet_env.mismatch.diagnosis import Correction, Diagnosis, NamedEffect
from inkjet_env.mismatch.evidence import (
    chance_of,
    closest,
    closure_of,
    compared,
    modelled_recordings,
    named_effects,
    share_left,
)
from inkjet_env.mismatch.fitting.base_model import MOST_SUBSTEPS, base_model
from inkjet_env.mismatch.fitting.base_parameters import in_convention
from inkjet_env.mismatch.fitting.checkpoint import FitCheckpoint
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, finer, noise_seen, observe
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.headline import headline
from inkjet_env.mismatch.localization.locate import locate
from inkjet_env.mismatch.selection.base_intervals import dynamics
from inkjet_env.mismatch.selection.discrepancy_regression import DiscrepancyRegression, discrepancy_regression
from inkjet_env.mismatch.selection.held_out_refit import explains_held_out_after_refit, held_out_misfits
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis, settled
from inkjet_env.mismatch.selection.random_effects import RandomEffect, detect_random_effects, without
from inkjet_env.mismatch.selection.score_test import Signatures, signatures
from inkjet_env.mismatch.selection.stepwise import LEAST_IF_LARGE, Selection, leftover, select, supported
from inkjet_env.mismatch.selection.truncated_law import fit_truncated_law
from inkjet_env.mismatch.settings import LEFT_OVER, MOST_ALIKE, PREDICTED_POORLY
from inkjet_env.plant import Effect, catalogue
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign
from inkjet_env.typing import Real

FINE_ENOUGH = 0.5
"""Largest acceptable error of the simulation, in standard errors of a parameter."""
SURELY_PREDICTED = 2.0
"""Standard errors by which the discrepancy regression must gain on held-out recordings to be offered as correction."""
AS_WELL = 0.5
"""Share of the effects' gain that a bend of the law alone must reach to be tried in their place."""
SAME_GAIN = 0.02
"""Relative difference in gain, below which two random effects are not distinguished."""


def diagnose(
    campaign: Campaign,
    printhead: Printhead | None = None,
    effects: Sequence[Effect] | None = None,
    rng: np.random.Generator | int = 0,
    *,
    held_out: Sequence[str] | None = None,
    workers: int = 2,
    progress: Callable[[str], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> Diagnosis:
    """Find where recordings and the base model differ, and which effect is missing.

    Parameters
    ----------
    campaign : Campaign
        The recordings.
    printhead : Printhead, optional
        Where the base model's fit starts; identified from the campaign unless given. It is refitted either way.
    effects : sequence of Effect, optional
        Effects that may be missing; the catalogue unless given. An effect of your own is one class.
    rng : Generator or int
        Generator, or its seed, of the noise that scores are judged against.
    held_out : sequence of str, optional
        Names of recordings that no fit sees; chosen as by `identification.measurements` unless given. Effects that
        close less than half of the base model's mismatch there are not named, unless they explain these recordings once
        they are fitted too.
    workers : int
        Number of processes.
    progress : callable, optional
        Called with a short text that says what is being done.
    checkpoint : str or Path, optional
        Folder for finished fits: an interrupted diagnosis resumes from it, with the same result. It is removed when the
        diagnosis is complete.

    Returns
    -------
    Diagnosis
        Verdict, effects with intervals, location of the mismatch, fit before and after.

    Raises
    ------
    ValueError
        No base model can be identified from the recordings, the printhead belongs to another head, two effects share
        an id, or ``workers`` is less than 1.
    """
    catalogued = catalogue() if effects is None else tuple(effects)
    twice = [name for name, count in Counter(effect.id for effect in catalogued).items() if count > 1]
    if twice:
        raise ValueError(f"effects must have unique ids; {twice[0]!r} occurs twice. Rename one.")
    context = FitContext(
        ProcessPool(workers),
        np.random.default_rng(rng),
        progress or (lambda _: None),
        FitCheckpoint(checkpoint, catalogued),
    )
    work = _Work(campaign, catalogued, context)
    with threadpool_limits(1):  # matrices are small here, and the processes use the cores
        found = work.diagnosis(printhead, held_out)
    context.checkpoint.clear()
    return found


@dataclass(frozen=True, eq=False)
class _Candidate:
    """What was found in one base model's residuals."""

    joint: OutputErrorFit
    random_effects: list[RandomEffect]
    selection: Selection

    def score(self, on: OutputErrorFit) -> float:
        """Log-likelihood of the fitted recordings under another fit's noise, less Schwarz's penalty."""
        chosen = self.selection.chosen
        modelled, told = self.joint.modelled(chosen.fit), chosen.fit.active.pairs
        residuals = on.stacked({o.name: o.measured - modelled[o.name] for o in on.observed})
        amplitudes = [self.joint.chance(o, told) for o in on.seen]
        free = chosen.free + sum(len(s.values) for s in self.random_effects)
        free += sum(columns.shape[1] for columns in amplitudes if columns is not None)
        return -0.5 * float(residuals @ residuals) - 0.5 * free * math.log(residuals.size)


class _Work:
    """The steps of one diagnosis."""

    def __init__(self, campaign: Campaign, effects: Sequence[Effect], context: FitContext) -> None:
        self.campaign, self.context = campaign, context
        self.started = self.last = time.perf_counter()
        self.stages: dict[str, float] = {}
        self.notes: list[str] = []
        self.effects = tuple(effects)
        self.indistinguishable: dict[str, tuple[str, ...]] = {}
        self.doubt: str | None = None

    def took(self, stage: str) -> None:
        """Add the time since the last call to a stage."""
        now = time.perf_counter()
        self.stages[stage] = self.stages.get(stage, 0.0) + now - self.last
        self.last = now

    def diagnosis(self, printhead: Printhead | None, held_out: Sequence[str] | None) -> Diagnosis:
        """All steps of the diagnosis in order."""
        observed = observe(self.campaign, held_out)
        excitations = [o.excitation for o in observed if o.channel != "drive_monitor"]
        untestable = {e.id: reason for e in self.effects if (reason := e.untestable(excitations)) is not None}
        testable = [e for e in self.effects if e.id not in untestable]
        by_accident = [e for e in testable if e.random]
        lawful = [e for e in testable if e not in by_accident]
        self.context.progress("fitting the base model")
        joint = base_model(self.campaign, observed, printhead, held_out, self.context.progress)
        self.notes.extend(joint.noise.notes)
        if not any(o.fitted < o.excitation.samples for o in observed):
            self.notes.append("No recording was held out, so nothing was validated on recordings that no fit has seen.")
        self.doubt = doubtful_states(self.campaign, held_out)
        self.took("base model")
        told = self.candidate(joint, by_accident, lawful)
        if (other := self.with_another_law(joint, told)) is not None:
            self.context.progress("repeating with a branch law that is straight above a smaller swing")
            again = self.candidate(other, by_accident, lawful)
            if again.score(joint) - 0.5 * math.log(joint.ends[-1]) > told.score(joint):
                told = again
        joint, random_effects, selection = told.joint, told.random_effects, told.selection
        joint, chosen = self.polished(joint, selection.chosen, random_effects)
        if chosen.ids and self.quieter(joint, selection.chosen.joint):
            # With the effects found, the noise turns out smaller: is there more to be found?
            _, selection = self.selected(joint, lawful)
            joint, chosen = self.polished(joint, selection.chosen, random_effects)
        if chosen.ids and not supported(base_hypothesis(joint), chosen):
            chosen = base_hypothesis(joint)  # with finer nodes or another noise it is no longer supported
        self.took("selection")
        self.context.progress("testing the residuals")
        discrepancy = discrepancy_regression(chosen)
        self.took("flexible model")
        return self.verdict(joint, chosen, selection, random_effects, discrepancy, untestable)

    def candidate(self, joint: OutputErrorFit, by_accident: Sequence[Effect], lawful: Sequence[Effect]) -> _Candidate:
        """Random effects and effects with a law, found beside one base model."""
        random_effects: list[RandomEffect] = []
        if by_accident:
            self.context.progress("looking for random effects")
            resting = [o for o in joint.observed if o.at_rest]
            joint, random_effects = self.with_chance(joint, by_accident, resting, random_effects)
            self.took("chance")
        found, selection = self.selected(joint, lawful)
        nothing = not selection.chosen.ids
        if by_accident and (nothing or not leftover(selection.chosen, found, self.context.rng)):
            exact, chosen = self.polished(joint, selection.chosen, random_effects)
            trusted = [o for o in joint.observed if nothing or o.fitted]  # elsewhere, effects may predict badly
            again, more = self.with_chance(exact, by_accident, trusted, random_effects, chosen)
            self.took("chance")
            if more is not random_effects:
                joint, random_effects = again, more
                found, selection = self.selected(joint, lawful)
        return _Candidate(joint, random_effects, selection)

    def with_another_law(self, joint: OutputErrorFit, told: _Candidate) -> OutputErrorFit | None:
        """The base model with a law that is straight above some swing, if that may be the true cause; else None.

        It may be if the effects found leave a bend of the law that is a good part of their misfit beyond noise, or if
        the bend alone explains about as much as they do.
        """
        chosen = told.selection.chosen
        good_part = 0.5 * LEAST_IF_LARGE * chosen.excess if chosen.noise_known else 0.0
        bent = fit_truncated_law(told.joint, chosen, good_part)
        if bent is None and (chosen.ids or told.random_effects):
            bent = fit_truncated_law(joint, base_hypothesis(joint), AS_WELL * (told.score(joint) + joint.base.nll))
        self.took("base model")
        if bent is None:
            return None
        modelled = bent.modelled(bent.base)
        residuals = {o.name: o.measured - modelled[o.name] for o in joint.observed}
        return OutputErrorFit(
            joint.observed, noise_seen(joint.observed, residuals, dict(joint.noise.models)), bent.base.head
        )

    @staticmethod
    def less_chance(
        observed: Sequence[ObservedRecording], residuals: dict[str, Real], random_effects: Sequence[RandomEffect]
    ) -> dict[str, Real]:
        """Residuals without what these random effects can explain, in the channel's unit."""
        for one in random_effects:
            residuals = without(one.effect, one.values, observed, residuals)
        return residuals

    def with_chance(
        self,
        joint: OutputErrorFit,
        effects: Sequence[Effect],
        chosen: Sequence[ObservedRecording],
        random_effects: list[RandomEffect],
        beside: Hypothesis | None = None,
    ) -> tuple[OutputErrorFit, list[RandomEffect]]:
        """The joint fit with the random effects that these recordings show; the same if they show no further one."""
        for _ in range(2):
            fit = joint.base if beside is None else beside.fit
            modelled = joint.modelled(fit)
            residuals = {o.name: o.measured - modelled[o.name] for o in joint.observed}
            here = [e for e in effects if e.id not in {s.effect.id for s in random_effects}]
            found = detect_random_effects(chosen, residuals, joint.noise, here, fit.head.printhead) if chosen else []
            if not found:
                break
            best = found[0]
            rivals = tuple(
                dict.fromkeys(
                    f.effect.id
                    for f in found[1:]
                    if f.effect.id != best.effect.id
                    and f.channel == best.channel
                    and f.gain > (1 - SAME_GAIN) * best.gain - 3
                )
            )
            self.indistinguishable[best.effect.id] = rivals
            random_effects = [*random_effects, best]
            noise = noise_seen(
                joint.observed, self.less_chance(joint.observed, residuals, random_effects), dict(joint.noise.models)
            )
            joint = OutputErrorFit(joint.observed, noise, joint.start, [(s.effect, s.values) for s in random_effects])
        return joint, random_effects

    def selected(self, joint: OutputErrorFit, effects: Sequence[Effect]) -> tuple[Signatures, Selection]:
        """Signatures and stepwise selection with one noise."""
        found = signatures(joint, effects, self.context)
        self.took("signatures")
        selection = select(joint, effects, found, self.context)
        self.took("selection")
        return found, selection

    def polished(
        self, joint: OutputErrorFit, chosen: Hypothesis, random_effects: Sequence[RandomEffect]
    ) -> tuple[OutputErrorFit, Hypothesis]:
        """The chosen hypothesis refitted with its own noise, its law's swing set by convention, on fine enough nodes.

        If it cannot be refitted, it is returned as it was, marked as not converged.
        """
        if not chosen.ids:
            return joint, chosen
        before = joint
        while True:
            modelled = joint.modelled(chosen.fit)
            residuals = {o.name: o.measured - modelled[o.name] for o in joint.observed}
            residuals = self.less_chance(joint.observed, residuals, random_effects)
            noise = noise_seen(joint.observed, residuals, {})
            base = in_convention(joint.base.head)
            joint = OutputErrorFit(joint.observed, noise, base, joint.random_effects)
            near = joint.near(chosen.fit.moved(head=in_convention(chosen.fit.head)))
            try:
                chosen = settled(joint, near.fit(chosen.fit.active))
            except NUMERICAL:
                return before, replace(chosen, fit=replace(chosen.fit, converged=False))
            substeps = joint.observed[0].excitation.substeps
            error = joint.numerical_error(chosen.fit)
            if error < FINE_ENOUGH or substeps >= MOST_SUBSTEPS or math.isinf(error):
                break
            before = joint
            joint = OutputErrorFit(finer(joint.observed, 2 * substeps), noise, base, joint.random_effects)
        if math.isinf(error):
            self.notes.append(f"With more than {substeps} nodes per sample, the effects found cannot be simulated.")
        elif error >= FINE_ENOUGH:
            self.notes.append(
                f"With {substeps} nodes per sample, the simulation's numerical error is up to {error:.2g} standard "
                "errors of a parameter."
            )
        return joint, chosen

    @staticmethod
    def quieter(new: OutputErrorFit, old: OutputErrorFit) -> bool:
        """Whether the noise of any channel turned out much smaller."""
        return any(
            new.noise.models[key].rms < 0.7 * old.noise.models[key].rms
            for key in {o.noise_key for o in new.observed if new.noise.known(o)}
        )

    def verdict(
        self,
        joint: OutputErrorFit,
        chosen: Hypothesis,
        selection: Selection,
        random_effects: Sequence[RandomEffect],
        discrepancy: DiscrepancyRegression,
        untestable: dict[str, str],
    ) -> Diagnosis:
        """The diagnosis from everything that was found."""
        base = base_hypothesis(joint)
        # the base model has no random effects either
        bare = OutputErrorFit(joint.observed, joint.noise, joint.base.head) if random_effects else joint
        recordings = modelled_recordings(bare, joint, chosen, discrepancy)
        closure = closure_of(recordings)
        share = share_left(base_hypothesis(bare), chosen, discrepancy)
        groups = [(name, *others) for name, others in selection.alternatives.items() if others and name in chosen.ids]
        groups += [
            (s.effect.id, *self.indistinguishable[s.effect.id])
            for s in random_effects
            if self.indistinguishable.get(s.effect.id)
        ]
        anything = bool(chosen.ids or random_effects)
        refuted = (
            bool(chosen.ids)
            and closure < PREDICTED_POORLY
            and not explains_held_out_after_refit(joint, chosen, self.context)
        )
        vague = max(map(len, groups), default=0) > MOST_ALIKE
        # the base model was checked on fitted recordings alone: does it hold where it predicted badly?
        unseen = () if anything or math.isnan(closure) else held_out_misfits(joint)
        if share > LEFT_OVER or refuted or vague or unseen or self.doubt:
            verdict = "unknown"
        elif not anything:
            verdict = "none"
        else:
            verdict = "set" if groups else "named"
        self.context.progress("locating the mismatch")
        location = locate(bare.observed, bare.noise, bare.base, bare.basis[0])
        self.took("location")
        units = {o.channel: o.unit for o in joint.observed if o.channel != "drive_monitor"}
        named = [
            *(
                NamedEffect(
                    s.effect, s.effect.description(s.values, units[s.channel]), s.gain,
                    chance_of(s.gain, len(s.values), max(o.excitation.samples for o in joint.observed)),
                    s.estimates, s.values, units[s.channel],
                )
                for s in random_effects
            ),
            *named_effects(joint, chosen, selection),
        ]  # fmt: skip
        listed = compared(selection)
        correction = None
        if verdict == "unknown" and discrepancy.predicted > SURELY_PREDICTED * discrepancy.error:
            correction = Correction(discrepancy.share, discrepancy.predicted, discrepancy.error, discrepancy.modelled)
        fits = [chosen.fit]
        for group in groups if verdict == "set" else ():
            ids = set(chosen.ids)
            for other in group[1:]:
                wanted = (ids - {group[0]}) | {other}
                fits.extend(h.fit for h in selection.compared if set(h.ids) == wanted)
        self.context.progress("designing the next experiment")
        following = next_experiment(fits, joint.noise, joint.observed) if verdict == "set" else None
        self.took("next experiment")
        stands = base if verdict == "unknown" else chosen  # never half of a model that is not named
        head = stands.fit.head
        if not stands.fit.converged:
            of = " with ".join(name.replace("_", " ") for name in stands.ids) or "the base model"
            self.notes.append(
                f"The fit of {of} did not converge: its values are those at which it stopped, without known intervals."
            )
        gains, offsets = ({c: v for c, v in of.items() if c in units} for of in (head.gains, head.offsets))
        told = all(joint.noise.known(o) for o in joint.seen)
        said = self.doubt or headline(
            verdict, named, groups, closure, share, closest(base, selection), location, told, unseen
        )
        groups = [] if verdict == "unknown" else groups
        return Diagnosis(
            self.campaign.name, verdict, said, tuple(named) if verdict != "unknown" else (), tuple(groups),
            location, recordings, closure, share, listed, untestable, following, correction, head.printhead, gains,
            offsets, joint.base.head.printhead, dynamics(stands), tuple(self.notes),
            time.perf_counter() - self.started, self.stages,
        )  # fmt: skip
