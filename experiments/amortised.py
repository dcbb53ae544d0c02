"""Learning once over many heads, against optimising every head from scratch.

With one head an agent is only a search distribution. Over heads it is *amortised*: it is trained on some, and a head
that it never saw gets its waveform at once, or a warm start. Four ways of learning are compared on one ledger, in which
every evaluation of a waveform counts, those of training too; an evaluation with its gradient counts as one.

``python -m experiments.amortised`` trains, tests and tells; what a folder holds is not done again.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.measures import Estimate, first_hits, stratified
from experiments.policies import Policy, PolicyFileError, kept_policy, policy_of_layers, policy_of_sb3
from experiments.progress import shown_progress
from inkjet_env.envs.task import WaveformTask, make_task
from inkjet_env.storage import json_text, write_atomically

Real = NDArray[np.float64]

FORMAT = "amortised/1"
TITLE = "Learning over heads"
HIDDEN = (128, 128)
BUDGETS = (50, 150, 2000)
WARM_STEP = 0.05
"""First step of a warm start, in half widths of the box: a policy is near, or it is worth nothing."""
SCRATCH = ("cma-es", "lbfgsb-multistart", "pso", "coordinate")
TEST_SEED, TRAIN_SEED = 10**12, 10_000
"""Training draws from its own on, one number a step: it must never come to the other."""
LABELLING_STARTS = 4
"""Descents that a waveform to imitate is the best of."""
POINTS_A_START = 100
"""Uniform points for each descent, which begins from one of the best of all."""


@functools.cache
def the_task() -> WaveformTask:
    """Heads as the environment draws them with ``context="random"``."""
    return make_task(context="random")


def drawn(count: int, seed: int) -> NDArray[np.float32]:
    """Observations of heads, shape (count, 4): those that environments seeded from ``seed`` on would draw first."""
    return the_task().contexts([np.random.default_rng([seed, k]) for k in range(count)])


@dataclass(frozen=True, eq=False)
class Heads:
    """Heads side by side: row k of points belongs to head k.

    Parameters
    ----------
    observations : ndarray, shape (n, 4)
    """

    observations: NDArray[np.float32]

    @functools.cached_property
    def rows(self) -> Real:
        """For the compiled simulator."""
        return the_task().heads(self.observations)

    def evaluate(self, points: Real) -> Real:
        """Costs in volts, shape (n,), of points (n, 7) in ``[-1, 1]``."""
        from inkjet_env.printhead import batch

        return batch.costs(the_task().bounds.from_unit(points), self.rows)

    def evaluate_with_gradient(self, points: Real) -> tuple[Real, Real]:
        """The same, with gradients by the points, shape (n, 7)."""
        from inkjet_env.printhead import batch

        bounds = the_task().bounds
        costs, gradients = batch.costs_and_gradients(bounds.from_unit(points), self.rows)
        return costs, gradients * bounds.half_width

    def one(self, k: int) -> OneHead:
        """Head k as a problem of its own."""
        return OneHead(self.observations[k : k + 1])


class OneHead(Heads):
    """One head, any number of points."""


def descended(head: OneHead, starts: int, seed: int) -> tuple[Real, float, int]:
    """Best end of L-BFGS-B from the best of many uniform points on one head: point, cost in volts, evaluations.

    From any point it mostly ends at firing nothing, which costs nothing and has no slope.
    """
    from scipy.optimize import minimize

    def value_and_slope(point: Real) -> tuple[float, Real]:
        costs, gradients = head.evaluate_with_gradient(point[None, :])
        return float(costs[0]), gradients[0]

    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (POINTS_A_START * starts, 7))
    best, cost, spent = np.zeros(7), math.inf, len(points)
    for start in points[np.argsort(head.evaluate(points))[:starts]]:
        end = minimize(value_and_slope, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * 7)
        spent += int(end.nfev)
        if end.fun < cost:
            best, cost = np.clip(end.x, -1.0, 1.0), float(end.fun)
    return best, cost, spent


Trained = tuple[Policy, int]
"""A policy, and the evaluations that it cost."""


def by_gradient(evaluations: int, seed: int, heads: int = 256) -> Trained:
    """A network trained on the simulator's exact gradient: the mean cost over heads that are drawn anew each step."""
    import torch

    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network, layers = _network()
    steps = max(1, evaluations // heads)
    optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    with shown_progress("gradient", steps) as progress:
        for step in range(steps):
            some = Heads(drawn(heads, TRAIN_SEED + seed * 100_000 + step))
            actions = torch.tanh(network(torch.as_tensor(some.observations)))
            costs, gradients = some.evaluate_with_gradient(actions.detach().double().numpy())
            optimiser.zero_grad()
            # the chain rule by hand: the simulator's gradient, then the network's
            actions.backward(torch.as_tensor(gradients / heads, dtype=actions.dtype))
            torch.nn.utils.clip_grad_norm_(network.parameters(), 10.0)
            optimiser.step()
            schedule.step()
            progress(step + 1, f"mean cost {costs.mean():.2f} V")
    made = {"by": "gradient", "evaluations": steps * heads, "seed": seed}
    return policy_of_layers(layers, "tanh", made), steps * heads


def by_imitation(evaluations: int, seed: int) -> Trained:
    """A plain regression on the best waveforms that descents found for heads, as many as the evaluations allow."""
    import torch

    observations, points, spent, k = [], [], 0, 0
    with shown_progress("imitation", evaluations) as progress:
        while spent < evaluations:
            one = drawn(1, TRAIN_SEED + seed * 100_000 + k)
            point, cost, used = descended(OneHead(one), LABELLING_STARTS, seed + k)
            observations.append(one[0])
            points.append(point)
            spent, k = spent + used, k + 1
            progress(min(spent, evaluations), f"{k} heads, {cost:.2f} V")
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network, layers = _network()
    x = torch.as_tensor(np.array(observations), dtype=torch.float32)
    y = torch.as_tensor(np.array(points), dtype=torch.float32)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3, weight_decay=1e-4)
    for _ in range(3000):
        optimiser.zero_grad()
        torch.mean((network(x) - y) ** 2).backward()
        optimiser.step()
    made = {"by": "imitation", "evaluations": spent, "heads": k, "seed": seed}
    return policy_of_layers(layers, "clip", made), spent


