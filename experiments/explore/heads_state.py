"""State of *Heads*: the best waveform of each, and how each answers in frequency."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env import optimizers
from inkjet_env.experiments.explore.curves import Head
from inkjet_env.experiments.explore.heads import HeadShelf, NamedHead
from inkjet_env.experiments.explore.search_plan import SearchSettings, planned
from inkjet_env.experiments.explore.waveform_state import WaveformState
from inkjet_env.optimizers.loop import minimise
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import DriverLimits, PeakCost, Printhead, Waveform
from inkjet_env.typing import Real

SEARCH = SearchSettings(optimizer="cma-es", budget=2000, seed=0)
"""The search for the best waveform of each head."""
SMALL = Waveform(1.0, 0.0, 0.2e-6, 0.6e-6, 0.2e-6, 0.0, 0.0)
"""A pulse so small that a head answers it in proportion, and so short that it excites every frequency shown."""
WINDOW_S = 3e-3
HIGHEST = 4.0
"""Highest frequency shown, in resonance frequencies."""
LINES = 400


class HeadsState:
    """Best waveforms by head.

    Parameters
    ----------
    shelf : HeadShelf
        The heads.
    waveform : WaveformState
        Whose cost and driver's limits are used.
    files : Path
        Folder for dropped files.
    told : callable
        Called, from any thread, when there is something new.

    Attributes
    ----------
    best : dict of str to (Waveform, float)
        The best waveform that the search found for each head, and its cost in volts.
    """

    def __init__(self, shelf: HeadShelf, waveform: WaveformState, files: Path, told: Callable[[], object]) -> None:
        self.shelf, self.waveform, self.files, self.told = shelf, waveform, files, told
        self.best: dict[str, tuple[Waveform, float]] = {}
        self.busy = ""
        self.trouble = ""
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def drop(self, name: str, content: bytes) -> None:
        """Add the head of a dropped printhead file."""
        file = self.files / "heads" / Path(name.replace("\\", "/")).name
        if file.name in ("", ".", ".."):
            raise ValueError(f"a dropped file must have a name; got {name[:40]!r}.")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
        added = self.shelf.add(file)
        self.best.pop(added.name, None)

    def find(self) -> None:
        """Search for the best waveform of every head, in a thread."""
        if self.busy:
            raise ValueError("the search for the best waveforms is under way.")
        cost, limits = self.waveform.conditions.cost, self.waveform.limits
        heads = list(self.shelf.heads.values())
        self.busy, self.trouble = "searching", ""
        self._stop.clear()
        self._thread = threading.Thread(target=self._find, args=(heads, cost, limits), daemon=True, name="heads")
        self._thread.start()

    def _find(self, heads: list[NamedHead], cost: PeakCost, limits: DriverLimits) -> None:
        try:
            for head in heads:
                self.busy = head.name
                self.told()
                found = best_waveform(head, cost, limits, self._check)
                self.best = self.best | {head.name: found}
        except InterruptedError:
            pass
        except ValueError as error:
            self.trouble = str(error)
        self.busy = ""
        self.told()

    def _check(self, _: Any) -> None:
        if self._stop.is_set():
            raise InterruptedError

    def take(self, name: str) -> None:
        """Edit a head's best waveform in *Waveform*, on that head."""
        if name not in self.best:
            raise ValueError(f"the best waveform of {name[:40]!r} is not known yet. Search first.")
        self.waveform.change(self.best[name][0])
        self.shelf.choose(name)

    def join(self, timeout_s: float | None = 600.0) -> None:
        """Wait until the search has ended."""
        if self._thread is not None:
            self._thread.join(timeout_s)

    def close(self) -> None:
        """End the search, since the server ends."""
        self._stop.set()
        self.join(20.0)

    def as_json(self) -> dict[str, Any]:
        """The state as plain JSON values."""
        return {"best": {name: [w.to_array().tolist(), cost] for name, (w, cost) in self.best.items()}}

    def restore(self, stored: Mapping[str, Any]) -> None:
        """Take what `as_json` wrote, of heads that are still there."""
        self.best = {
            str(name): (Waveform.from_array(values), float(cost))
            for name, (values, cost) in stored["best"].items()
            if name in self.shelf.heads
        }


def best_waveform(
    head: NamedHead, cost: PeakCost, limits: DriverLimits, check: Callable[[Any], None]
) -> tuple[Waveform, float]:
    """The waveform that `SEARCH` finds for a head, and its cost; ``check`` may end it by an exception."""
    plan = planned(replace(SEARCH, head=head.name), head, cost, limits)
    optimizer = optimizers.make(plan.optimizer, budget=plan.budget, seed=plan.seed, **plan.options)
    run = minimise(plan.problem.as_measured(plan.seed), optimizer, plan.budget, on_batch=check)
    assert run.best_point is not None
    return Waveform.from_array(np.asarray(plan.problem.bounds.from_unit(run.best_point))), run.best_cost


def frequency_response(head: Head) -> tuple[Real, Real]:
    """Magnitude of a head's answer to a small change of the hysteretic drive.

    Parameters
    ----------
    head : Printhead or AugmentedPrinthead
        The head. Of the base model it is ``|b1 s / (s² + a1 s + a0)|``; with effects it is the ratio of the spectra of
        response and hysteretic drive under a pulse of 1 V.

    Returns
    -------
    frequency_Hz, magnitude : ndarray, shape (n,)
        Frequencies in hertz, and volts of response per volt.
    """
    frequency_Hz = np.linspace(head.frequency_Hz / 50, HIGHEST * head.frequency_Hz, LINES)
    if isinstance(head, Printhead):
        s = 2j * np.pi * frequency_Hz
        return frequency_Hz, np.abs(head.b1 * s / (s * s + head.a1 * s + head.a0))
    return frequency_Hz, _measured(head, frequency_Hz)


def _measured(head: AugmentedPrinthead, frequency_Hz: Real) -> Real:
    found = head.respond(SMALL, "demagnetised", window_s=WINDOW_S)
    count = 4 * found.sensor_at_steps_V.size
    lines_Hz = np.fft.rfftfreq(count, found.step_s)
    # between equal ends, so that the hysteretic drive's remanence is not a step
    pushed = np.diff(found.hysteretic_at_steps_V)
    answered = np.diff(found.sensor_at_steps_V)
    ratio = np.abs(np.fft.rfft(answered, count)) / np.maximum(np.abs(np.fft.rfft(pushed, count)), 1e-12)
    return np.interp(frequency_Hz, lines_Hz, ratio)
