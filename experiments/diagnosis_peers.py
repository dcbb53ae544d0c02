"""What else one could do about a mismatch, on the same cases: python -m experiments.diagnosis_peers.

Each peer is fitted to the recordings that the diagnosis fits, runs freely, and is judged on the recordings that the
diagnosis holds out, by the RMS of what it leaves, in standard deviations of the noise, over all channels.

base
    The base model refitted, nothing added; its branch law of the published degree, which all peers stand on. Names
    nothing.
base, as diagnosed
    The base model that the diagnosis compares its own with: its law has as many powers as the recordings seem to ask
    for, which is more where something is left out, and then foretells less well.
pysindy
    A sparse polynomial of degree 3 in deflection ``x``, scaled speed ``p = x'/ω0`` and hysteretic drive ``v``, and the
    drive's rate ``w = v'/ω0``, as a further force on the resonator (of ``v`` and ``w``, as a further signal, for a
    strain gauge); by pysindy's library and STLSQ. Every term goes through the base model's resonator before the
    regression, so that noise is never differentiated. The threshold is the sparsest that foretells recordings put
    aside, each once, no worse than the best one does, within a standard error of the logarithm. What it names is read
    from its terms:

    ======================  =================================================================================
    terms                   what they say
    ======================  =================================================================================
    1, x, p, v              base parameters: nothing
    x³, x p²                stiffness changes with amplitude: cubic_stiffness
    p³, x² p                damping changes with amplitude: quadratic_damping
    one of each of these    ferroelastic_softening
    v²                      positive and negative drives differ: asymmetric_hysteresis
    w                       late, or with a part of the rate: amplifier_bandwidth, sensor_bandwidth, trigger_delay or
                            feedthrough
    others                  nothing that the catalogue has a name for
    ======================  =================================================================================
narx
    A neural network on the base model's signal, the drive and the hysteretic drive, now and before, added to the base
    model's signal; stopped where it foretells recordings put aside best. Names nothing.
flexible
    The ridge regression by which the diagnosis tells whether anything is left. Names nothing.
diagnosis
    The model with the effects that were found, or the base model where none was.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.diagnosis_study import STRENGTHS, Case, cases, head_of, judged
from experiments.planted import effect_named, planted, record_planted
from experiments.progress import shown_progress
from experiments.tables import print_table
from inkjet_env.mismatch import Diagnosis, diagnose
from inkjet_env.mismatch.attribute import base_hypothesis
from inkjet_env.mismatch.diagnose import NODES_A_PERIOD
from inkjet_env.mismatch.flexible import flexible_residual
from inkjet_env.mismatch.head import Head
from inkjet_env.mismatch.joint_fit import JointFit
from inkjet_env.mismatch.observed import Observed, finer, noise_seen, observe
from inkjet_env.plant import Plant, Resonance, Shot
from inkjet_env.recordings import Campaign, read_campaign
from inkjet_env.storage import write_json

Real = NDArray[np.float64]

PEERS = ("base", "base, as diagnosed", "pysindy", "narx", "flexible", "diagnosis")
DEGREE = 8
"""Of the branch law that all peers stand on: the published one's."""
BY_CHANCE = ("mains_hum", "baseline_drift")
"""Differ from recording to recording: nothing foretells them."""
ASIDE_EVERY = 4
"""Of the fitted conditions of a channel, one in so many is put aside to choose by."""
THRESHOLDS = (2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 2.0)
"""Least part of a term, of the size of what is to be explained; the last leaves none."""
MOST_ROUNDS = 60
SETTLED = 1e-6
"""Change of the variables, of the largest, at which force and motion agree."""
MOST_CHANGE_V = 1e6
NEVER = 50.0
"""Logarithm of the error where a force has no steady motion."""
LAGS = (0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1, 1.5, 2, 3, 4.5)
"""In periods of the resonance; of 100 samples on a strain gauge."""
HIDDEN, MOST_EPOCHS, PATIENCE, BATCH, RATE = 32, 200, 25, 1024, 2e-3
STIFFER, LOSSIER = {"x^3", "x p^2"}, {"p^3", "x^2 p"}
LATE = ("amplifier_bandwidth", "feedthrough", "sensor_bandwidth", "trigger_delay")


