"""From a campaign to a diagnosis: noise, base model, where recordings and model differ, which effect is missing."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from inkjet_env.identification.identify import doubtful_states
from inkjet_env.identification.outcome import NO_DYNAMICS
from inkjet_env.mismatch.diagnosis import Diagnosis
from inkjet_env.mismatch.fitting.base_model import base_model
from inkjet_env.mismatch.fitting.base_parameters import in_convention
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.checkpoint import FitCheckpoint
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, finer, observe
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.fitting.rounding import without_rounding
from inkjet_env.mismatch.held_out import only_held_out_differ
from inkjet_env.mismatch.selection.amplitude_likelihood import without_amplitudes
from inkjet_env.mismatch.selection.discrepancy_regression import discrepancy_regression
from inkjet_env.mismatch.selection.held_out_refit import held_out_otherwise
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis, completed, settled
from inkjet_env.mismatch.selection.random_effect_values import RandomEffect
from inkjet_env.mismatch.selection.random_effects import detect_random_effects
from inkjet_env.mismatch.selection.score_test import Signatures, signatures
from inkjet_env.mismatch.selection.significance import stands_out
from inkjet_env.mismatch.selection.split_likelihood import at_a_frequency
from inkjet_env.mismatch.selection.stepwise import Selection, leftover, select, supported, without_idle
from inkjet_env.mismatch.selection.truncated_law import fit_truncated_law
from inkjet_env.mismatch.settings import DiagnosisSettings
from inkjet_env.mismatch.stopwatch import Stopwatch
from inkjet_env.mismatch.verdict import Findings, judge
from inkjet_env.plant import Effect, catalogue
from inkjet_env.plant.errors import NUMERICAL
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign
from inkjet_env.typing import Real


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
    settings: DiagnosisSettings | None = None,
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
        Folder for finished fits: an interrupted diagnosis resumes from it, with the same result. It stays when the
        diagnosis is complete; `clear_checkpoint` removes it once the result is kept.
    settings : DiagnosisSettings, optional
        Thresholds and limits of all steps; the defaults are those of every published result.

    Returns
    -------
    Diagnosis
        Verdict, effects with intervals, location of the mismatch, fit before and after.

    Raises
    ------
    ValueError
        No base model can be identified from the recordings (then it is an `UnidentifiableError`), the printhead belongs
        to another head, two effects share an id, or ``workers`` is less than 1.
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
        settings or DiagnosisSettings(),
    )
    work = _Work(campaign, catalogued, context)
    with threadpool_limits(1):  # matrices are small here, and the processes use the cores
        return work.diagnosis(printhead, held_out)


def clear_checkpoint(folder: str | os.PathLike[str]) -> None:
    """Remove the finished fits that a diagnosis kept in a folder, and the folder if nothing else is in it."""
    FitCheckpoint(folder).clear()


def misfit(noise: OutputErrorFit, joint: OutputErrorFit, chosen: Hypothesis) -> float:
    """Sum of squared residuals of a hypothesis over the fitted rows, whitened with the noise of another fit."""
    modelled = joint.modelled(chosen.fit)
    residuals = {o.name: o.measured - modelled[o.name] for o in joint.seen}
    return float(np.sum(noise.stacked(residuals, chosen.fit.active.pairs) ** 2))


@dataclass(frozen=True, eq=False)
class _Candidate:
    """What was found in one base model's residuals."""

    joint: OutputErrorFit
    random_effects: list[RandomEffect]
    selection: Selection
    signatures: Signatures

    def score(self, on: OutputErrorFit) -> float:
        """Log-likelihood of the fitted recordings under another fit's noise, less Schwarz's penalty."""
        chosen = self.selection.chosen
        active = chosen.fit.active.pairs
        amplitudes = [self.joint.amplitude_columns(o, active) for o in on.seen]
        free = chosen.free + sum(len(s.values) for s in self.random_effects)
        free += sum(columns.shape[1] for columns in amplitudes if columns is not None)
        return -0.5 * misfit(on, self.joint, chosen) - 0.5 * free * math.log(float(on.ends[-1]))