def by_agent(algorithm: str, evaluations: int, seed: int) -> Trained:
    """PPO or SAC of Stable-Baselines3 on the environment with drawn heads."""
    import stable_baselines3
    import torch
    from torch import nn

    from inkjet_env.envs.sb3 import BipolarWaveformVecEnv

    torch.set_num_threads(1)
    ppo = algorithm == "PPO"
    envs = BipolarWaveformVecEnv(512 if ppo else 16, context="random")
    envs.seed(seed)
    network = {"net_arch": list(HIDDEN), "activation_fn": nn.Tanh}
    options: dict[str, Any] = (
        {"n_steps": 1, "batch_size": 512, "learning_rate": 1e-3, "policy_kwargs": network | {"log_std_init": -0.7}}
        if ppo
        else {"train_freq": 1, "gradient_steps": 4, "batch_size": 256, "gamma": 0.0, "policy_kwargs": network}
    )
    model = getattr(stable_baselines3, algorithm)("MlpPolicy", envs, seed=seed, device="cpu", **options)
    with shown_progress(f"sb3-{algorithm.lower()}", evaluations) as progress:
        model.learn(evaluations, callback=telling(progress, evaluations))
    spent = int(model.num_timesteps)
    return policy_of_sb3(model, {"by": f"sb3-{algorithm.lower()}", "evaluations": spent, "seed": seed}), spent


def telling(progress: Callable[[int, str], None], total: int) -> Callable[[Any, Any], bool]:
    """A callback of Stable-Baselines3 that shows how far training is; it may run over by a part of a rollout."""

    def tell(scope: Any, _: Any) -> bool:
        progress(min(scope["self"].num_timesteps, total), "")
        return True

    return tell


