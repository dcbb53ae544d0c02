"""A policy that tunes a head from all that was read of it: a small recurrent network, stored as numbers with a header.

A gated recurrent unit follows the observations of ``inkjet_env/TuneWaveform-v0``. Its state gives an estimate of the
head's four parameters, some steps away from the waveform that is kept, and a score of each step and of each waveform of
a list. What has the highest score is fired: the kept waveform after the step, or the waveform of the list after a
correction, which is a cubic polynomial of the estimate, and stretched to the estimated period. The first waveform is
the same for all heads: one whose peaks tell much of a head. It runs without PyTorch and without a simulator;
`inkjet_env.experiments.learning.recurrent_training` trains it.
"""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from inkjet_env.envs.tune_waveform import PEAKS
from inkjet_env.envs.waveform_tuning_task import PEAK_SCALE_V, TIME_SCALE_S
from inkjet_env.experiments.learning.few_shot_tuners import MIDDLE
from inkjet_env.experiments.learning.heads import PARAMETERS, stretched
from inkjet_env.experiments.learning.policies import policy_file_errors
from inkjet_env.printhead.waveform import PARAMETER_NAMES
from inkjet_env.storage import archive_bytes, write_atomically
from inkjet_env.typing import Real

FORMAT = "recurrent-policy/2"
SHIPPED = Path(__file__).with_name("recurrent_policy.npz")
"""The policy that comes with the package."""
READ = 2 + 2 * len(PARAMETER_NAMES)
"""Numbers of an observation before its peaks, the waveform that is kept last."""
KEPT = slice(READ - len(PARAMETER_NAMES), READ)
FEATURES = READ + 6 * PEAKS - 2
FACTORS = np.array([*itertools.combinations_with_replacement(range(PARAMETERS + 1), 3)])
"""Factors of each term of a cubic polynomial of the estimate: 0 is 1, and k the k-th parameter."""
FARTHEST = 1.5
"""Magnitude at which an estimate is clipped: 1 is the end of the range of drawn heads."""
USUAL_STEP_S, LOWEST_PEAK_V = 10e-6, 0.01
"""Time between two peaks that is 0 as a feature, and the height below which logarithms end."""
MOST = 1024
"""Largest number of units, waveforms and steps that is accepted."""


def features(observations: ArrayLike) -> Real:
    """What the network is shown of observations: also the peaks' distances and the logarithms of their heights.

    Parameters
    ----------
    observations : array_like, shape (n, 16 + 2 peaks)
        As the environment gives them, with its default number of peaks.

    Returns
    -------
    ndarray, shape (n, FEATURES)
    """
    shown = np.atleast_2d(np.asarray(observations, dtype=np.float64))
    if shown.shape[1] != READ + 2 * PEAKS:
        raise ValueError(f"a recurrent policy needs observations of {PEAKS} peaks; got shape {shown.shape}.")
    heights, times = shown[:, READ : READ + PEAKS], shown[:, READ + PEAKS :]
    there = (times > 0).astype(np.float64)
    both = there[:, 1:] * there[:, :-1]
    logs = np.log(np.maximum(np.abs(heights) * PEAK_SCALE_V, LOWEST_PEAK_V))
    steps = np.diff(times, axis=1) * TIME_SCALE_S / USUAL_STEP_S - 1
    parts = (
        shown[:, :READ], heights, 2 * times, there, both * steps, there * logs / 2, both * np.diff(logs, axis=1),
    )  # fmt: skip
    return np.concatenate(parts, axis=1)


def terms(estimates: Real) -> Real:
    """Terms of a cubic polynomial of estimates, shape (n, 4): shape (n, 35), the constant first."""
    return np.concatenate([np.ones((len(estimates), 1)), estimates], axis=1)[:, FACTORS].prod(axis=2)


def shapes(units: int, waveforms: int, steps: int) -> dict[str, tuple[int, ...]]:
    """Shape of each array of a policy with so many units, waveforms and steps."""
    return {
        "first": (len(PARAMETER_NAMES),),
        "encoder": (units, FEATURES),
        "encoder_bias": (units,),
        "input_gates": (3 * units, units),
        "input_gates_bias": (3 * units,),
        "state_gates": (3 * units, units),
        "state_gates_bias": (3 * units,),
        "estimate": (PARAMETERS, units),
        "estimate_bias": (PARAMETERS,),
        "score": (waveforms + steps, units),
        "score_bias": (waveforms + steps,),
        "corrections": (waveforms, len(FACTORS), len(PARAMETER_NAMES)),
        "steps": (steps * len(PARAMETER_NAMES), units),
        "steps_bias": (steps * len(PARAMETER_NAMES),),
    }