class _Work:
    """The steps of one diagnosis."""

    def __init__(self, campaign: Campaign, effects: Sequence[Effect], context: FitContext) -> None:
        self.campaign, self.context = campaign, context
        self.settings, self.stopwatch = context.settings, Stopwatch()
        self.notes: list[str] = []
        self.effects = tuple(effects)
        self.indistinguishable: dict[str, tuple[str, ...]] = {}
        self.last_polished: tuple[OutputErrorFit, Hypothesis, tuple[OutputErrorFit, Hypothesis]] | None = None

    def diagnosis(self, printhead: Printhead | None, held_out: Sequence[str] | None) -> Diagnosis:
        """All steps of the diagnosis in order."""
        observed = observe(self.campaign, held_out)
        self.context.progress("fitting the base model")
        joint = base_model(self.campaign, observed, printhead, held_out, self.context.progress, self.settings)
        excitations = [o.excitation for o in joint.observed if o.channel != "drive_monitor"]
        untestable = {e.id: reason for e in self.effects if (reason := e.untestable(excitations)) is not None}
        testable = [e for e in self.effects if e.id not in untestable]
        random = [e for e in testable if e.random]
        with_law = [e for e in testable if e not in random]
        fast = any(excitation.fast for excitation in excitations)
        dynamics_known = fast or (printhead is not None and printhead.has_dynamics)
        if not dynamics_known:
            self.notes.append(NO_DYNAMICS)
        self.notes.extend(joint.noise.notes)
        if not any(o.fitted < o.excitation.samples for o in observed):
            self.notes.append("No recording was held out, so nothing was validated on recordings that no fit has seen.")
        doubt = doubtful_states(self.campaign, held_out, quasi_static=not fast)
        self.stopwatch.took("base model")
        candidate = self.candidate(joint, random, with_law)
        if (other := self.with_another_law(joint, candidate)) is not None:
            self.context.progress("repeating with a branch law that is straight above a smaller swing")
            again = self.candidate(other, random, with_law)
            if again.score(joint) - 0.5 * math.log(joint.ends[-1]) > candidate.score(joint):
                candidate = again
        joint, random_effects, selection = candidate.joint, candidate.random_effects, candidate.selection
        signatures_there = candidate.signatures
        joint, chosen, selection, signatures_there = self.lasting(
            joint, selection, signatures_there, with_law, random_effects
        )
        if chosen.ids and self.quieter(joint, selection.chosen.joint):
            # With the effects found, the noise turns out smaller: is there more to be found?
            signatures_there, selection = self.selected(joint, with_law)
            joint, chosen, selection, signatures_there = self.lasting(
                joint, selection, signatures_there, with_law, random_effects
            )
        # with finer nodes or another noise an effect may no longer be supported
        if (needed := without_idle(joint, chosen, {})) is not chosen:
            joint, chosen = self.polished(joint, needed, random_effects)
        base = base_hypothesis(joint)
        if chosen.ids and not (supported(base, chosen) and stands_out(base, chosen, len(with_law))):
            chosen = base
        joint, chosen = self.polished(joint, completed(joint, chosen), random_effects)
        self.stopwatch.took("selection")
        self.context.progress("testing the residuals")
        discrepancy = discrepancy_regression(chosen)
        self.stopwatch.took("discrepancy regression")
        unseen = held_out is None and not random_effects and only_held_out_differ(joint, chosen, discrepancy)
        if unseen and (others := held_out_otherwise(joint, chosen)) is not None:
            self.context.progress("repeating with other recordings held out")
            self.notes = [
                f"At first {', '.join(others.fitted)} were held out: they show a mismatch that the other recordings do "
                "not, so they were fitted instead."
            ]
            return self.diagnosis(printhead, others.held_out)
        found = Findings(
            joint, chosen, selection, random_effects, self.indistinguishable, discrepancy, self.effects, untestable,
            doubt, signatures_there, dynamics_known,
        )  # fmt: skip
        return judge(found, self.campaign.name, self.context, self.stopwatch, list(dict.fromkeys(self.notes)))

    def candidate(self, joint: OutputErrorFit, random: Sequence[Effect], with_law: Sequence[Effect]) -> _Candidate:
        """Random effects and effects with a law, found beside one base model."""
        random_effects: list[RandomEffect] = []
        if random:
            self.context.progress("looking for random effects")
            resting = [o for o in joint.observed if o.at_rest]
            joint, random_effects = self.with_random_effects(joint, random, resting, random_effects)
            # a drift needs many recordings; those at rest must show it as well, as effects that need a drive do not
            drifts = [effect for effect in random if not at_a_frequency(effect)]
            joint, random_effects = self.with_random_effects(joint, drifts, joint.seen, random_effects, None, False)
            self.stopwatch.took("random effects")
        found, selection = self.selected(joint, with_law)
        nothing = not selection.chosen.ids
        if random:
            explained = nothing or not leftover(selection.chosen, found, self.context.rng)
            exact, chosen = self.polished(joint, selection.chosen, random_effects)
            trusted = [o for o in joint.observed if nothing or o.fitted]  # elsewhere, effects may predict badly
            again, more = self.with_random_effects(exact, random, trusted, random_effects, chosen, explained)
            self.stopwatch.took("random effects")
            if more is not random_effects:
                joint, random_effects = again, more
                found, selection = self.selected(joint, with_law)
        return _Candidate(joint, random_effects, selection, found)

    def with_another_law(self, joint: OutputErrorFit, candidate: _Candidate) -> OutputErrorFit | None:
        """The base model with a law that is straight above some swing, if that may be the true cause; else None.

        It may be if the effects found leave a bend of the law that is a good part of their misfit beyond noise, or if
        the bend alone explains about as much as they do.
        """
        chosen, settings = candidate.selection.chosen, self.settings.selection
        good_part = 0.5 * settings.further_effect_if_large * chosen.excess if chosen.noise_known else 0.0
        bent = fit_truncated_law(candidate.joint, chosen, good_part)
        if bent is None and (chosen.ids or candidate.random_effects):
            gain = candidate.score(joint) + joint.base.nll
            bent = fit_truncated_law(joint, base_hypothesis(joint), settings.law_gain * gain)
        self.stopwatch.took("base model")
        if bent is None:
            return None
        modelled = bent.modelled(bent.base)
        residuals = {o.name: o.measured - modelled[o.name] for o in joint.observed}
        noise = noise_seen(joint.observed, residuals, dict(joint.noise.models), self.settings.fitting)
        return joint.anew(noise=noise, head=bent.base.head, random_effects=())

    @staticmethod
    def without_random_effects(
        observed: Sequence[ObservedRecording], residuals: dict[str, Real], random_effects: Sequence[RandomEffect]
    ) -> dict[str, Real]:
        """Residuals without what these random effects can explain, in the channel's unit."""
        for one in random_effects:
            residuals = without_amplitudes(one.effect, one.values, observed, residuals)
        return residuals

    def with_random_effects(
        self,
        joint: OutputErrorFit,
        effects: Sequence[Effect],
        chosen: Sequence[ObservedRecording],
        random_effects: list[RandomEffect],
        beside: Hypothesis | None = None,
        explained: bool = True,
    ) -> tuple[OutputErrorFit, list[RandomEffect]]:
        """The joint fit with the random effects that these recordings show; the same if they show no further one.

        ``explained`` says whether the model ``beside`` leaves nothing else in their residuals.
        """
        for _ in range(2):
            fit = joint.base if beside is None else beside.fit
            modelled = joint.modelled(fit)
            residuals = {o.name: o.measured - modelled[o.name] for o in joint.observed}
            here = [e for e in effects if e.id not in {s.effect.id for s in random_effects}]
            if not chosen:
                break
            found = detect_random_effects(
                chosen, residuals, joint.noise, here, fit.head.printhead, self.settings, explained
            )
            if not found:
                break
            best = found[0]
            least = (1 - self.settings.selection.same_random_gain) * best.gain - 3
            self.indistinguishable[best.effect.id] = tuple(
                dict.fromkeys(
                    f.effect.id
                    for f in found[1:]
                    if f.effect.id != best.effect.id and f.channel == best.channel and f.gain > least
                )
            )
            random_effects = [*random_effects, best]
            residuals = self.without_random_effects(joint.observed, residuals, random_effects)
            noise = noise_seen(joint.observed, residuals, dict(joint.noise.models), self.settings.fitting)
            joint = joint.anew(noise=noise, random_effects=[(s.effect, s.values) for s in random_effects])
        return joint, random_effects

    def selected(self, joint: OutputErrorFit, effects: Sequence[Effect]) -> tuple[Signatures, Selection]:
        """Signatures and stepwise selection with one noise."""
        found = signatures(joint, effects, self.context)
        self.stopwatch.took("score test")
        selection = select(joint, effects, found, self.context)
        self.stopwatch.took("selection")
        return found, selection

    def lasting(
        self,
        joint: OutputErrorFit,
        selection: Selection,
        there: Signatures,
        effects: Sequence[Effect],
        random_effects: Sequence[RandomEffect],
    ) -> tuple[OutputErrorFit, Hypothesis, Selection, Signatures]:
        """The chosen hypothesis `polished`; selected again without an effect that becomes something else thereby."""
        while True:
            exact, chosen = self.polished(joint, selection.chosen, random_effects)
            if not chosen.degenerate:
                return exact, chosen, selection, there
            effects = [effect for effect in effects if effect.id not in chosen.degenerated]
            there, selection = self.selected(joint, effects)

    def polished(
        self, joint: OutputErrorFit, chosen: Hypothesis, random_effects: Sequence[RandomEffect]
    ) -> tuple[OutputErrorFit, Hypothesis]:
        """The chosen hypothesis refitted with its own noise, its law's swing set by convention, on fine enough nodes.

        If it cannot be refitted, it is returned as it was, marked as not converged.
        """
        if not chosen.ids:
            return joint, chosen
        if self.last_polished is None or self.last_polished[0] is not joint or self.last_polished[1] is not chosen:
            self.last_polished = joint, chosen, self._polished(joint, chosen, random_effects)
        return self.last_polished[2]

    def _polished(
        self, joint: OutputErrorFit, chosen: Hypothesis, random_effects: Sequence[RandomEffect]
    ) -> tuple[OutputErrorFit, Hypothesis]:
        before, settings = joint, self.settings.fitting
        coarser: tuple[OutputErrorFit, Hypothesis] | None = None
        while True:
            try:
                modelled = joint.modelled(chosen.fit)
                observed = without_rounding(joint.observed, modelled, joint.noise, settings)
                residuals = {o.name: o.measured - modelled[o.name] for o in observed}
                residuals = self.without_random_effects(observed, residuals, random_effects)
                noise = noise_seen(observed, residuals, {}, settings)
                joint = joint.anew(observed=observed, noise=noise, head=in_convention(joint.base.head))
                near = joint.near(chosen.fit.moved(head=in_convention(chosen.fit.head)))
                chosen = settled(joint, near.fit(chosen.fit.active))
            except NUMERICAL:
                return before, replace(chosen, fit=replace(chosen.fit, converged=False))
            if coarser is not None and misfit(coarser[0], joint, chosen) > misfit(coarser[0], *coarser):
                return coarser  # the recorder averages over longer than these nodes do
            began = substeps = joint.observed[0].excitation.substeps
            jumps = any(values[name] for effect, values in chosen.fit.active.pairs for name in effect.rugged)
            error = joint.numerical_error(chosen.fit, substeps)
            while settings.simulation_error <= error < math.inf and substeps < settings.most_substeps:
                substeps *= 2
                if jumps:  # how long a node averages over them matters
                    coarser = joint, chosen
                    break
                error = joint.numerical_error(chosen.fit, substeps)
            if substeps == began:
                break
            before = joint
            joint = joint.anew(observed=finer(joint.observed, substeps))
        if math.isinf(error):
            self.notes.append(f"With more than {substeps} nodes per sample, the effects found cannot be simulated.")
        elif error >= settings.simulation_error:
            self.notes.append(
                f"With {substeps} nodes per sample, the simulation's numerical error is up to {error:.2g} standard "
                "errors of a parameter."
            )
        return joint, chosen

    def quieter(self, new: OutputErrorFit, old: OutputErrorFit) -> bool:
        """Whether the noise of any channel turned out much smaller."""
        return any(
            new.noise.models[key].rms < self.settings.fitting.quieter_noise * old.noise.models[key].rms
            for key in {o.noise_key for o in new.observed if new.noise.known(o)}
        )
