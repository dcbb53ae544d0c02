"""From a campaign to a diagnosis: noise, base model, where they differ, which physics was left out."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inkjet_env.identification import identify
from inkjet_env.identification.convention import conventional_swing
from inkjet_env.identification.identification import Estimate
from inkjet_env.mismatch.attribute import Hypothesis, base_hypothesis, settled
from inkjet_env.mismatch.chance import ByChance, by_chance, without
from inkjet_env.mismatch.crew import Crew
from inkjet_env.mismatch.diagnosis import Attribution, Correction, Diagnosis, Named, Trace
from inkjet_env.mismatch.dynamics import QUANTILE_90, dynamics
from inkjet_env.mismatch.flexible import Flexible, flexible_residual
from inkjet_env.mismatch.headline import headline
from inkjet_env.mismatch.joint_fit import Head, JointFit
from inkjet_env.mismatch.locate import locate
from inkjet_env.mismatch.next_experiment import next_experiment
from inkjet_env.mismatch.observed import Noise, Observed, finer, noise_seen, observe
from inkjet_env.mismatch.select import Selection, cosine, leftover, select, supported
from inkjet_env.mismatch.signatures import Signatures, signatures
from inkjet_env.plant import Effect, catalogue
from inkjet_env.plant.effect import coordinates
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign

Real = NDArray[np.float64]

DEGREE = 9
"""Of the branch law at least: what the base model could say, it shall say, before anything else is blamed."""
LEFT_OVER = 0.05
"""Share of the mismatch from which on what is left unexplained makes a verdict unknown."""
SURE = 5.0
"""Standard deviations by which what is left must exceed the noise to count."""
LEAST_EXCESS = 0.03
"""Of the noise's power: less is taken for its own uncertainty."""
FAR_OFF = 0.7
"""Of the fast recordings' power: a base model that leaves more was begun too far off to be refitted."""
FINE_ENOUGH = 0.5
"""Standard errors of a parameter by which the simulation may be wrong."""
MOST_PARTS = 16
NODES_A_PERIOD = 36
"""At least, of the resonance."""
MOST_BASE_ROUNDS = 10
"""Times that the base model is fitted again from where it has come to."""
MOST_COMPARED = 24
"""Hypotheses that a diagnosis lists."""
SAME_GAIN = 0.02
"""Two effects by chance of which one gains so little more than the other are not told apart."""