@dataclass(frozen=True, eq=False)
class RecurrentPolicy:
    """A recurrent network from the observations of a head to the waveform to fire next.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        The first waveform, weights and biases, with the names and shapes of `shapes`. The gates are those of
        `torch.nn.GRU`, in its order: reset, update, new. Corrections are in units of the box, from no drive for the
        middle head; their constant terms are the waveforms of the list. Steps are in the same units. Scores are those
        of the list, then those of the steps.
    made : mapping
        How it was made, as plain JSON values.
    """

    arrays: Mapping[str, Real]
    made: Mapping[str, Any]

    def __post_init__(self) -> None:
        counts = (
            len(self.arrays["encoder_bias"]),
            len(self.arrays["corrections"]),
            len(self.arrays["steps_bias"]) // len(PARAMETER_NAMES),
        )
        if not all(1 <= count <= MOST for count in counts):
            raise ValueError(f"a policy must have 1 to {MOST} units, waveforms and steps each; got {counts}.")
        found, asked = {name: value.shape for name, value in self.arrays.items()}, shapes(*counts)
        if found != asked:
            raise ValueError(f"a policy's arrays must have the shapes {asked}; got {found}.")
        if not all(np.isfinite(value).all() for value in self.arrays.values()):
            raise ValueError("a policy's weights must be finite; one is not.")

    def act(self, observations: ArrayLike, state: Real | None = None) -> tuple[Real, Real]:
        """The next waveform of each head, and the state to hand over with the next observations.

        Parameters
        ----------
        observations : array_like, shape (n, 16 + 2 peaks)
            As the environment gives them.
        state : ndarray, shape (n, units), optional
            What was returned with the waveforms fired last; None before the first try.

        Returns
        -------
        actions : ndarray, shape (n, 7)
            In ``[-1, 1]``.
        state : ndarray, shape (n, units)
        """
        shown = features(observations)
        if state is None:
            state = np.zeros((len(shown), len(self.arrays["encoder_bias"])))
        entered = np.tanh(self._layer("encoder", shown))
        by_input = np.split(self._layer("input_gates", entered), 3, axis=1)
        by_state = np.split(self._layer("state_gates", state), 3, axis=1)
        reset, update = (expit(a + b) for a, b in zip(by_input[:2], by_state[:2], strict=True))
        new = np.tanh(by_input[2] + reset * by_state[2])
        state = (1 - update) * new + update * state
        estimates = np.clip(self._layer("estimate", state), -FARTHEST, FARTHEST)
        chosen, corrections = self._layer("score", state).argmax(axis=1), self.arrays["corrections"]
        listed = chosen < len(corrections)
        points = np.einsum("nt,ntk->nk", terms(estimates), corrections[np.where(listed, chosen, 0)])
        steps = self._layer("steps", state).reshape(len(shown), -1, len(PARAMETER_NAMES))
        step = steps[np.arange(len(shown)), np.where(listed, 0, chosen - len(corrections))]
        actions = np.where(
            listed[:, None], stretched(points, MIDDLE, estimates), np.clip(shown[:, KEPT] + step, -1.0, 1.0)
        )
        actions[shown[:, 0] == 0] = self.arrays["first"]
        return actions, state

    def _layer(self, name: str, values: Real) -> Real:
        return np.asarray(values @ self.arrays[name].T + self.arrays[f"{name}_bias"])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the policy atomically, as an archive of arrays in single precision with a JSON header."""
        header = {"format": FORMAT, "action": list(PARAMETER_NAMES), "peaks": PEAKS, "made": dict(self.made)}
        arrays: dict[str, NDArray[Any]] = {"header": np.array(json.dumps(header))}
        write_atomically(path, archive_bytes(arrays | {k: v.astype(np.float32) for k, v in self.arrays.items()}))

    @classmethod
    def load(cls, path: str | os.PathLike[str] = SHIPPED) -> RecurrentPolicy:
        """Read a policy that `save` wrote, or the one that comes with the package; no code from the file is executed.

        Raises
        ------
        PolicyFileError
            The file is missing or is not such a policy; the message names it and the reason.
        """
        with policy_file_errors(path, "RecurrentPolicy.save"), np.load(Path(path), allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            if header.get("format") != FORMAT:
                raise ValueError(f"its format is {header.get('format')!r}, not {FORMAT!r}")
            if header["action"] != list(PARAMETER_NAMES) or header["peaks"] != PEAKS:
                raise ValueError("it was made for other observations or actions")
            arrays = {name: archive[name].astype(np.float64, casting="safe") for name in shapes(1, 1, 1)}
            return cls(arrays, header["made"])


class RecurrentTuner:
    """Tunes n heads in parallel with a recurrent policy.

    Parameters
    ----------
    policy : RecurrentPolicy, optional
        By default the one that comes with the package.
    """

    def __init__(self, policy: RecurrentPolicy | None = None) -> None:
        self.policy = policy or RecurrentPolicy.load()
        self.state: Real | None = None

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The policy's next waveform for each head, shape (n, 7); zero tries made mean that all heads are new."""
        if not observations[:, 0].any():
            self.state = None
        actions, self.state = self.policy.act(observations, self.state)
        return actions

    def tell(self, readings: Real) -> None:
        """Do nothing: the readings are part of the next observation."""
