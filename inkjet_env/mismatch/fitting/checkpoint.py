"""Finished fits of a diagnosis, kept in a folder, so that an interrupted diagnosis resumes where it stopped.

The name of a fit's file is a digest of its inputs: recordings, noise, effects, starting point and the code itself. The
file holds the parameters at which the fit ended; simulating once more at them restores the fit bit for bit.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.effect_code import code_digest, source_files
from inkjet_env.mismatch.fitting.fit_result import FitResult, ModelState
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.plant import Effect
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.printhead import Printhead
from inkjet_env.storage import write_json

Task = TypeVar("Task")


class FitCheckpoint:
    """A folder of finished fits; without a folder none is kept.

    Parameters
    ----------
    folder : str or Path, optional
        Created when the first fit is kept.
    effects : sequence of Effect
        Effects whose code, like this package's own, determines the result of a fit.
    """

    def __init__(self, folder: str | os.PathLike[str] | None = None, effects: Sequence[Effect] = ()) -> None:
        self.folder = None if folder is None else Path(folder)
        self.code = b""
        if self.folder is not None:
            files = {str(path) for path in Path(__file__).parents[2].rglob("*.py")}
            files |= {file for effect in effects for file in source_files(effect)}
            self.code = _digest(*(Path(file).read_bytes() for file in sorted(files)), *map(code_digest, effects))

    def fits(
        self, pool: ProcessPool, joint: OutputErrorFit, function: Callable[[Task], FitResult | None],
        tasks: Sequence[Task],
        questions: Sequence[tuple[ActiveEffects, FitResult, int | str | None]],
    ) -> Iterator[FitResult | None]:  # fmt: skip
        """`ProcessPool.map`, except that fits already kept are read; each new fit is kept as soon as it is finished.

        Parameters
        ----------
        pool : ProcessPool
            Processes that the missing fits run on.
        joint : OutputErrorFit
            Recordings, noise and base model that all these fits share.
        function : callable
            Maps a task to its fit, or to None if it cannot be simulated.
        tasks : sequence
            Arguments of ``function``, one for each fit.
        questions : sequence of tuple
            Inputs that identify each task: effects with their starting coordinates, the fit to continue from, and the
            largest number of steps or another distinguishing mark.
        """
        if self.folder is None:
            yield from pool.map(function, tasks)
            return
        begun = _of_joint(joint)
        names = [self._name(begun, *question) for question in questions]
        there = [self._found(name, active.effects) for name, (active, *_) in zip(names, questions, strict=True)]
        missing = pool.map(function, [task for task, record in zip(tasks, there, strict=True) if record is None])
        for name, record, (active, *_) in zip(names, there, questions, strict=True):
            if record is None:
                fit = next(missing)
                self.folder.mkdir(parents=True, exist_ok=True)
                write_json(self.folder / name, {"fit": None if fit is None else _as_json(fit)})
            else:
                written = record["fit"]
                fit = None if written is None else joint.again(*_from_json(written, active.effects))
            yield fit

    def clear(self) -> None:
        """Delete the fits, and the folder too if nothing else is in it."""
        if self.folder is not None and self.folder.is_dir():
            for file in self.folder.glob("*.fit.json"):
                file.unlink()
            if not any(self.folder.iterdir()):
                self.folder.rmdir()

    def _name(self, begun: bytes, active: ActiveEffects, fit: FitResult, steps: int | str | None) -> str:
        ids = "+".join(active.ids)
        place = json.dumps(_state_json(replace(fit.end, active=active)))
        return _digest(self.code, begun, ids.encode(), place.encode(), str(steps).encode()).hex()[:32] + ".fit.json"

    def _found(self, name: str, effects: tuple[Effect, ...]) -> dict[str, Any] | None:
        if self.folder is None or not (self.folder / name).is_file():
            return None
        try:
            record: dict[str, Any] = json.loads((self.folder / name).read_text())
            if record["fit"] is not None:
                _from_json(record["fit"], effects)
        except (OSError, ValueError, TypeError, LookupError, AttributeError):
            return None  # it is not as it was written: the fit is made anew
        return record


def _digest(*parts: bytes) -> bytes:
    sha = hashlib.sha256()
    for part in parts:
        sha.update(len(part).to_bytes(8, "little"))
        sha.update(part)
    return sha.digest()


def _of_joint(joint: OutputErrorFit) -> bytes:
    """Digest of everything that a fit depends on apart from its question."""
    parts = []
    for o in joint.observed:
        excitation = o.excitation
        written = (
            o.name,
            o.channel,
            o.condition,
            o.fitted,
            excitation.initial_state,
            excitation.step_s,
            excitation.order,
            excitation.substeps,
        )
        signals = [o.measured, excitation.drive_V] + (
            [] if excitation.neighbour_V is None else [excitation.neighbour_V]
        )
        parts += [repr(written).encode(), *(np.ascontiguousarray(signal).tobytes() for signal in signals)]
    for key, model in sorted(joint.noise.models.items()):
        parts.append(repr((key, list(model.coefficients), model.innovation, model.bands)).encode())
    parts += [part for name, level in sorted(joint.noise.levels.items()) for part in (name.encode(), level.tobytes())]
    parts.append(repr(sorted(joint.noise.offsets.items())).encode())
    random_effects = [(effect.id, dict(values)) for effect, values in joint.random_effects]
    around = None if joint.around is None else (joint.around.ids, _as_json(joint.around))
    begun = (_head_json(joint.start), _as_json(joint.base), random_effects, around, joint.settings)
    parts.append(repr(begun).encode())
    return _digest(*parts)


def _head_json(head: Head) -> dict[str, Any]:
    p = head.printhead
    return {
        "a0": float(p.a0),
        "a1": float(p.a1),
        "b1": float(p.b1),
        "coefficients": [float(c) for c in p.coefficients],
        "full_scale_V": float(p.full_scale_V),
        "gains": {channel: float(v) for channel, v in head.gains.items()},
        "offsets": {channel: float(v) for channel, v in head.offsets.items()},
    }


def _head(written: Mapping[str, Any]) -> Head:
    law = tuple(written["coefficients"])
    return Head(
        Printhead(written["a0"], written["a1"], written["b1"], law, written["full_scale_V"]),
        written["gains"],
        written["offsets"],
    )


def _state_json(state: ModelState) -> dict[str, Any]:
    states = {name: [float(v) for v in pair] for name, pair in state.states.items()}
    return {"head": _head_json(state.head), "point": [float(v) for v in state.active.theta], "states": states}


def _state(written: Mapping[str, Any], effects: tuple[Effect, ...]) -> ModelState:
    states = {name: (pair[0], pair[1]) for name, pair in written["states"].items()}
    return ModelState(_head(written["head"]), ActiveEffects(effects, np.array(written["point"], dtype=float)), states)


def _as_json(fit: FitResult) -> dict[str, Any]:
    return {
        "end": _state_json(fit.end),
        "sloped": _state_json(fit.jacobian_at),
        "started": _head_json(fit.started),
        "converged": fit.converged,
        "whole": fit.whole,
    }


def _from_json(
    written: Mapping[str, Any], effects: tuple[Effect, ...]
) -> tuple[ModelState, ModelState, Head, bool, bool]:
    started = _head(written["started"])
    end, jacobian_at = _state(written["end"], effects), _state(written["sloped"], effects)
    return end, jacobian_at, started, bool(written["converged"]), bool(written["whole"])