def diagnose(
    campaign: Campaign,
    printhead: Printhead | None = None,
    effects: Sequence[Effect] | None = None,
    rng: np.random.Generator | int = 0,
    *,
    held_out: Sequence[str] | None = None,
    workers: int = 2,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Tell where recordings and the base model differ, and which physics was left out.

    Parameters
    ----------
    campaign : Campaign
    printhead : Printhead, optional
        Where the base model's fit begins; identified from the campaign unless given. It is refitted either way.
    effects : sequence of Effect, optional
        What may have been left out; the catalogue unless given. An effect of your own is one class.
    rng : Generator or int
        Draws the noise that scores are judged against.
    held_out : sequence of str, optional
        Recordings that no fit and no choice sees; see `identification.measurements`.
    workers : int
        Processes.
    progress : callable, optional
        Told what is being done, in words.

    Raises
    ------
    ValueError
        Recordings that no base model can be identified from.
    """
    catalogued = catalogue() if effects is None else tuple(effects)
    twice = [name for name, count in Counter(effect.id for effect in catalogued).items() if count > 1]
    if twice:
        raise ValueError(f"effects must have ids of their own; {twice[0]!r} comes twice. Rename one.")
    work = _Work(
        campaign,
        catalogued,
        np.random.default_rng(rng),
        Crew(workers),
        progress or (lambda _: None),
    )
    return work.diagnosis(printhead, held_out)


class _Work:
    """The steps of one diagnosis."""

    def __init__(
        self,
        campaign: Campaign,
        effects: Sequence[Effect],
        rng: np.random.Generator,
        crew: Crew,
        progress: Callable[[str], None],
    ) -> None:
        self.campaign, self.rng, self.crew, self.progress = campaign, rng, crew, progress
        self.started = self.last = time.perf_counter()
        self.stages: dict[str, float] = {}
        self.notes: list[str] = []
        self.effects = tuple(effects)
        self.rivals: dict[str, tuple[str, ...]] = {}

    def took(self, stage: str) -> None:
        """Book the time since the last call."""
        now = time.perf_counter()
        self.stages[stage] = self.stages.get(stage, 0.0) + now - self.last
        self.last = now

    def diagnosis(self, printhead: Printhead | None, held_out: Sequence[str] | None) -> Diagnosis:
        """All steps in order."""
        observed = observe(self.campaign, held_out)
        shots = [o.shot for o in observed if o.channel != "drive_monitor"]
        untestable = {e.id: reason for e in self.effects if (reason := e.untestable(shots)) is not None}
        testable = [e for e in self.effects if e.id not in untestable]
        by_accident = [e for e in testable if type(e).nuisances is not Effect.nuisances]
        lawful = [e for e in testable if e not in by_accident]
        self.progress("the base model")
        joint = self.base(observed, printhead, held_out)
        self.took("base model")
        standing: list[ByChance] = []
        if by_accident:
            self.progress("what differs from recording to recording")
            resting = [o for o in observed if o.still]
            joint, standing = self.with_chance(joint, by_accident, resting, standing)
            self.took("chance")
        found, selection = self.selected(joint, lawful)
        if by_accident and not leftover(selection.chosen, found, self.rng):
            exact, chosen = self.polished(joint, selection.chosen, standing)
            again, more = self.with_chance(exact, by_accident, observed, standing, chosen)
            self.took("chance")
            if more is not standing:
                joint, standing = again, more
                found, selection = self.selected(joint, lawful)
        joint, chosen = self.polished(joint, selection.chosen, standing)
        if chosen.ids and self.quieter(joint, selection.chosen.joint):
            # With what was found the noise is seen to be less: is there more to be found?
            found, selection = self.selected(joint, lawful)
            joint, chosen = self.polished(joint, selection.chosen, standing)
        if chosen.ids and not supported(base_hypothesis(joint), chosen):
            chosen = base_hypothesis(joint)  # finer nodes, or another noise, made it vanish
        self.took("selection")
        self.progress("what is left over")
        flexible = flexible_residual(chosen)
        self.took("flexible model")
        return self.verdict(joint, chosen, selection, standing, flexible, untestable)

    def base(
        self, observed: Sequence[Observed], printhead: Printhead | None, held_out: Sequence[str] | None
    ) -> JointFit:
        """The base model and the noise."""
        given = printhead is not None
        if printhead is None:
            found = identify(self.campaign, held_out=held_out, progress=self.progress)
            gains = {channel: gain.value for channel, gain in found.gains.items()}
            offsets, printhead, otherwise = dict(found.offsets), found.printhead, dict(found.noise)
        else:
            gains, offsets = _gains_and_offsets(observed, printhead)
            otherwise = {}
        channels = {o.channel for o in observed}
        for channel in channels - set(offsets):
            offsets[channel] = 0.0
            if channel != "drive_monitor":
                gains[channel] = 1.0
        coefficients = (0.0,) * max(0, DEGREE + 1 - len(printhead.coefficients)) + printhead.coefficients
        head = Head(replace(printhead, coefficients=coefficients), gains, offsets)
        coarsest_s = max((o.shot.step_s for o in observed if o.shot.fast), default=0.0)
        parts = 2 * max(1, min(MOST_PARTS // 2, math.ceil(NODES_A_PERIOD * printhead.frequency_Hz * coarsest_s / 2)))
        observed = finer(observed, parts)
        joint = self.settled(observed, head, Noise({}, {}), otherwise, ())
        if given and _unexplained(joint) > FAR_OFF:
            raise ValueError(
                f"the printhead that was given, of {with_prefix(printhead.frequency_Hz, 'Hz', 3)}, explains next to "
                "nothing of these recordings, even refitted. Give one of this head, or none: it is then identified."
            )
        self.notes.extend(joint.noise.notes)
        if not any(o.fitted < o.shot.samples for o in observed):
            self.notes.append("No recording is held out, so nothing was checked on recordings that no fit has seen.")
        return joint

    def settled(
        self,
        observed: Sequence[Observed],
        head: Head,
        noise: Noise,
        otherwise: dict,
        standing: Sequence[ByChance],
    ) -> JointFit:
        """A joint fit whose noise is that of its own base model's residuals, its law scaled as by convention."""
        signals = {o.name: head.plant().signal(o.shot) for o in observed}
        left = {o.name: o.measured - signals[o.name] for o in observed}
        noise = noise_seen(observed, self.less_chance(observed, left, standing), otherwise)
        on = [(s.effect, s.values) for s in standing]
        joint = JointFit(observed, noise, head, on)
        for _ in range(MOST_BASE_ROUNDS):
            before = joint.base.nll
            joint = JointFit(observed, noise, in_convention(joint.base.head), on)
            if before - joint.base.nll < 0.5:
                break
        modelled = joint.modelled(joint.base)
        left = {o.name: o.measured - modelled[o.name] for o in observed}
        noise = noise_seen(observed, self.less_chance(observed, left, standing), otherwise)
        return JointFit(observed, noise, joint.base.head, on)

    @staticmethod
    def less_chance(
        observed: Sequence[Observed], left: dict[str, Real], standing: Sequence[ByChance]
    ) -> dict[str, Real]:
        """Residuals with what the standing effects can explain taken out."""
        for one in standing:
            left = without(one.effect, one.values, observed, left)
        return left

    def with_chance(
        self,
        joint: JointFit,
        effects: Sequence[Effect],
        chosen: Sequence[Observed],
        standing: list[ByChance],
        beside: Hypothesis | None = None,
    ) -> tuple[JointFit, list[ByChance]]:
        """The joint fit with whatever effects by chance these recordings show; the same where they show none more."""
        for _ in range(2):
            fit = joint.base if beside is None else beside.fit
            modelled = joint.modelled(fit)
            left = {o.name: o.measured - modelled[o.name] for o in joint.observed}
            here = [e for e in effects if e.id not in {s.effect.id for s in standing}]
            found = by_chance(chosen, left, joint.noise, here) if chosen else []
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
            self.rivals[best.effect.id] = rivals
            standing = [*standing, best]
            noise = noise_seen(
                joint.observed, self.less_chance(joint.observed, left, standing), dict(joint.noise.models)
            )
            joint = JointFit(joint.observed, noise, joint.start, [(s.effect, s.values) for s in standing])
        return joint, standing

    def selected(self, joint: JointFit, effects: Sequence[Effect]) -> tuple[Signatures, Selection]:
        """Signatures and selection on one noise."""
        found = signatures(joint, effects, self.crew, self.progress)
        self.took("signatures")
        selection = select(joint, effects, found, self.crew, self.rng, self.progress)
        self.took("selection")
        return found, selection

    def polished(
        self, joint: JointFit, chosen: Hypothesis, standing: Sequence[ByChance]
    ) -> tuple[JointFit, Hypothesis]:
        """The chosen hypothesis fitted again: its own noise, its law scaled as by convention, on nodes fine enough."""
        if not chosen.ids:
            return joint, chosen
        while True:
            modelled = joint.modelled(chosen.fit)
            left = {o.name: o.measured - modelled[o.name] for o in joint.observed}
            left = self.less_chance(joint.observed, left, standing)
            noise = noise_seen(joint.observed, left, {})
            base = in_convention(joint.base.head)
            joint = JointFit(joint.observed, noise, base, joint.standing)
            near = joint.near(replace(chosen.fit, head=in_convention(chosen.fit.head)))
            chosen = settled(joint, near.fit(chosen.fit.effects, chosen.fit.point))
            parts = joint.observed[0].shot.parts
            error = joint.numerical_error(chosen.fit)
            if error < FINE_ENOUGH or parts >= MOST_PARTS:
                break
            joint = JointFit(finer(joint.observed, 2 * parts), noise, base, joint.standing)
        if error >= FINE_ENOUGH:
            self.notes.append(
                f"The simulation's own error is {error:.2g} standard errors of a parameter at {parts} nodes a sample."
            )
        return joint, chosen

    @staticmethod
    def quieter(new: JointFit, old: JointFit) -> bool:
        """Whether the noise of any channel turned out much less."""
        return any(
            new.noise.models[key].rms < 0.7 * old.noise.models[key].rms
            for key in {o.noise_key for o in new.observed if new.noise.known(o)}
        )

    def verdict(
        self,
        joint: JointFit,
        chosen: Hypothesis,
        selection: Selection,
        standing: Sequence[ByChance],
        flexible: Flexible,
        untestable: dict[str, str],
    ) -> Diagnosis:
        """Put everything together."""
        base = base_hypothesis(joint)
        # the base model has no effects by chance either
        bare = JointFit(joint.observed, joint.noise, joint.base.head) if standing else joint
        traces = _traces(bare, joint, chosen, flexible)
        closure = _closure(traces)
        share = _share_left(base, chosen, flexible)
        groups = [(name, *others) for name, others in selection.alternatives.items() if others and name in chosen.ids]
        groups += [(s.effect.id, *self.rivals[s.effect.id]) for s in standing if self.rivals.get(s.effect.id)]
        anything = bool(chosen.ids or standing)
        if share > LEFT_OVER:
            verdict = "unknown"
        elif not anything:
            verdict = "none"
        else:
            verdict = "set" if groups else "named"
        self.progress("where it is")
        location = locate(bare.observed, bare.noise, bare.base, bare.basis[0])
        self.took("location")
        units = {o.channel: o.unit for o in joint.observed}
        named = [
            *(
                Named(
                    s.effect, s.effect.told(s.values, units[s.channel]), s.gain, math.exp(-s.gain),
                    _as_estimates(s.values), units[s.channel],
                )
                for s in standing
            ),
            *self.named(joint, chosen, selection),
        ]  # fmt: skip
        if verdict == "unknown":
            groups = []
        compared = _compared(base, chosen, selection)
        correction = None
        if verdict == "unknown":
            correction = Correction(flexible.share, flexible.foretold, flexible.error, flexible.modelled)
        fits = [chosen.fit]
        for group in groups:
            ids = set(chosen.ids)
            for other in group[1:]:
                wanted = (ids - {group[0]}) | {other}
                fits.extend(h.fit for h in selection.compared if set(h.ids) == wanted)
        self.progress("the next experiment")
        following = next_experiment(fits, joint.noise, joint.observed) if verdict == "set" else None
        self.took("next experiment")
        head = chosen.fit.head
        told = all(joint.noise.known(o) for o in joint.seen)
        said = headline(verdict, named, groups, closure, share, _closest(base, selection), location, told)
        return Diagnosis(
            self.campaign.name, verdict, said, tuple(named) if verdict != "unknown" else (), tuple(groups),
            location, traces, closure, share, compared, untestable, following, correction, head.printhead, head.gains,
            {c: o for c, o in head.offsets.items() if c != "drive_monitor"}, joint.base.head.printhead,
            dynamics(base if verdict == "unknown" else chosen), tuple(self.notes),
            time.perf_counter() - self.started, self.stages,
        )  # fmt: skip

    def named(self, joint: JointFit, chosen: Hypothesis, selection: Selection) -> list[Named]:
        """The chosen effects with intervals and evidence."""
        errors = _errors(chosen)
        lower, upper = joint.limits(chosen.fit.effects)
        result, at = [], 0
        for effect, values in chosen.fit.with_values:
            count = len(effect.parameters)
            rest = [(e, v) for e, v in chosen.fit.with_values if e is not effect]
            smaller = base_hypothesis(joint)
            if rest:
                point = np.concatenate([coordinates(e, v) for e, v in rest])
                smaller = Hypothesis(joint.fit([e for e, _ in rest], point, chosen.fit.head), joint)
            estimates = {}
            for k, p in enumerate(effect.parameters, start=at):
                reach = QUANTILE_90 * errors[k]
                ends = [p.value(float(np.clip(chosen.fit.point[k] + s * reach, lower[k], upper[k]))) for s in (-1, 1)]
                estimates[p.name] = Estimate(values[p.name], min(ends), max(ends))
            gain = smaller.fit.nll - chosen.fit.nll
            p_value = selection.p_values.get(effect.id, math.exp(-gain))
            unit = _signal_unit(joint)
            sentence = effect.told(_surely(effect, values, estimates), unit)
            result.append(Named(effect, sentence, gain, p_value, estimates, unit))
            at += count
        return result


def in_convention(head: Head) -> Head:
    """The same head with its law's swing as by convention, gains and ``b1`` to match."""
    law = head.printhead
    factor = conventional_swing(law.full_scale_V) / float(law.branch_law.Q(1.0))
    if not (math.isfinite(factor) and factor > 0):
        return head
    scaled = replace(law, coefficients=tuple(factor * c for c in law.coefficients), b1=law.b1 / factor)
    return Head(scaled, {c: g / factor for c, g in head.gains.items()}, head.offsets)


def _gains_and_offsets(observed: Sequence[Observed], printhead: Printhead) -> tuple[dict[str, float], dict[str, float]]:
    """Of each channel, by least squares with a given head; that of self-sensing is its own."""
    gains, offsets = {}, {}
    head = Head(printhead, {"self_sensing": printhead.b1}, {})
    for channel in sorted({o.channel for o in observed} - {"drive_monitor"}):
        mine = [o for o in observed if o.channel == channel]
        shape = np.concatenate([head.plant().motion(o.shot.drive_at_nodes_V, o.shot)[: o.fitted] for o in mine])
        measured = np.concatenate([o.measured[: o.fitted] for o in mine])
        if channel == "self_sensing":
            gains[channel] = printhead.b1
            offsets[channel] = float(np.mean(measured - printhead.b1 * shape))
        else:
            size = max(float(np.abs(shape).max()), 1e-300)
            found = np.linalg.lstsq(np.column_stack([shape / size, np.ones(shape.size)]), measured, rcond=None)[0]
            gains[channel], offsets[channel] = float(found[0]) / size, float(found[1])
    return gains, offsets


def _traces(bare: JointFit, joint: JointFit, chosen: Hypothesis, flexible: Flexible) -> tuple[Trace, ...]:
    # Where nothing tells the noise, it is at most what the flexible model leaves of what is left.
    most = math.sqrt(1 - min(max(flexible.share, 0.0), 1.0))
    base, augmented = bare.modelled(bare.base), joint.modelled(chosen.fit)
    return tuple(
        Trace(
            o.name,
            o.channel,
            o.unit,
            o.shot.order,
            o.shot.step_s,
            o.shot.drive_V,
            o.measured,
            base[o.name],
            augmented[o.name],
            o.fitted,
            joint.noise.models[o.noise_key].rms * (1.0 if joint.noise.known(o) else most),
        )
        for o in joint.observed
        if o.channel != "drive_monitor"
    )


def _closure(traces: Sequence[Trace]) -> float:
    """Over held-out recordings of all channels, each in units of its noise."""
    before = after = samples = 0.0
    for t in traces:
        rows = t.measured.size - t.fitted
        if rows and t.noise_rms > 0:
            before += rows * (t.rms("base", True) / t.noise_rms) ** 2
            after += rows * (t.rms("augmented", True) / t.noise_rms) ** 2
            samples += rows
    if not samples or before - samples < LEAST_EXCESS * samples + SURE * math.sqrt(2 * samples):
        return math.nan
    return (before - after) / (before - samples)


def _share_left(base: Hypothesis, chosen: Hypothesis, flexible: Flexible) -> float:
    """Share of the base model's mismatch that is left beyond noise; 0 where it is not surely there."""
    known = {o.name for o in base.joint.seen if base.joint.noise.known(o)}
    if known:
        keep = np.concatenate([np.full(o.fitted, o.name in known) for o in base.joint.seen])
        rows = int(keep.sum())
        told = sum(base.joint.noise.samples[key] for key in {o.noise_key for o in base.joint.seen if o.name in known})
        doubt = math.sqrt(2 * rows + 2 * rows**2 / max(told, 1))
        left = float(np.sum(chosen.left[keep] ** 2)) - rows + chosen.columns.shape[1]
        mismatch = float(np.sum(base.left[keep] ** 2)) - rows + base.columns.shape[1]
        sure = left > SURE * doubt and left > LEAST_EXCESS * rows
    else:
        # What is left was taken for noise: only what a flexible model foretells of it is surely not.
        left = flexible.share * float(np.sum(chosen.left**2))
        mismatch = float(np.sum(base.left**2))
        sure = flexible.foretold > 8 + 2 * flexible.error
    return left / max(mismatch, left) if sure else 0.0


def _compared(base: Hypothesis, chosen: Hypothesis, selection: Selection) -> tuple[Attribution, ...]:
    rows = []
    most = max((h.gain for h in selection.compared), default=0.0)
    best = selection.chosen
    for h in selection.compared[:MOST_COMPARED]:
        start = base_hypothesis(h.joint)
        gains, errors = start.foretold.gains_of(h.foretold)
        rows.append(
            Attribution(
                h.ids,
                h.gain,
                float(gains.sum()),
                float(np.sqrt(np.sum(errors**2))),
                h.gain / most if most > 0 else 0.0,
                cosine(start, best, h) if best.ids else math.nan,
                " ".join(e.told(v, _signal_unit(h.joint)) for e, v in h.fit.with_values),
            )
        )
    return tuple(rows)


def _closest(base: Hypothesis, selection: Selection) -> tuple[tuple[str, ...], float] | None:
    """The hypothesis that explains most of the fitted recordings' mismatch, and how much of it."""
    best = max(selection.compared, key=lambda h: h.gain, default=None)
    if best is None or best.gain <= 0:
        return None
    known = all(base.joint.noise.known(o) for o in base.joint.seen)
    start = base_hypothesis(best.joint)
    mismatch = 0.5 * start.excess if known else start.fit.nll
    return best.ids, min(best.gain / max(mismatch, best.gain), 1.0)


def _errors(chosen: Hypothesis) -> Real:
    """Standard errors of the point, shape (k,), widened where more than noise is left."""
    q, _ = chosen.joint.basis
    slopes = chosen.fit.slopes - q @ (q.T @ chosen.fit.slopes)
    size = np.linalg.norm(slopes, axis=0)
    told = size > 1e-9 * np.maximum(np.linalg.norm(chosen.fit.slopes, axis=0), 1e-300)
    errors: Real = np.full(size.size, np.inf)
    columns = slopes[:, told] / size[told]
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-12)
    loud = max(1.0, 2 * chosen.fit.nll / max(chosen.left.size - chosen.columns.shape[1], 1))
    errors[told] = np.sqrt(np.maximum(np.diag(inverse), 0) * loud) / size[told]
    return errors


def _surely(effect: Effect, values: dict[str, float], estimates: dict[str, Estimate]) -> dict[str, float]:
    """The values, less the strengths that may as well be nothing; all of them where all may be."""
    vain = {name for name in effect.strengths if estimates[name].low <= 0 <= estimates[name].high}
    if vain == set(effect.strengths):
        return values
    return {name: 0.0 if name in vain else value for name, value in values.items()}


def _unexplained(joint: JointFit) -> float:
    """Share of the fast channels' mean square under a drive that the base model leaves."""
    moved = [o for o in joint.seen if o.shot.fast and not o.still]
    modelled = joint.modelled(joint.base)
    left = sum(float(np.var(o.measured - modelled[o.name])) / max(float(np.var(o.measured)), 1e-300) for o in moved)
    return left / max(len(moved), 1)


def _signal_unit(joint: JointFit) -> str:
    """Of a fast sensor's signal, where there is one."""
    return next((o.unit for o in joint.observed if o.shot.fast), joint.observed[0].unit)


def _as_estimates(values: dict[str, float]) -> dict[str, Estimate]:
    return {name: Estimate(value, value, value) for name, value in values.items()}
