"""NARX baseline: a neural network that corrects the base model's signal from present and past signals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from inkjet_env.experiments.validation.baselines.base_fit import put_aside
from inkjet_env.extras import extra
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.typing import Real

LAGS = (0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1, 1.5, 2, 3, 4.5)
"""Lags in periods of the resonance; on a strain gauge in units of 100 samples."""
HIDDEN, MOST_EPOCHS, PATIENCE, BATCH, RATE = 32, 200, 25, 1024, 2e-3


def with_network(joint: OutputErrorFit, channel: str, seed: int) -> dict[str, Real]:
    """Modelled signals of one channel with the neural network's correction, by recording."""
    with extra("the NARX baseline"):
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

    def rows(chosen: Sequence[ObservedRecording]) -> Any:
        residuals = [(o.measured - base[o.name])[: o.fitted] for o in chosen]
        inputs = np.concatenate([tables[o.name][: o.fitted] for o in chosen])
        return tensor(inputs), torch.as_tensor(np.concatenate(residuals)[:, None] / size, dtype=torch.float32)

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
    best, checkpoint, waited = math.inf, network.state_dict(), 0
    for _ in range(MOST_EPOCHS):
        with torch.no_grad():
            error = float(torch.mean((network(unseen) - wanted) ** 2))
        waited += 1
        if error < best:
            best, waited = error, 0
            checkpoint = {name: value.clone() for name, value in network.state_dict().items()}
        if waited > PATIENCE:
            break
        for chosen in np.array_split(order.permutation(len(inputs)), math.ceil(len(inputs) / BATCH)):
            optimizer.zero_grad()
            torch.mean((network(inputs[chosen]) - target[chosen]) ** 2).backward()
            optimizer.step()
    network.load_state_dict(checkpoint)
    with torch.no_grad():
        return {name: base[name] + size * network(tensor(table)).numpy()[:, 0] for name, table in tables.items()}


def _lagged(joint: OutputErrorFit, o: ObservedRecording, base: Real) -> Real:
    """Present and past drive, hysteretic drive and base model's signal, shape (n, k)."""
    head = joint.base.head
    period = 1 / (head.printhead.frequency_Hz * o.excitation.step_s) if o.excitation.fast else 100.0
    hysteretic_V = o.excitation.sampled(head.plant().hysteretic_V(o.excitation.drive_at_nodes_V, o.excitation))
    columns = []
    for lag in dict.fromkeys(round(lag * period) for lag in LAGS):
        places = np.arange(o.excitation.samples) - lag
        places = places % o.excitation.samples if o.excitation.periodic else np.maximum(places, 0)
        columns += [o.excitation.drive_V[places], hysteretic_V[places], base[places]]
    return np.column_stack(columns)