def base_fit(campaign: Campaign, head: Head) -> JointFit:
    """The base model of degree `DEGREE` on a campaign, from a head that is near; noise as the diagnosis sees it."""
    law = head.printhead.branch_law
    x = np.linspace(0, 1, 1001)
    powers = x[:, None] ** np.arange(1, DEGREE + 1)
    coefficients = np.linalg.lstsq(powers, law.Q(x), rcond=None)[0]
    printhead = replace(head.printhead, coefficients=(*(float(c) for c in coefficients[::-1]), 0.0))
    head = replace(head, printhead=printhead)
    observed = observe(campaign)
    coarsest_s = max(o.shot.step_s for o in observed if o.shot.fast)
    observed = finer(observed, 2 * math.ceil(NODES_A_PERIOD * head.printhead.frequency_Hz * coarsest_s / 2))
    signals = {o.name: head.plant().signal(o.shot) for o in observed}
    first = JointFit(observed, noise_seen(observed, {o.name: o.measured - signals[o.name] for o in observed}, {}), head)
    signals = first.modelled(first.base)
    noise = noise_seen(observed, {o.name: o.measured - signals[o.name] for o in observed}, {})
    return JointFit(observed, noise, first.base.head)


def over_noise(joint: JointFit, modelled: Mapping[str, Real], chosen: Sequence[Observed] | None = None) -> float:
    """RMS of what a model leaves, whitened; of the held-out samples, or of the fitted ones of chosen recordings.

    NaN where the model has no signal.
    """
    parts = []
    for o in joint.observed if chosen is None else chosen:
        parts.append(joint.whitened(o, o.measured - modelled[o.name])[o.rows(held_out=chosen is None)])
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def put_aside(joint: JointFit, channel: str, fold: int = 1) -> tuple[list[Observed], list[Observed]]:
    """The fitted recordings of a channel: those to fit, and those to choose by, whole conditions of them."""
    mine = [o for o in joint.seen if o.channel == channel and not o.still]
    conditions = sorted({o.condition for o in mine})
    aside = set(conditions[fold::ASIDE_EVERY])
    return [o for o in mine if o.condition not in aside], [o for o in mine if o.condition in aside]


@dataclass(frozen=True, eq=False)
class SparseForce:
    """A polynomial force on the resonator of one channel.

    Attributes
    ----------
    joint : JointFit
        Whose base model it is added to.
    sizes : ndarray, shape (k,)
        What the variables are divided by.
    coefficients : ndarray, shape (terms,)
        In hysteretic volts.
    """

    joint: JointFit
    sizes: Real
    coefficients: Real

    def terms(self, variables: Real) -> Real:
        """Values of all terms, shape (n, terms)."""
        scaled = variables / self.sizes
        powers = _library(self.sizes.size - 1).transform(scaled[:, :-1])
        return np.column_stack([np.asarray(powers, dtype=np.float64), scaled[:, -1]])

    @property
    def active(self) -> tuple[str, ...]:
        """Terms that are not zero."""
        variables = list("xpv")[-(self.sizes.size - 1) :]
        names = [*_library(len(variables)).get_feature_names(variables), "w"]
        return tuple(name for name, c in zip(names, self.coefficients, strict=True) if c)

    def signal(self, o: Observed) -> Real:
        """Free run, shape (n,): motion and force found in turn until they agree; NaN where they never do."""
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
        return np.full(o.shot.samples, np.nan)


def _library(variables: int) -> Any:
    from pysindy import PolynomialLibrary

    return PolynomialLibrary(degree=3).fit(np.zeros((2, variables)))


def _fine(o: Observed) -> Shot:
    """The shot with every second node a sample."""
    shot, pairs = o.shot, o.shot.parts // 2
    drive_V = np.ascontiguousarray(shot.drive_at_nodes_V[::2])
    return replace(shot, step_s=shot.step_s / pairs, drive_V=drive_V, parts=2, kept={})


