"""Training of the recurrent policy on the simulator's exact gradients, over drawn heads and heads with effects.

``python -m inkjet_env.experiments.learning.recurrent_training --out policy.npz --seed 0``

In every try the policy scores the waveforms of its list and its steps from the kept waveform. Some of them are
evaluated on the head, which is known in training, so that the expected cost of the choice among them is exact, and so
is its gradient in corrections and steps. An estimate of the head's parameters is learnt beside. The waveform that is
fired is drawn by the scores; no gradient is taken through what is read of it. Batches of heads take turns: as the
environment draws them, read with larger errors, lying further out, and with an effect beyond the base model. In the end
a policy uses few waveforms of its list, and which ones is partly chance: so several are trained, and the best is kept.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.envs.given_heads import GivenHeads
from inkjet_env.envs.task import CONTEXT_LOWER, CONTEXT_UPPER
from inkjet_env.envs.tune_waveform import NOISE_V, TRIES, TuneWaveformVectorEnv
from inkjet_env.experiments.learning.few_shot_tuners import best_list, kept_costs_V
from inkjet_env.experiments.learning.heads import PARAMETERS, TRAIN_SEED, Heads, heads_with_effects, the_task
from inkjet_env.experiments.learning.learners import labelled
from inkjet_env.experiments.learning.recurrent_policy import (
    FACTORS,
    FARTHEST,
    FEATURES,
    KEPT,
    READ,
    RecurrentPolicy,
    RecurrentTuner,
    features,
)
from inkjet_env.extras import extra
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.progress import shown_progress
from inkjet_env.typing import Real

with extra("learning"):
    import torch
    from torch import Tensor, nn

UNITS, WAVEFORMS, STEPS = 128, 64, 16
"""Units of the network, waveforms of its list, and steps from the kept waveform."""
SMALL = 0.3
"""Factor by which the steps with which training begins are smaller than those of a layer with usual weights."""
LABELLED = 400_000
"""Evaluations spent on the best waveforms of some heads, from which the list is chosen."""
EVALUATIONS = 16_000_000
"""Evaluations of a training."""
POLICIES, HEADS_OF_THE_CHOICE = 2, 500
"""Policies that share the evaluations, and unseen heads on which the one with the lowest mean cost is chosen."""
HEADS, HEADS_WITH_EFFECTS = 96, 8
"""Heads of a batch."""
HEADS_OF_THE_FIRST = 1500
"""Heads on which the first waveform is chosen."""
CANDIDATES = 6
"""Waveforms that are evaluated in a try, half of them those of the highest scores."""
WIDER = 3.0
"""Scale of the random part of the scores by which the other candidates are drawn."""
PLAIN = 0.1
"""Weight of the plain cost beside the cost that is kept: it shows the way where the waveform would not be kept."""
JITTER = 0.02
"""Standard deviation of what is added to the candidates of the second try, in half widths of the box: a waveform on the
edge of a jump of the cost is not worth much. In the k-th try it is the (k − 1)-th part: once a good waveform is kept,
the edge may be tried."""
STEEPEST_V = 30.0
"""Largest component of a gradient, in volts per half width of the box."""
RATE = 2e-3
"""Largest rate of learning, after a third of the episodes."""
LEARNING_OF_THE_ESTIMATE = 0.3
"""Weight of the estimate's mean error beside costs in volts."""
EFFECTS = 300
"""Number of heads with effects."""
SEEDS = 10**7
"""Seeds of the heads of a training, which no other training and no test draws."""