def _network() -> tuple[Any, list[Any]]:
    """Linear layers with tanh between them, and the linear ones alone."""
    from torch import nn

    sizes = (4, *HIDDEN, 7)
    layers = [nn.Linear(a, b) for a, b in itertools.pairwise(sizes)]
    between = [part for layer in layers[:-1] for part in (layer, nn.Tanh())]
    return nn.Sequential(*between, layers[-1]), layers


LEARNERS: dict[str, Callable[[int, int], Trained]] = {
    "gradient": by_gradient,
    "imitation": by_imitation,
    "sb3-ppo": functools.partial(by_agent, "PPO"),
    "sb3-sac": functools.partial(by_agent, "SAC"),
}


@dataclass(frozen=True, eq=False)
class TuningResult:
    """What a way of tuning came to on heads that nobody had seen.

    Parameters
    ----------
    name : str
    at_once_V : ndarray, shape (heads,)
        Regret of the policy's own waveform; NaN where there is no policy.
    curves_V : ndarray, shape (heads, evaluations)
        Regret of the best waveform after each further evaluation.
    trained : int
        Evaluations that training cost.
    """

    name: str
    at_once_V: Real
    curves_V: Real
    trained: int


def tuned(name: str, policy: Policy | None, optimizer: str, heads: Heads, best_V: Real, seed: int) -> TuningResult:
    """Tune every head: by an optimiser from scratch, or by one from where a policy begins, which may be CMA-ES only."""
    import optimizers
    from optimizers.loop import minimise

    budget = max(BUDGETS)
    count = len(heads.observations)
    begin = None if policy is None else policy.act(heads.observations)
    at_once = np.full(count, math.nan) if begin is None else heads.evaluate(begin) - best_V
    curves = np.empty((count, budget))
    with shown_progress(f"test {name}", count) as progress:
        for k in range(count):
            options: dict[str, Any] = {}
            if begin is not None:
                options = {"start": begin[k].tolist(), "first_step": WARM_STEP}
            run = minimise(heads.one(k), optimizers.make(optimizer, budget=budget, seed=seed + k, **options), budget)
            curves[k] = np.minimum.accumulate(run.costs) - best_V[k]
            if begin is not None:  # the policy's own waveform is the first evaluation
                curves[k] = np.minimum(np.concatenate([[at_once[k]], curves[k][:-1]]), at_once[k])
            progress(k + 1, "")
    return TuningResult(name, at_once, curves, 0 if policy is None else int(policy.made["evaluations"]))


def break_even(policy: TuningResult, scratch: TuningResult, evaluations: int) -> float:
    """Heads from which on learning has cost less than optimising each from scratch, to be as good as it is.

    As good: the policy's median regret after so many evaluations a head. Infinite where scratch is there sooner.
    """
    target = float(np.median(policy.curves_V[:, evaluations - 1]))
    curve = np.median(scratch.curves_V, axis=0)
    needed = float(first_hits(curve[None, :], [target])[0, 0])
    saved = needed - evaluations
    return policy.trained / saved if saved > 0 else math.inf


def told(results: Sequence[TuningResult], rng: np.random.Generator) -> list[dict[str, Any]]:
    """Median regrets with 95 % intervals over heads, at once and after each budget, and break-even numbers."""
    scratch = min((one for one in results if not one.trained), key=lambda one: float(np.median(one.curves_V[:, -1])))
    rows = []
    for one in results:
        row: dict[str, Any] = {"name": one.name, "trained": one.trained}
        columns = {"0": one.at_once_V} | {str(b): one.curves_V[:, b - 1] for b in BUDGETS}
        for label, values in columns.items():
            if np.isfinite(values).all():
                found = stratified(lambda x: np.median(x, axis=(-2, -1)), [values[:, None]], rng)
                row[label] = _json(found)
        if one.trained:
            even = break_even(one, scratch, BUDGETS[0])
            row["break_even_heads"] = None if math.isinf(even) else even
            row["against"] = scratch.name
        rows.append(row)
    return rows


def _json(found: Estimate) -> dict[str, float]:
    return {"value": found.value, "low": found.low, "high": found.high}