def _motion(joint: JointFit, o: Observed, force_V: Real) -> tuple[Real, Real]:
    """What the channel shows for a gain of 1, at the samples, and the variables, shape (fine samples, k)."""
    printhead = joint.base.head.printhead
    fine, pairs = _fine(o), o.shot.parts // 2
    drive_V = joint.base.head.plant().hysteretic_V(o.shot.drive_at_nodes_V, o.shot)
    omega0 = math.sqrt(printhead.a0)
    hysteretic_V = fine.sampled(drive_V)
    rate_V = np.gradient(hysteretic_V) / np.float64(fine.step_s * omega0)
    if not o.shot.fast:
        return (hysteretic_V - force_V)[::pairs], np.column_stack([hysteretic_V, rate_V])
    fine = replace(fine, start=joint.base.states.get(o.name, (0.0, 0.0)))
    resonance = Resonance(printhead.a0, printhead.a1, printhead.a0)
    pushed_V = np.ascontiguousarray(drive_V - fine.refined(force_V))
    deflection_V = resonance.motion(pushed_V, replace(fine, channel="displacement"))
    speed = resonance.motion(pushed_V, replace(fine, channel="self_sensing"))
    shown = (speed if o.channel == "self_sensing" else deflection_V)[::pairs]
    return shown, np.column_stack([deflection_V, speed * omega0, hysteretic_V, rate_V])


def sparse_force(joint: JointFit, channel: str) -> SparseForce:
    """Fitted to one channel."""
    folds = [put_aside(joint, channel, fold) for fold in range(ASIDE_EVERY)]
    everything = [*folds[0][0], *folds[0][1]]
    variables = {o.name: _motion(joint, o, np.zeros(_fine(o).samples))[1] for o in everything}
    sizes = np.max([np.abs(table).max(axis=0) for table in variables.values()], axis=0)
    none = SparseForce(joint, sizes, np.zeros(_library(sizes.size - 1).n_output_features_ + 1))
    columns = {o.name: _as_seen(joint, o, none.terms(variables[o.name])) for o in everything}
    left = {o.name: joint.base.left[o.name][: o.fitted] for o in everything}

    def fitted(chosen: Sequence[Observed], threshold: float) -> SparseForce:
        table = np.concatenate([columns[o.name] for o in chosen])
        target = np.concatenate([left[o.name] for o in chosen])
        return replace(none, coefficients=_sparse(table, target, threshold))

    def errors(force: SparseForce, aside: Sequence[Observed]) -> list[float]:
        return [over_noise(joint, {o.name: force.signal(o)}, [o]) ** 2 for o in aside]

    tried = np.log([[error for fit, aside in folds for error in errors(fitted(fit, t), aside)] for t in THRESHOLDS])
    tried[np.isnan(tried)] = NEVER
    best = tried[int(np.argmin(tried.mean(axis=1)))]
    for threshold, found in reversed(list(zip(THRESHOLDS, tried, strict=True))):
        worse = found - best
        if worse.mean() <= np.std(worse) / math.sqrt(worse.size):
            return fitted(everything, threshold)
    return none


def _as_seen(joint: JointFit, o: Observed, terms: Real) -> Real:
    """What each term adds to a recording to first order, whitened; fitted rows, shape (rows, terms)."""
    printhead, gain = joint.base.head.printhead, joint.base.head.plant().gain(o.channel)
    fine, pairs = replace(_fine(o), start=(0.0, 0.0)), o.shot.parts // 2
    resonance = Resonance(printhead.a0, printhead.a1, printhead.a0)
    added = []
    for term in terms.T:
        pushed = -np.ascontiguousarray(term)
        added.append(gain * (resonance.motion(fine.refined(pushed), fine) if o.shot.fast else pushed)[::pairs])
    return joint.whitened(o, np.column_stack(added))[: o.fitted]


