"""Policies: networks from an observation of a head to a waveform, stored as arrays and a header without code."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkjet_env.envs.task import CONTEXT_NAMES
from inkjet_env.extras import extra
from inkjet_env.printhead import check_name
from inkjet_env.printhead.waveform import PARAMETER_NAMES
from inkjet_env.storage import archive_bytes, write_atomically
from inkjet_env.typing import Real

POLICY_FORMAT = "policy/1"
ENDS = ("clip", "tanh")
MOST_LAYERS, MOST_UNITS = 16, 4096


class PolicyFileError(ValueError):
    """A file does not hold a policy, or one for other observations; the message names it."""


@contextlib.contextmanager
def policy_file_errors(path: str | os.PathLike[str], written_by: str) -> Iterator[None]:
    """What goes wrong inside while a policy is read, as a `PolicyFileError` that names the file."""
    try:
        yield
    except FileNotFoundError:
        raise PolicyFileError(f"{path}: there is no such file. Give a file that {written_by} wrote.") from None
    except (
        ValueError, KeyError, TypeError, AttributeError, EOFError, OSError, RecursionError, zipfile.BadZipFile,
        NotImplementedError,
    ) as error:  # fmt: skip
        reason = "it holds pickled objects, which are never loaded" if "pickle" in str(error) else error
        raise PolicyFileError(
            f"{path}: is not a policy ({str(reason).rstrip('.') or type(error).__name__}). Give a file that "
            f"{written_by} wrote."
        ) from None


@dataclass(frozen=True, eq=False)
class Policy:
    """A network from an observation to an action.

    Parameters
    ----------
    weights : tuple of ndarray, shape (out, in) each
        Weight matrix of each layer, in order.
    biases : tuple of ndarray, shape (out,) each
        Bias of each layer.
    end : {"clip", "tanh"}
        How the output of the last layer is confined to ``[-1, 1]``. Hidden layers end in tanh.
    made : dict
        How it was made, as plain JSON values.
    observation : tuple of str
        Name of each number of an observation; by default the four of `BipolarWaveformEnv` with
        ``context="random"``.
    """

    weights: tuple[Real, ...]
    biases: tuple[Real, ...]
    end: str
    made: Mapping[str, Any]
    observation: tuple[str, ...] = CONTEXT_NAMES

    def __post_init__(self) -> None:
        check_name("end", self.end, ENDS)
        sizes = [len(self.observation), *(len(bias) for bias in self.biases)]
        wanted = [(b, a) for a, b in itertools.pairwise(sizes)]
        found = [weight.shape for weight in self.weights]
        if found != wanted or sizes[-1] != len(PARAMETER_NAMES):
            raise ValueError(
                f"a policy must map {len(self.observation)} numbers to {len(PARAMETER_NAMES)}; its layers are {found}, "
                f"with {sizes[1:]} biases."
            )
        if not all(np.isfinite(part).all() for part in (*self.weights, *self.biases)):
            raise ValueError("a policy's weights must be finite; one is not.")

    def act(self, observations: ArrayLike) -> Real:
        """Actions in ``[-1, 1]``, shape (n, 7), for observations, shape (n, len(observation))."""
        x = np.atleast_2d(np.asarray(observations, dtype=np.float64))
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.tanh(x @ weight.T + bias)
        x = x @ self.weights[-1].T + self.biases[-1]
        actions: Real = np.tanh(x) if self.end == "tanh" else np.clip(x, -1.0, 1.0)
        return actions

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the policy atomically, as an archive of arrays with a JSON header."""
        header = {
            "format": POLICY_FORMAT,
            "observation": list(self.observation),
            "action": list(PARAMETER_NAMES),
            "layers": [list(weight.shape) for weight in self.weights],
            "end": self.end,
            "made": dict(self.made),
        }
        arrays: dict[str, NDArray[Any]] = {"header": np.array(json.dumps(header))}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"weight{k}": weight, f"bias{k}": bias}
        write_atomically(path, archive_bytes(arrays))

    @classmethod
    def load(cls, path: str | os.PathLike[str], observation: Sequence[str] = CONTEXT_NAMES) -> Policy:
        """Read a policy for these observations that `save` wrote; no code from the file is executed.

        Raises
        ------
        PolicyFileError
            The file is missing or is not such a policy; the message names it and the reason.
        """
        with policy_file_errors(path, "Policy.save"), np.load(Path(path), allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            if header.get("format") != POLICY_FORMAT:
                raise ValueError(f"its format is {header.get('format')!r}, not {POLICY_FORMAT!r}")
            if header["observation"] != list(observation) or header["action"] != list(PARAMETER_NAMES):
                raise ValueError("it was made for other observations or actions")
            layers = header["layers"]
            if not 1 <= len(layers) <= MOST_LAYERS or max(max(layer) for layer in layers) > MOST_UNITS:
                raise ValueError(f"its layers are {layers}")
            weights, biases = (
                tuple(archive[f"{part}{k}"].astype(np.float64, casting="safe") for k in range(len(layers)))
                for part in ("weight", "bias")
            )
            return cls(weights, biases, header["end"], header["made"], tuple(observation))


def policy_of_layers(
    layers: Sequence[Any], end: str, made: Mapping[str, Any], observation: Sequence[str] = CONTEXT_NAMES
) -> Policy:
    """A policy from torch's linear layers, in order; the activations between them must be tanh."""
    weights = tuple(layer.weight.detach().double().numpy().copy() for layer in layers)
    biases = tuple(layer.bias.detach().double().numpy().copy() for layer in layers)
    return Policy(weights, biases, end, made, tuple(observation))


def policy_of_sb3(model: Any, made: Mapping[str, Any], observation: Sequence[str] = CONTEXT_NAMES) -> Policy:
    """The deterministic policy of a trained Stable-Baselines3 PPO or SAC, which must use tanh activations."""
    with extra("learning"):
        from stable_baselines3 import PPO, SAC
        from torch import nn

    if isinstance(model, PPO):
        actor = model.policy
        layers, end = [*actor.mlp_extractor.policy_net, actor.action_net], "clip"
    elif isinstance(model, SAC):
        layers, end = [*model.actor.latent_pi, model.actor.mu], "tanh"
    else:
        raise ValueError(f"model must be a PPO or a SAC; got {type(model).__name__}.")
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    if any(not isinstance(layer, (nn.Linear, nn.Tanh)) for layer in layers):
        raise ValueError("a policy's hidden layers must use tanh: pass activation_fn=torch.nn.Tanh.")
    return policy_of_layers(linear, end, made, observation)