def study(folder: Path, evaluations: int, heads: int, labelling: int, seed: int) -> dict[str, Any]:
    """Train every learner, test all ways, write ``amortised.json``; policies are kept and not trained again."""
    folder.mkdir(parents=True, exist_ok=True)
    tests = Heads(drawn(heads, TEST_SEED))
    best = np.array([descended(tests.one(k), labelling, seed + k)[1] for k in range(heads)])
    asked = {"evaluations": evaluations, "seed": seed}
    trained = {
        name: kept_policy(folder / f"{name}.npz", asked, functools.partial(_policy, learn, evaluations, seed))
        for name, learn in LEARNERS.items()
    }
    results = []
    for optimizer in SCRATCH:
        results.append(tuned(optimizer, None, optimizer, tests, best, seed))
    for name, policy in trained.items():
        results.append(tuned(name, policy, "cma-es", tests, best, seed))
    least = np.min([one.curves_V.min(axis=1) for one in results], axis=0)
    moved = [TuningResult(o.name, o.at_once_V - least, o.curves_V - least[:, None], o.trained) for o in results]
    found = {
        "format": FORMAT,
        "heads": heads,
        "evaluations": evaluations,
        "seed": seed,
        "best_improved": int(np.sum(least < -1e-6)),
        "rows": told(moved, np.random.default_rng(seed)),
    }
    write_atomically(folder / "amortised.json", json_text(found))
    return found


def _policy(learn: Callable[[int, int], Trained], evaluations: int, seed: int) -> Policy:
    return learn(evaluations, seed)[0]


def table(found: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows of a study, for people."""

    def volts(entry: Mapping[str, float] | None) -> str:
        return "–" if entry is None else f"{entry['value']:.3g} ({entry['low']:.3g} … {entry['high']:.3g})"

    rows = []
    for row in found["rows"]:
        even = row.get("break_even_heads")
        text = "" if not row["trained"] else "never" if even is None else f"{math.ceil(even):,}"
        rows.append(
            (row["name"], f"{row['trained']:,}", *(volts(row.get(str(b))) for b in (0, *BUDGETS)), text),
        )
    return ("tuned by", "evaluations to learn", *(f"after {b:,}" for b in (0, *BUDGETS)), "pays from … heads"), rows


def legend(found: Mapping[str, Any]) -> str:
    """What the table's numbers are."""
    return f"Median regret in volts over {found['heads']} heads that nobody had seen, with its 95 % interval."


def print_study(found: Mapping[str, Any]) -> None:
    """The table for people."""
    from experiments.tables import print_table

    print_table(*table(found))
    print(legend(found))


def run_command(
    module: str,
    description: str | None,
    evaluations: int,
    heads: int,
    run: Callable[[Path, int, int, int, int], Mapping[str, Any]],
    show: Callable[[Mapping[str, Any]], None],
    arguments: list[str] | None,
) -> None:
    """A study from the command line: ``run(folder, evaluations, heads, labelling, seed)``, then ``show`` of it."""
    parser = argparse.ArgumentParser(prog=f"python -m experiments.{module}", description=description)
    parser.add_argument("--folder", type=Path, default=Path("results") / module.replace("_", "-"))
    parser.add_argument("--evaluations", type=int, default=evaluations, help="of a training")
    parser.add_argument("--heads", type=int, default=heads, help="to test on")
    parser.add_argument("--labelling", type=int, default=60, help="descents for the best cost known of a test head")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    for name, least in (("evaluations", 1), ("heads", 1), ("labelling", 1), ("seed", 0)):
        if getattr(chosen, name) < least:
            parser.error(f"--{name} must be at least {least}; got {getattr(chosen, name)}.")
    try:
        show(run(chosen.folder, chosen.evaluations, chosen.heads, chosen.labelling, chosen.seed))
    except PolicyFileError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    except KeyboardInterrupt:
        print(f"Interrupted; policies that are trained are kept in {chosen.folder}.", file=sys.stderr)
        sys.exit(130)


def main(arguments: list[str] | None = None) -> None:
    """Train, test and tell."""
    run_command("amortised", __doc__, 200_000, 100, study, print_study, arguments)


if __name__ == "__main__":
    main()