def _sparse(columns: Real, target: Real, threshold: float) -> Real:
    """pysindy's thresholded least squares on columns of unit length."""
    from pysindy import STLSQ

    sizes = np.linalg.norm(columns, axis=0)
    sizes[sizes == 0] = np.inf
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that no term is left, which is an answer
        size = float(np.linalg.norm(target))
        found = STLSQ(threshold=threshold * size, alpha=1e-8).fit(columns / sizes, target[:, None])
    return np.asarray(found.coef_, dtype=np.float64)[0] / sizes


def said(terms: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """The effects that terms of a `SparseForce` stand for; where they are several, in groups that are the same to it.

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


def verdict_on(groups: Sequence[Sequence[str]], truth: Sequence[str]) -> str:
    """right, in the set, among others, wrong or nothing: of what was said, where one effect or none is there."""
    if not groups:
        return "nothing" if truth else "right"
    if not any(set(truth) & set(group) for group in groups):
        return "wrong"
    if len(groups) > 1:
        return "among others"
    return "right" if len(groups[0]) == 1 else "in the set"


def with_network(joint: JointFit, channel: str, seed: int) -> dict[str, Real]:
    """Signals of one channel with a neural network's correction."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    order = np.random.default_rng(seed)
    base = joint.modelled(joint.base)
    fit, aside = put_aside(joint, channel)
    tables = {o.name: _lagged(joint, o, base[o.name]) for o in joint.observed if o.channel == channel}
    seen = np.concatenate([tables[o.name][: o.fitted] for o in fit])
    centre, spread = seen.mean(axis=0), seen.std(axis=0)
    spread[spread == 0] = np.inf

    def rows(chosen: Sequence[Observed]) -> Any:
        left = [(o.measured - base[o.name])[: o.fitted] for o in chosen]
        inputs = np.concatenate([tables[o.name][: o.fitted] for o in chosen])
        return tensor(inputs), torch.as_tensor(np.concatenate(left)[:, None] / size, dtype=torch.float32)

    def tensor(table: Real) -> Any:
        return torch.as_tensor((table - centre) / spread, dtype=torch.float32)

    size = float(np.std(np.concatenate([o.measured - base[o.name] for o in fit])))
    inputs, target = rows(fit)
    unseen, wanted = rows(aside)
    network = torch.nn.Sequential(
        torch.nn.Linear(centre.size, HIDDEN), torch.nn.Tanh(), torch.nn.Linear(HIDDEN, HIDDEN), torch.nn.Tanh(),
        torch.nn.Linear(HIDDEN, 1),
    )  # fmt: skip
    for last in network[-1].parameters():
        torch.nn.init.zeros_(last)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
    best, kept, waited = math.inf, network.state_dict(), 0
    for _ in range(MOST_EPOCHS):
        with torch.no_grad():
            error = float(torch.mean((network(unseen) - wanted) ** 2))
        waited += 1
        if error < best:
            best, waited = error, 0
            kept = {name: value.clone() for name, value in network.state_dict().items()}
        if waited > PATIENCE:
            break
        for chosen in np.array_split(order.permutation(len(inputs)), math.ceil(len(inputs) / BATCH)):
            optimizer.zero_grad()
            torch.mean((network(inputs[chosen]) - target[chosen]) ** 2).backward()
            optimizer.step()
    network.load_state_dict(kept)
    with torch.no_grad():
        return {name: base[name] + size * network(tensor(table)).numpy()[:, 0] for name, table in tables.items()}


def _lagged(joint: JointFit, o: Observed, base: Real) -> Real:
    """Drive, hysteretic drive and the base model's signal, now and before, shape (n, k)."""
    head = joint.base.head
    period = 1 / (head.printhead.frequency_Hz * o.shot.step_s) if o.shot.fast else 100.0
    hysteretic_V = o.shot.sampled(head.plant().hysteretic_V(o.shot.drive_at_nodes_V, o.shot))
    columns = []
    for lag in dict.fromkeys(round(lag * period) for lag in LAGS):
        places = np.arange(o.shot.samples) - lag
        places = places % o.shot.samples if o.shot.periodic else np.maximum(places, 0)
        columns += [o.shot.drive_V[places], hysteretic_V[places], base[places]]
    return np.column_stack(columns)


def _base_of(found: Diagnosis, campaign: Campaign) -> Head:
    """The base model of a diagnosis, gains and offsets read from its signals."""
    plant = Plant(found.base_printhead, {"self_sensing": found.base_printhead.b1})
    shots = {o.name: o.shot for o in observe(campaign)}
    gains, offsets = {}, {}
    for channel in {trace.channel for trace in found.traces}:
        mine = [trace for trace in found.traces if trace.channel == channel]
        shown = np.concatenate([plant.motion(shots[t.name].drive_at_nodes_V, shots[t.name]) for t in mine])
        size = float(np.abs(shown).max())
        table = np.column_stack([shown / size, np.ones(shown.size)])
        gain, offset = np.linalg.lstsq(table, np.concatenate([t.base for t in mine]), rcond=None)[0]
        gains[channel], offsets[channel] = float(gain) / size, float(offset)
    return Head(found.base_printhead, gains, offsets)


def compared(campaign: Campaign, found: Diagnosis, seed: int) -> dict[str, Any]:
    """Each peer's held-out RMS over the noise, and what pysindy's terms are."""
    channels = {trace.channel for trace in found.traces}
    joint = base_fit(campaign, _base_of(found, campaign))
    sparse, network = joint.modelled(joint.base), joint.modelled(joint.base)
    terms: dict[str, tuple[str, ...]] = {}
    for channel in sorted(channels):
        if not put_aside(joint, channel)[1]:
            continue  # too few recordings to choose by: nothing is added
        force = sparse_force(joint, channel)
        terms[channel] = force.active
        sparse |= {o.name: force.signal(o) for o in joint.observed if o.channel == channel}
        network |= with_network(joint, channel, seed)
    base = base_hypothesis(joint)
    added = flexible_residual(base).modelled
    left = [(base.fit.left[o.name] - added[o.name])[o.rows(held_out=True)] for o in joint.observed]
    main = next(o for o in joint.observed if o.channel == found.main_channel)
    errors = {
        "base": over_noise(joint, joint.modelled(joint.base)),
        "base, as diagnosed": over_noise(joint, {trace.name: trace.base for trace in found.traces}),
        "pysindy": over_noise(joint, sparse),
        "narx": over_noise(joint, network),
        "flexible": float(np.sqrt(np.mean(np.concatenate(left) ** 2))),
        "diagnosis": over_noise(joint, {trace.name: trace.augmented for trace in found.traces}),
    }
    return {
        "over_noise": {peer: error if math.isfinite(error) else None for peer, error in errors.items()},
        "noise_rms": joint.noise.models[main.noise_key].rms,
        "noise_known": joint.noise.known(main),
        "unit": main.unit,
        "terms": {channel: list(names) for channel, names in terms.items()},
    }


def told_of(case: Case) -> dict[str, Any]:
    """Record a planted case, diagnose it, and let the peers try."""
    head = head_of(case.seed)
    on = [(effect_named(name), planted(effect_named(name), STRENGTHS[case.strength], head)) for name in case.effects]
    return _told(record_planted(head, on, 1000 + case.seed), case.effects, case.seed)


def told_of_folder(folder: Path) -> dict[str, Any]:
    """The same for measured recordings, of which nobody knows the truth but who built the thing."""
    return _told(read_campaign(folder), None, 0)


def _told(campaign: Campaign, truth: Sequence[str] | None, seed: int) -> dict[str, Any]:
    found = diagnose(campaign, rng=seed, workers=1)
    row = compared(campaign, found, seed)
    groups = said([term for terms in row["terms"].values() for term in terms])
    verdict = {
        "verdict": found.verdict,
        "found": [e.effect.id for e in found.effects],
        "candidates": [list(group) for group in found.candidates],
    }
    row |= {"name": campaign.name if truth is None else "+".join(truth) or "nothing", "diagnosis": verdict}
    row["said"] = [list(group) for group in groups]
    if truth is not None:
        right = {"diagnosis": judged({"effects": truth} | verdict), "pysindy": verdict_on(groups, truth)}
        row["judged"] = {peer: right.get(peer, verdict_on((), truth)) for peer in PEERS}
    return row


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Over the cases with an effect: median RMS over noise, and how often each peer said what."""
    mine = [row for row in rows if "judged" in row and row["name"] != "nothing"]
    peers = PEERS if mine else ()
    return {
        "cases": len(mine),
        "median": {p: float(np.median([_error(row, p) for row in mine])) for p in peers},
        "judged": {p: dict(Counter(row["judged"][p] for row in mine)) for p in peers},
    }


def _error(row: Mapping[str, Any], peer: str) -> float:
    """Infinite where a model has no signal."""
    error = row["over_noise"][peer]
    return math.inf if error is None else error


def print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print a line a case, and what they come to."""
    lines = []
    for row in rows:
        names = "; ".join(" or ".join(group) for group in row["said"]) or "-"
        verdict = row["diagnosis"]
        told = " + ".join(verdict["found"]) or verdict["verdict"]
        count = sum(len(terms) for terms in row["terms"].values())
        judgement = row.get("judged", {})
        lines.append(
            (
                row["name"],
                *(f"{_error(row, p):.3g}" for p in PEERS),
                f"{names} ({count} terms): {judgement.get('pysindy', '')}",
                f"{told}: {judgement.get('diagnosis', '')}",
            )
        )
    whole = summary(rows)
    if whole["cases"]:
        lines.append((f"median of {whole['cases']}", *(f"{whole['median'][p]:.3g}" for p in PEERS), "", ""))
    print("Held-out RMS over the noise, free run; where nothing tells the noise, over what most fitted samples show:")
    print_table(("planted", *PEERS, "pysindy says", "diagnosis says"), lines)
    for row in rows:
        if not row["noise_known"]:
            print(f"{row['name']}: 1 stands for {row['noise_rms']:.4g} {row['unit']} of the fast channel.")
    for peer, counts in whole["judged"].items():
        print(f"{peer}: " + ", ".join(f"{count} {word}" for word, count in counts.items()))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    effects = [case.effects[0] for case in cases("single", 1) if case.strength == "strong"]
    names = ["nothing", *(name for name in effects if name not in BY_CHANCE)]
    parser.add_argument("planted", nargs="*", metavar="EFFECT", help="only these; all, and nothing, unless given")
    parser.add_argument("--folder", type=Path, action="append", default=[], help="of measured recordings")
    parser.add_argument("--json", type=Path, help="write the table there too")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args(arguments)
    if find_spec("pysindy") is None:
        parser.error('pysindy is not installed; it comes with the development extra: pip install -e ".[dev]".')
    for name in given.planted:
        if name not in names:
            parser.error(f"EFFECT must be one of {', '.join(names)}; got {name!r}.")
    tasks: list[tuple[Callable[[Any], dict[str, Any]], Any]] = [(told_of_folder, folder) for folder in given.folder]
    for name in given.planted or names:
        case = Case("null", (), "none", 0) if name == "nothing" else Case("single", (name,), "strong", 0)
        tasks.append((told_of, case))
    rows = []
    with ProcessPoolExecutor(given.workers) as pool, shown_progress("cases", len(tasks)) as shown:
        for row in pool.map(_run, tasks):
            rows.append(row)
            shown(len(rows), row["name"])
    print_rows(rows)
    if given.json is not None:
        write_json(given.json, {"format": "diagnosis-peers/1", "cases": rows, "summary": summary(rows)})


def _run(task: tuple[Callable[[Any], dict[str, Any]], Any]) -> dict[str, Any]:
    work, subject = task
    return work(subject)


if __name__ == "__main__":
    main()
