"""The recordings that would separate the candidates that a campaign cannot distinguish.

They are those from which most is expected to be learned about which candidate holds, see `information`; the distances
between the rivals' predictions are those of T-optimal designs (Atkinson & Fedorov, Biometrika 62, 1975). The rivals may
adapt: before two predictions are compared, base and effect parameters move towards the rival as far as the campaign's
information on them allows.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.design.drive_library import benches, library, probe_library
from inkjet_env.mismatch.design.information import Hypotheses
from inkjet_env.mismatch.design.predictions import Judged, Predictions
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.fit_result import FitResult
from inkjet_env.mismatch.localization.views import CHANNELS
from inkjet_env.mismatch.settings import DesignSettings
from inkjet_env.plant import Effect
from inkjet_env.plant.wording import with_prefix
from inkjet_env.typing import Real


@dataclass(frozen=True)
class NextExperiment:
    """A recording that would separate remaining candidates.

    Attributes
    ----------
    sentence : str
        What to record, and what it would show, in words.
    channel : str
        Channel to record; empty, as all below, if no drive can be computed.
    initial_state : str
        Initial state: "periodic" or "demagnetised".
    step_s : float
        Sampling step.
    drive_V : tuple of float
        Drive at each sample.
    separation : float
        Expected difference of log-likelihoods between the two candidates of the sentence.
    information_bits : float
        Expected information about which candidate holds, together with the recordings that are asked for before it.
    repeats : int
        Number of recordings to take of it.
    drive_monitor : bool
        Whether the voltage at the head must be recorded beside the sensor.
    neighbour_V : tuple of float
        Drive of the neighbouring channel at each sample; empty if it stays at 0 V.
    """

    sentence: str
    channel: str = ""
    initial_state: str = ""
    step_s: float = 0.0
    drive_V: tuple[float, ...] = ()
    separation: float = 0.0
    information_bits: float = 0.0
    repeats: int = 1
    drive_monitor: bool = False
    neighbour_V: tuple[float, ...] = ()

    def as_json(self, drive_csv: str | None) -> dict[str, Any]:
        """The experiment within a ``diagnosis/1``; ``drive_csv`` names the file of its drive."""
        known = bool(self.drive_V)
        return {
            "sentence": self.sentence,
            "drive_csv": drive_csv,
            "channel": self.channel if known else None,
            "initial_state": self.initial_state if known else None,
            "step_s": self.step_s if known else None,
            "repeats": self.repeats if known else None,
            "drive_monitor": self.drive_monitor if known else None,
            "information_bits": self.information_bits if known else None,
        }


def next_experiments(
    fits: Sequence[FitResult],
    noise: Noise,
    observed: Sequence[ObservedRecording],
    effects: Sequence[Effect],
    settings: DesignSettings,
    none: float = 0.0,
) -> tuple[NextExperiment, ...]:
    """The recordings that together best separate the candidates that explain a campaign equally well.

    Parameters
    ----------
    fits : sequence of FitResult
        Two or more candidates. For a single one, the answer says in words what shows its effects best; without any
        effect, it says which effects the campaign cannot show and what would show them.
    noise : Noise
        Noise of the channels, expected in the next recordings too.
    observed : sequence of ObservedRecording
        The campaign's recordings.
    effects : sequence of Effect
        Effects that the diagnosis looked for.
    settings : DesignSettings
        Settings of the design.
    none : float
        Probability that none of the candidates holds.

    Returns
    -------
    tuple of NextExperiment
        As few as suffice, the most informative first, at most `DesignSettings.most_requests`; empty if there is nothing
        to propose.
    """
    candidates = [effect for fit in fits for effect in fit.active.effects]
    if len(fits) < 2:
        return _in_words(candidates, effects, observed)
    predictions = Predictions(fits, noise, observed, settings)
    hypotheses = Hypotheses(len(fits), none, predictions.pairs)
    sensors = [o for o in observed if o.channel != "drive_monitor"]
    available = benches(sensors, fits[0].head.printhead.frequency_Hz, settings)
    tried = [
        judged
        for bench in available
        for proposal in library(bench)
        if (judged := predictions.judged(proposal)) is not None
    ]
    fast = [bench for bench in available if bench.channel != "strain_gauge" and not bench.quasi_static]
    fine = [
        judged
        for bench in fast[:1]
        for proposal in probe_library(bench)
        if (judged := predictions.unjudged(proposal)) is not None
    ]
    edges, probed = predictions.with_probe(fine), predictions.with_probe(tried)
    if len(sensors) < len(observed):  # whatever is recorded has the voltage at the head too
        choices = [edges, probed, [*probed, *edges]]
    elif predictions.of_the_drive.any():
        choices = [edges, [*probed, *edges], [*tried, *probed, *edges]]
    else:
        choices = [tried, [*tried, *probed, *edges]]
    plan: list[Judged] = []
    for choice in choices:  # the first of those that separate most pairs
        found = _plan(choice, settings, hypotheses)
        if len(found) > 1:  # a better pulse may do alone
            found = _plan([*choice, _optimised(found[0], predictions, hypotheses)], settings, hypotheses)
        found = _no_longer_than_needed(found, settings)
        if _separable(found, settings).sum() > _separable(plan, settings).sum():
            plan = found
        if _least(plan) >= settings.separation:
            break
    return _told(plan, predictions, hypotheses) if plan else _in_words(candidates, effects, observed)


def _total(plan: Sequence[Judged]) -> Real:
    """Expected differences of log-likelihoods between the candidates of each pair, shape (pairs,)."""
    total: Real = np.sum([judged.separations for judged in plan], axis=0)
    return total


def _least(plan: Sequence[Judged]) -> float:
    """Expected difference of log-likelihoods between the two candidates that a plan separates worst."""
    return float(_total(plan).min()) if plan else 0.0


def _separable(plan: Sequence[Judged], settings: DesignSettings) -> NDArray[np.bool_]:
    """Which pairs of candidates a plan separates within the largest number of recordings, shape (pairs,)."""
    if not plan:
        return np.zeros(1, dtype=bool)
    separable: NDArray[np.bool_] = _total(plan) * (settings.most_recordings // len(plan)) >= settings.separation
    return separable


def _times(plan: Sequence[Judged], settings: DesignSettings) -> int:
    """How often a plan has to be carried out until it separates every pair that it can; 0 if it can separate none."""
    separable = _separable(plan, settings)
    if not separable.any():
        return 0
    return max(1, math.ceil(settings.separation / float(_total(plan)[separable].min())))


def _no_longer_than_needed(plan: list[Judged], settings: DesignSettings) -> list[Judged]:
    """The beginning of a plan that separates as many pairs with the fewest recordings; empty if it separates none."""

    def worth(count: int) -> tuple[int, int]:
        some = plan[:count]
        return -int(_separable(some, settings).sum()), count * _times(some, settings)

    best = min(range(1, len(plan) + 1), key=worth, default=0)
    return plan[:best] if _times(plan[:best], settings) else []


def _plan(tried: Sequence[Judged], settings: DesignSettings, hypotheses: Hypotheses) -> list[Judged]:
    """Proposals, each chosen for what it adds to those before it, until they separate all candidates; repeats count."""
    plan: list[Judged] = []
    while tried and len(plan) < settings.most_requests and _least(plan) < settings.separation:
        plan.append(min(tried, key=lambda judged: hypotheses.ln_left([*plan, judged])))
    return plan


def _optimised(best: Judged, predictions: Predictions, hypotheses: Hypotheses) -> Judged:
    """A proposal with height, edges, dwell and gap of its pulses optimised; unchanged if it has no pulses."""
    from scipy.optimize import minimize

    train, excitation = best.proposal.train, best.proposal.excitation
    if train is None or not any(best.differences):
        return best  # what is sampled for a probe alone stays as it is
    settings = predictions.settings
    available = benches(predictions.observed, predictions.fits[0].head.printhead.frequency_Hz, settings)
    bench = next(b for b in available if b.channel == excitation.channel)
    periods = excitation.samples * excitation.step_s / bench.period_s
    found, least = best, hypotheses.ln_left([best])

    def loss(theta: Real) -> float:
        nonlocal found, least
        height, *times = (float(factor) for factor in np.exp(theta))
        proposal = bench.changed(train, periods, height, times)
        judged = predictions.judged(proposal) if proposal is not None else None
        if judged is not None and best.at_head:
            judged = next(iter(predictions.with_probe([judged])), None)
        if judged is None:
            return math.inf
        left = hypotheses.ln_left([judged])
        if left < least:
            found, least = judged, left
        return left

    size = 4 if train.gap_s else 3
    simplex = np.vstack([np.zeros(size), settings.refining_step * np.diag([-1.0, *np.ones(size - 1)])])
    options = {"maxfev": settings.refining_evaluations, "initial_simplex": simplex}
    minimize(loss, np.zeros(size), method="Nelder-Mead", options=options)
    return found


def _told(plan: list[Judged], predictions: Predictions, hypotheses: Hypotheses) -> tuple[NextExperiment, ...]:
    """A plan in words: each recording once, with its repeats."""
    times = Counter(map(id, plan))
    once = list({id(judged): judged for judged in plan}.values())
    factor, total = _times(plan, predictions.settings), _total(plan)
    separable = _separable(plan, predictions.settings)
    hardest = np.where(separable, total, math.inf)
    found, before = [], list[Judged]()
    for judged in once:
        repeats = factor * times[id(judged)]
        if judged.at_head and not predictions.probe_known(judged.proposal.excitation):
            repeats = max(repeats, predictions.settings.repeats_for_noise)
        before.extend([judged] * repeats)
        # What it is for: the pair of which it separates most of what the whole plan does; alone, the hardest one.
        shares = np.where(separable, judged.separations / np.maximum(total, 1e-300), 0.0)
        pair = int(np.argmax(shares)) if len(once) > 1 else int(np.argmin(hardest))
        found.append(_proposed(judged, pair, repeats, hypotheses.information_bits(before), predictions))
    return tuple(found)


def _proposed(
    judged: Judged, pair: int, repeats: int, information_bits: float, predictions: Predictions
) -> NextExperiment:
    """A proposal in words, with the difference between two candidates."""
    excitation = judged.proposal.excitation
    i, j = predictions.pairs[pair]
    o = predictions.recording(excitation)
    model = predictions.noise.models.get(o.noise_key)
    unit, noise, difference, place = o.unit, model.rms if model else math.inf, judged.differences[pair], ""
    start = f"Record {CHANNELS[excitation.channel]}"
    if judged.at_head:
        start = "Record the voltage at the head as well (column drive_monitor_V)"
        place, there = "in the sensor's signal ", judged.at_head[pair]
        if there / predictions.probe_noise_V > difference / noise:
            unit, noise, difference, place = "V", predictions.probe_noise_V, there, "there "
    names = f"{_named(predictions.fits[i])} and {_named(predictions.fits[j])}"
    size = f"{with_prefix(difference, unit)}, {float(f'{difference / noise:.2g}'):g} times the noise"
    state = "once the repeated drive has settled" if excitation.periodic else "from the demagnetised state"
    how = f"{state}, sampled every {with_prefix(excitation.step_s, 's', 3)}"
    said = f"{start} {judged.proposal.words}, {how}: the predictions for {names} differ {place}by up to {size}"
    if repeats > 1:
        said += f"; record it {repeats} times"
    neighbour_V = excitation.neighbour_V
    return NextExperiment(
        said + ".", excitation.channel, excitation.initial_state, excitation.step_s,
        tuple(float(v) for v in excitation.drive_V),
        float(judged.separations[pair]), information_bits, repeats, bool(judged.at_head),
        () if neighbour_V is None or not neighbour_V.any() else tuple(float(v) for v in neighbour_V),
    )  # fmt: skip


def _named(fit: FitResult) -> str:
    return " with ".join(name.replace("_", " ") for name in fit.ids) or "no effect"


def _in_words(
    candidates: Sequence[Effect], effects: Sequence[Effect], observed: Sequence[ObservedRecording]
) -> tuple[NextExperiment, ...]:
    """In words, recordings that show the candidates or, without any, the effects that the campaign cannot show."""
    if candidates:
        ways = list(dict.fromkeys(effect.shown_by for effect in candidates))
        return (NextExperiment(f"To find out, record {'; and '.join(ways)}."),)
    excitations = [o.excitation for o in observed]
    unseen: dict[str, list[str]] = {}
    for effect in effects:
        if effect.untestable(excitations):
            unseen.setdefault(effect.shown_by, []).append(effect.id.replace("_", " "))
    if not unseen:
        return ()
    missing = "; ".join(f"{way}, for {' and '.join(names)}" for way, names in unseen.items())
    return (NextExperiment(f"These recordings cannot show some effects. To test for them, record {missing}."),)