class TrainingBench:
    """Heads on the bench, which are known: any waveform can be evaluated on them.

    Parameters
    ----------
    count, tries : int
        Numbers of heads and tries.
    noise_V : float
        Standard deviation of an error of reading, in volts.
    spread : float
        How much further heads lie from the middle of their ranges than the environment draws them.
    effects : tuple of HeadEnsemble and ndarray, optional
        The heads that are drawn instead, and their parameters; see `heads_with_effects`.
    """

    def __init__(
        self,
        count: int,
        tries: int,
        noise_V: float = NOISE_V,
        spread: float = 1.0,
        effects: tuple[HeadEnsemble, Real] | None = None,
    ) -> None:
        self.count, self.spread = count, spread
        ensemble = None if effects is None else effects[0]
        self.of_effects = None if effects is None else effects[1]
        self.envs = TuneWaveformVectorEnv(count, tries=tries, noise=noise_V, heads=ensemble)
        self.exact = None if ensemble is None else GivenHeads(ensemble)

    def reset(self, seed: int) -> Real:
        """Other heads: the first observations, shape (count, 32)."""
        shown = self.envs.reset(seed=seed)[0].astype(np.float64)
        if self.spread != 1.0:
            self.envs.tuning.put_on_the_bench(self.spread * self.envs.tuning.contexts)
        return shown

    @property
    def parameters(self) -> Real:
        """The heads' parameters as the environment ``context="random"`` shows them, shape (count, 4)."""
        if self.of_effects is not None:
            return np.asarray(self.of_effects[self.envs.tuning.numbers])
        return self.envs.tuning.contexts.astype(np.float64)

    def evaluate(self, points: Real) -> tuple[Real, Real]:
        """Costs in volts, shape (count, k), and their gradients, shape (count, k, 7), zero for heads with effects.

        Parameters
        ----------
        points : ndarray, shape (count, k, 7)
            Points in ``[-1, 1]``; what is outside is clipped.
        """
        flat, each, tuning = points.reshape(-1, 7), points.shape[1], self.envs.tuning
        if self.exact is None:
            heads = Heads(np.repeat(tuning.contexts, each, axis=0))
            costs_V, gradients = heads.evaluate_with_gradient(flat)
        else:
            waveforms = tuning.task.bounds.from_unit(np.clip(flat, -1.0, 1.0))
            costs_V = self.exact.read(np.repeat(tuning.numbers, each), waveforms, ()).costs_V
            gradients = np.zeros_like(flat)
        return costs_V.reshape(points.shape[:2]), gradients.reshape(points.shape)


