"""Speed as ratios to the alternatives that a user would choose, each measured in one run on one core.

Three tables: hysteresis by branch law compared with play operators, evaluations of the cost compared with two SciPy
pipelines, and steps of the environments. Every figure is the best of several repetitions in which the alternatives take
turns, so that other load on the machine does not affect only one of them. `speed` prints them."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from inkjet_env.printhead import Bounds, PlayOperators, Printhead
from inkjet_env.printhead.window import DEFAULT_WINDOW_S
from inkjet_env.typing import Real

SAMPLES = 4000
REPETITIONS = 7


def best_seconds(alternatives: Mapping[str, Callable[[], Any]], repetitions: int = REPETITIONS) -> dict[str, float]:
    """Shortest time of each call in seconds; the calls take turns."""
    best = dict.fromkeys(alternatives, float("inf"))
    for call in alternatives.values():
        call()
    for _ in range(repetitions):
        for name, call in alternatives.items():
            begin_s = time.perf_counter()
            call()
            best[name] = min(best[name], time.perf_counter() - begin_s)
    return best


def sampled_hysteresis(waveforms: Real, head: Printhead, time_s: Real) -> Real:
    """Hysteretic drive in volts of periodic firing on a time grid, vectorised over waveforms, shape (n, samples).

    Eq. (3) of docs/explanation/model.md, ``v = v_k ± Q(|u - u_k|)``, with the turning points U1 and U2.
    """
    law = head.branch_law
    U1, U2 = waveforms[:, :1], waveforms[:, 1:2]
    ends_s = np.cumsum(waveforms[:, 2:], axis=1)
    drive_V = np.empty((len(waveforms), time_s.size))
    for row, ends, (u1, u2) in zip(drive_V, ends_s, waveforms[:, :2], strict=True):
        row[:] = np.interp(time_s, [0.0, *ends], [0.0, u1, u1, u2, u2, 0.0])
    rising = (time_s < ends_s[:, :1]) | (time_s > ends_s[:, 3:4])
    change = law.full_scale_V * law.Q(np.where(rising, drive_V - U2, U1 - drive_V) / law.full_scale_V)
    swing = law.full_scale_V * law.Q((U1 - U2) / law.full_scale_V)
    return np.where(rising, change, swing - change)  # Eq. (3)


@functools.lru_cache
def first_order_hold(head: Printhead, step_s: float) -> tuple[Real, Real]:
    """Filter coefficients of the resonator, exact for an input that is linear between samples."""
    from scipy.signal import cont2discrete

    numerator, denominator, _ = cont2discrete(([head.b1, 0.0], [1.0, head.a1, head.a0]), step_s, "foh")
    return np.ravel(numerator), denominator


def sampled_costs(waveforms: Real, head: Printhead, method: str) -> Real:
    """Default peak cost in volts by simulation on a grid of `SAMPLES`, shape (n,).

    A few waveforms at a time are faster than many, because their samples stay in the cache.

    ``method`` is "lsim", or "lfilter" with the coefficients of the first-order hold, which is exact for an input that
    is linear between samples. Peaks come from `scipy.signal.find_peaks`; the cost is Eq. (9) of
    docs/explanation/model.md, ``A |y_e| + B |y_{e+1}| + Σ |y_i|`` over the other peaks, with A = −5 and B = 5.
    """
    from scipy.signal import find_peaks, lfilter, lsim

    time_s = np.linspace(0.0, DEFAULT_WINDOW_S, SAMPLES)
    v = sampled_hysteresis(waveforms, head, time_s)
    v -= v[:, :1]
    if method == "lsim":
        system = ([head.b1, 0.0], [1.0, head.a1, head.a0])
        y = np.array([lsim(system, row, time_s)[1] for row in v])
    else:
        y = lfilter(*first_order_hold(head, time_s[1]), v, axis=1)
    costs = np.empty(len(waveforms))
    for i, row in enumerate(y):
        where = np.sort(np.concatenate([find_peaks(row)[0], find_peaks(-row)[0]]))
        peaks = np.abs(row[where])
        if not peaks.size:
            costs[i] = 0.0
            continue
        e = int(np.argmax(peaks))
        costs[i] = peaks.sum() - 6.0 * peaks[e] + (4.0 * peaks[e + 1] if e + 1 < peaks.size else 0.0)  # Eq. (9)
    return costs


def drawn_waveforms() -> Real:
    """Waveforms in volts and seconds, uniform in the default box, shape (4096, 7)."""
    return Bounds().from_unit(np.random.default_rng(0).uniform(-1, 1, (4096, 7)))


def evaluations_table() -> list[tuple[str, float, float]]:
    """Rows of method, microseconds per evaluation, ratio to the closed form."""
    import torch

    from inkjet_env.printhead import batch, lanes
    from inkjet_env.torch import head_parameters, peak_cost

    head, waveforms = Printhead.published(), drawn_waveforms()
    tensor = torch.from_numpy(waveforms).requires_grad_()
    heads = head_parameters(head)
    heads = heads._replace(**{name: value.requires_grad_() for name, value in heads._asdict().items()})
    few, some = waveforms[:4], waveforms[:64]
    exact = batch.costs(some, head)
    for method in ("lfilter", "lsim"):
        difference = np.abs(sampled_costs(some, head, method) - exact)
        print(f"  {method} on {SAMPLES} samples: median difference from the closed form {np.median(difference):.1e} V")
    seconds = best_seconds(
        {
            "closed form, compiled batch": lambda: batch.costs(waveforms, head),
            "eight side by side, in lanes": lambda: lanes.costs(waveforms, head),
            "with its gradient": lambda: batch.costs_and_gradients(waveforms, head),
            "torch: value and gradient": lambda: peak_cost(tensor, head).sum().backward(),
            "torch: and the gradient in the head": lambda: peak_cost(tensor, heads).sum().backward(),
            "lfilter (first-order hold) + find_peaks": lambda: [
                sampled_costs(some[i : i + 4], head, "lfilter") for i in range(0, len(some), 4)
            ],
            "lsim + find_peaks": lambda: sampled_costs(few, head, "lsim"),
        }
    )
    counts = (*[len(waveforms)] * 5, len(some), len(few))
    each = {name: 1e6 * total / n for (name, total), n in zip(seconds.items(), counts, strict=True)}
    ours = each["closed form, compiled batch"]
    return [(name, us, us / ours) for name, us in each.items()]


def hysteresis_table() -> list[tuple[str, float, float]]:
    """Rows of method, nanoseconds per sample, ratio to the branch law; all compiled, on one random drive."""
    from inkjet_env.printhead import compiled

    law = Printhead.published().branch_law
    drive_V = np.random.default_rng(0).uniform(-90, 90, 5000)
    table, memory, output = np.empty((4 * drive_V.size + 16, 6)), np.empty(drive_V.size + 2), np.empty(drive_V.size)

    def branch_law() -> None:
        found = compiled.branch_pieces(drive_V, law.full_scale_V, 0, False, memory, table)
        x, change = table[:found, 3], table[:found, 4]
        np.cumsum(table[:found, 5] * (law.Q(x + change) - law.Q(x)))

    alternatives: dict[str, Callable[[], Any]] = {"branch law, all turning points": branch_law}
    for n in (10, 30, 100, 300, 1000):
        plays = PlayOperators.of_branch_law(law, n)

        def classic(plays: PlayOperators = plays) -> None:
            states = np.zeros_like(plays.thresholds_V)
            compiled.play_operators(drive_V, plays.thresholds_V, plays.weights, states, output)

        alternatives[f"{n} play operators"] = classic
    each = {name: 1e9 * total / drive_V.size for name, total in best_seconds(alternatives).items()}
    ours = each["branch law, all turning points"]
    return [(name, ns, ns / ours) for name, ns in each.items()]


def environments_table() -> list[tuple[str, float, float]]:
    """Rows (what, µs a step, ratio to the vector environment)."""
    import gymnasium

    from inkjet_env import ENV_ID
    from inkjet_env.printhead import batch

    head, many = Printhead.published(), 1024
    vector = gymnasium.make_vec(ENV_ID, num_envs=many, vectorization_mode="vector_entry_point")
    same_step = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    sync = gymnasium.make_vec(ENV_ID, num_envs=many, vectorization_mode="sync", vector_kwargs=same_step)
    env = gymnasium.make(ENV_ID)
    idle = gymnasium.make("inkjet_env/Idle-v0")
    actions = np.random.default_rng(0).uniform(-1, 1, (many, 7)).astype(np.float32)
    waveforms = Bounds().from_unit(actions)
    arguments, capacity, cost = batch.prepare(waveforms[:1], head, None, "periodic", DEFAULT_WINDOW_S, "full_memory")
    lanes = gymnasium.make_vec(ENV_ID, num_envs=many, vectorization_mode="vector_entry_point", simulator="lanes")
    for each in (vector, lanes, sync):
        each.reset(seed=0)

    def steps(environment: gymnasium.Env) -> Callable[[], None]:
        def run() -> None:
            for action in actions:
                environment.reset()
                environment.step(action)

        return run

    def resets(environment: gymnasium.Env) -> Callable[[], None]:
        def run() -> None:
            for _ in actions:
                environment.reset()

        return run

    from inkjet_env.printhead.compiled import batch_costs

    def bare() -> None:
        for row in waveforms:
            batch_costs(row[None], arguments[1], arguments[2:], capacity, cost)

    def checked() -> None:
        for row in waveforms:
            batch.costs(row, head)

    seconds = best_seconds(
        {
            "vector environment, N = 1024": lambda: vector.step(actions),
            "vector environment in lanes, N = 1024": lambda: lanes.step(actions),
            "SyncVectorEnv, N = 1024": lambda: sync.step(actions),
            "step through gymnasium.make, with reset": steps(env),
            "reset alone": resets(env),
            "Gymnasium's wrappers on an idle environment, with reset": steps(idle),
            "idle reset alone": resets(idle),
            "bare compiled evaluation, one at a time": bare,
            "batch.costs, one at a time": checked,
        }
    )
    each_us = {name: 1e6 * total / many for name, total in seconds.items()}
    ours = each_us["vector environment, N = 1024"]
    step = each_us["step through gymnasium.make, with reset"] - each_us.pop("reset alone")
    wrappers = each_us["Gymnasium's wrappers on an idle environment, with reset"] - each_us.pop("idle reset alone")
    floor = each_us["bare compiled evaluation, one at a time"] + wrappers
    print(
        f"  a scalar step costs {step:.2f} µs: {step / floor:.2f} × (bare evaluation "
        f"{floor - wrappers:.2f} µs + Gymnasium's wrappers {wrappers:.2f} µs)"
    )
    return [(name, us, us / ours) for name, us in each_us.items()]


def register_idle() -> None:
    """Register an environment that does nothing, which shows the cost of Gymnasium's own wrappers."""
    import gymnasium

    space = gymnasium.spaces.Box(-1.0, 1.0, (7,), np.float32)

    class Idle(gymnasium.Env):
        action_space = space
        observation_space = space

        def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[Any, dict]:
            super().reset(seed=seed)
            return np.zeros(7, np.float32), {}

        def step(self, action: Any) -> tuple[Any, float, bool, bool, dict]:
            return np.zeros(7, np.float32), 0.0, True, False, {}

    gymnasium.register("inkjet_env/Idle-v0", entry_point=lambda **_: Idle())