class Network(nn.Module):
    """The network of a `RecurrentPolicy`, in double precision.

    Parameters
    ----------
    listed : ndarray, shape (waveforms, 7)
        The waveforms with which it begins, for the middle head, in ``[-1, 1]``.
    first : ndarray, shape (7,)
        The waveform that is fired first.
    """

    def __init__(self, listed: Real, first: Real) -> None:
        super().__init__()
        self.first = first
        self.encoder, self.gates = nn.Linear(FEATURES, UNITS), nn.GRUCell(UNITS, UNITS)
        self.estimate, self.score = nn.Linear(UNITS, PARAMETERS), nn.Linear(UNITS, len(listed) + STEPS)
        self.steps = nn.Linear(UNITS, STEPS * 7)
        with torch.no_grad():
            for weights in self.steps.parameters():
                weights.mul_(SMALL)
        corrections = torch.zeros(len(listed), len(FACTORS), 7, dtype=torch.float64)
        corrections[:, 0] = torch.as_tensor(listed)
        self.corrections = nn.Parameter(corrections)
        self.double()
        ends = the_task().bounds.from_unit(np.array([[-1.0] * 7, [1.0] * 7]))
        self.lower, self.half_width = torch.as_tensor(ends[0]), torch.as_tensor((ends[1] - ends[0]) / 2)
        self.resonances_Hz = CONTEXT_LOWER[0], CONTEXT_UPPER[0]

    def forward(self, observations: Real, state: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
        """Estimates (n, 4), scores (n, waveforms + steps) and the next state."""
        state = self.gates(torch.tanh(self.encoder(torch.as_tensor(features(observations)))), state)
        return self.estimate(state), self.score(state), state

    def points(self, observations: Real, estimates: Tensor, state: Tensor, chosen: Tensor) -> Tensor:
        """The waveforms of chosen scores, shape (n, k): shape (n, k, 7), in units of the box."""
        listed = chosen < len(self.corrections)
        inside = estimates.clamp(-FARTHEST, FARTHEST)
        polynomial = torch.cat([torch.ones_like(inside[:, :1]), inside], 1)[:, FACTORS].prod(2)
        points = torch.einsum("nt,nctk->nck", polynomial, self.corrections[torch.where(listed, chosen, 0)])
        low_Hz, high_Hz = self.resonances_Hz
        middle_Hz = (low_Hz + high_Hz) / 2  # of the head for which the list is made
        scale = (middle_Hz / (middle_Hz + inside[:, 0] * (high_Hz - low_Hz) / 2))[:, None, None]
        physical = self.lower + (points + 1) * self.half_width
        points = torch.cat([points[..., :2], ((physical * scale - self.lower) / self.half_width - 1)[..., 2:]], 2)
        numbers = torch.where(listed, 0, chosen - len(self.corrections))[..., None].expand(-1, -1, 7)
        steps = self.steps(state).view(len(state), STEPS, 7).gather(1, numbers)
        return torch.where(listed[..., None], points, torch.as_tensor(observations[:, KEPT])[:, None] + steps)

    def policy(self, made: dict[str, Any]) -> RecurrentPolicy:
        """The policy with these weights."""
        tensors = {
            "encoder": self.encoder.weight,
            "encoder_bias": self.encoder.bias,
            "input_gates": self.gates.weight_ih,
            "input_gates_bias": self.gates.bias_ih,
            "state_gates": self.gates.weight_hh,
            "state_gates_bias": self.gates.bias_hh,
            "estimate": self.estimate.weight,
            "estimate_bias": self.estimate.bias,
            "score": self.score.weight,
            "score_bias": self.score.bias,
            "corrections": self.corrections,
            "steps": self.steps.weight,
            "steps_bias": self.steps.bias,
        }
        arrays = {name: value.detach().numpy().copy() for name, value in tensors.items()}
        return RecurrentPolicy({"first": self.first.copy(), **arrays}, made)


def loss_of_an_episode(
    network: Network, bench: TrainingBench, tries: int, seed: int, random: torch.Generator
) -> tuple[Tensor, int]:
    """Loss of tuning other heads, with its gradient, and the number of evaluations that it took."""
    observations = bench.reset(seed)
    parameters = torch.as_tensor(bench.parameters)
    state, kept_V, spent = None, torch.zeros(bench.count, 1, dtype=torch.float64), 0
    loss = torch.zeros((), dtype=torch.float64)
    for made in range(tries):
        estimates, scores, state = network(observations, state)
        if made == 0:
            actions = np.tile(network.first, (bench.count, 1))
        else:
            loss = loss + LEARNING_OF_THE_ESTIMATE * (estimates - parameters).abs().sum(1).mean()
            chosen = _candidates(scores.detach(), random)
            points = network.points(observations, estimates, state, chosen)
            tried = points.detach() + JITTER / made * torch.randn(points.shape, generator=random, dtype=torch.float64)
            costs_V, gradients = map(torch.as_tensor, bench.evaluate(tried.numpy()))
            spent += costs_V.numel()
            values_V = (1 - PLAIN) * torch.minimum(costs_V, kept_V) + PLAIN * costs_V
            slopes = torch.where(costs_V < kept_V, 1.0, PLAIN)[..., None] * gradients
            shares = torch.softmax(scores.gather(1, chosen), 1)
            # the derivative of the expected value in the scores, and then in the candidates
            loss = loss + (shares * (values_V - (shares.detach() * values_V).sum(1, keepdim=True))).sum(1).mean()
            steepest = slopes.clamp(-STEEPEST_V, STEEPEST_V)
            loss = loss + (shares.detach()[..., None] * steepest * points).sum((1, 2)).mean()
            fired = torch.multinomial(shares.detach(), 1, generator=random)
            actions = tried.gather(1, fired[..., None].expand(-1, -1, 7))[:, 0].clamp(-1.0, 1.0).numpy()
        shown, _, _, _, infos = bench.envs.step(actions.astype(np.float32))
        observations = shown.astype(np.float64)
        kept_V, spent = torch.as_tensor(infos["kept_cost"])[:, None], spent + bench.count
    return loss / (tries - 1), spent


def _candidates(scores: Tensor, random: torch.Generator) -> Tensor:
    """Numbers of waveforms to evaluate, shape (n, CANDIDATES): of the highest scores, and drawn by them."""
    best = scores.topk(CANDIDATES // 2, 1).indices
    uniform = torch.rand(scores.shape, generator=random, dtype=torch.float64)
    others = scores.scatter(1, best, -torch.inf) - WIDER * torch.log(-torch.log(uniform))
    return torch.cat([best, others.topk(CANDIDATES - best.shape[1], 1).indices], 1)


def most_telling(waveforms: Real, seed: int) -> tuple[Real, int]:
    """The waveform whose peaks tell most of a head, and the number of evaluations spent on the choice.

    It is fired on drawn heads. A quadratic function of what is read on half of them, fitted by least squares, estimates
    the parameters of the others with the least mean error.

    Parameters
    ----------
    waveforms : ndarray, shape (k, 7)
        Points in ``[-1, 1]``.
    seed : int
    """
    envs, fitted = TuneWaveformVectorEnv(HEADS_OF_THE_FIRST), slice(HEADS_OF_THE_FIRST // 2)
    others = slice(fitted.stop, None)
    errors = []
    for waveform in waveforms:
        envs.reset(seed=TRAIN_SEED + SEEDS * (1 + seed))
        shown = envs.step(np.tile(waveform, (envs.num_envs, 1)).astype(np.float32))[0]
        read = features(shown)[:, READ:]
        columns = np.column_stack([np.ones(len(read)), read, read**2])
        fit = np.linalg.lstsq(columns[fitted], envs.tuning.contexts[fitted], rcond=1e-9)[0]
        errors.append(np.abs(columns[others] @ fit - envs.tuning.contexts[others]).mean())
    return waveforms[int(np.argmin(errors))], len(waveforms) * envs.num_envs


def trained_recurrent_policy(evaluations: int, tries: int, seed: int) -> RecurrentPolicy:
    """The best of some policies that share a number of evaluations, beside those for their lists and for the choice.

    Its ``made`` has the sum of all evaluations.
    """
    policies = [_one_policy(evaluations // POLICIES, tries, seed + k) for k in range(POLICIES)]
    unseen = TRAIN_SEED + SEEDS * (1 + seed) + SEEDS // 2  # no training draws so many
    kept_V = [kept_costs_V(RecurrentTuner(one), HEADS_OF_THE_CHOICE, tries, unseen).mean() for one in policies]
    spent = sum(one.made["evaluations"] for one in policies) + POLICIES * HEADS_OF_THE_CHOICE * tries
    best = policies[int(np.argmin(kept_V))]
    return replace(best, made={"by": "recurrent", "evaluations": spent, "tries": tries, "seed": seed})


def _one_policy(evaluations: int, tries: int, seed: int) -> RecurrentPolicy:
    """A policy, with the evaluations that it took."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    random = torch.Generator().manual_seed(seed)
    observations, best, spent = labelled(LABELLED, seed)
    listed, more = best_list(observations, best, min(WAVEFORMS, len(best)), stretch=True)
    first_waveform, telling = most_telling(listed, seed)
    spent += more + telling
    usual = TrainingBench(HEADS, tries)
    benches = (
        usual,
        TrainingBench(HEADS, tries, noise_V=3 * NOISE_V),
        TrainingBench(HEADS_WITH_EFFECTS, tries, effects=heads_with_effects(EFFECTS, TRAIN_SEED + seed)),
        usual,
        TrainingBench(HEADS, tries, spread=FARTHEST),
    )
    network = Network(listed, first_waveform)
    episodes = max(1, evaluations // (HEADS * (tries + (tries - 1) * CANDIDATES)))
    optimiser = torch.optim.Adam(network.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, episodes)
    with shown_progress(f"recurrent policy, seed {seed}", episodes) as progress:
        for episode, bench in zip(range(episodes), itertools.cycle(benches), strict=False):
            first = TRAIN_SEED + SEEDS * (1 + seed) + HEADS * episode
            loss, more = loss_of_an_episode(network, bench, tries, first, random)
            spent += more
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), 5.0)
            optimiser.step()
            schedule.step()
            progress(episode + 1)
    return network.policy({"evaluations": spent})


def main(arguments: Sequence[str] | None = None) -> None:
    """Train and write a policy."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="file of the policy")
    parser.add_argument("--evaluations", type=int, default=EVALUATIONS, help="evaluations of the training")
    parser.add_argument("--tries", type=int, default=TRIES, help="tries on a head")
    parser.add_argument("--seed", type=int, default=0, help="seed of all random numbers")
    asked = parser.parse_args(arguments)
    if asked.evaluations < 1 or asked.tries < 2 or asked.seed < 0:
        parser.error("--evaluations must be at least 1, --tries at least 2, and --seed at least 0.")
    policy = trained_recurrent_policy(asked.evaluations, asked.tries, asked.seed)
    policy.save(asked.out)
    print(f"{asked.out}: a policy of {sum(map(np.size, policy.arrays.values())):,} numbers.")


if __name__ == "__main__":
    main()
