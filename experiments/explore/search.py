"""A search that runs beside the page: it can be watched, paused, resumed and stopped, and outlives the server."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env import optimizers
from inkjet_env.experiments.benchmark.single_run import Optimisation, RunningRecord, read_record, write_record
from inkjet_env.optimizers.loop import Run, minimise
from inkjet_env.printhead import Waveform

TOLD_EVERY_S = 0.15
"""Shortest time between two pictures of a run, in seconds."""
BREATH_EVERY_S, BREATH_S = 0.01, 0.001
"""How often, and for how long, a search waits so that the page is served, in seconds."""

RUNNING, PAUSED, STOPPED, DONE, FAILED = "running", "paused", "stopped", "done", "failed"


class _StopSearch(Exception):
    """Ends the loop of a search that is to stop."""


@dataclass(frozen=True)
class Progress:
    """A search as it stands.

    Attributes
    ----------
    state : str
        running, paused, stopped, done or failed.
    evaluations, budget : int
        Number of evaluations made, and of all.
    best_cost : float
        Lowest cost so far in volts; infinite before the first.
    best : Waveform or None
        The waveform that has it.
    history : list of [evaluations, cost]
        Lowest cost after each improvement.
    failure : str
        Why it failed, in a sentence.
    """

    state: str
    evaluations: int
    budget: int
    best_cost: float = float("inf")
    best: Waveform | None = None
    history: list[list[float]] = field(default_factory=list)
    failure: str = ""

    def as_json(self) -> dict[str, Any]:
        """The progress as plain JSON values; null for a cost that is not known yet."""
        return {
            "state": self.state,
            "evaluations": self.evaluations,
            "budget": self.budget,
            "best_cost": None if self.best is None else self.best_cost,
            "best": None if self.best is None else self.best.to_array().tolist(),
            "history": self.history,
            "failure": self.failure,
        }

    @classmethod
    def from_json(cls, stored: Mapping[str, Any]) -> Progress:
        """The progress that `as_json` wrote."""
        best = None if stored["best"] is None else Waveform.from_array(stored["best"])
        cost = float("inf") if stored["best_cost"] is None else float(stored["best_cost"])
        history = [[int(n), float(v)] for n, v in stored["history"]]
        return cls(
            str(stored["state"]), int(stored["evaluations"]), int(stored["budget"]), cost, best, history,
            str(stored["failure"]),
        )  # fmt: skip


class Search:
    """One optimisation in a thread of its own.

    Parameters
    ----------
    plan : Optimisation
        What is carried out, evaluation for evaluation as ``inkjet optimize`` does.
    record : Path
        File of the evaluations, from which a search that was interrupted resumes exactly.
    told : callable
        Called from the thread whenever there is something new.
    recorded : tuple of ndarray, optional
        The evaluations that the record holds.
    """

    def __init__(
        self, plan: Optimisation, record: Path, told: Callable[[], object], recorded: tuple | None = None
    ) -> None:
        self.plan, self.record, self.told, self.recorded = plan, record, told, recorded
        self._go, self._stop = threading.Event(), threading.Event()
        self._writing = threading.Lock()
        self._thread: threading.Thread | None = None
        self._due_s = 0.0
        self.run: Run | None = None
        self.progress = Progress(PAUSED, 0, plan.budget)
        if recorded is not None:
            gradients = recorded[2] if len(recorded) > 2 else None
            self._show(Run(recorded[0], recorded[1], gradients, False, 0.0, 0.0), PAUSED)

    @classmethod
    def from_record(cls, record: Path, told: Callable[[], object]) -> Search:
        """The paused search that a record holds; ``ValueError`` if it is damaged."""
        plan, recorded = read_record(record)
        return cls(plan, record, told, recorded)

    def start(self) -> None:
        """Begin, or go on after `pause`."""
        if self.progress.state not in (PAUSED, RUNNING):
            return
        self.progress = self._with(RUNNING)
        self._go.set()
        if self._thread is None:
            self._thread = threading.Thread(target=self._carry_out, daemon=True, name="search")
            self._thread.start()

    def pause(self) -> None:
        """Wait after the batch that is under way."""
        if self.progress.state == RUNNING:
            self._go.clear()
            self.progress = self._with(PAUSED)

    def stop(self) -> None:
        """End after the batch that is under way; what was found stays."""
        if self.progress.state in (RUNNING, PAUSED):
            self._stop.set()
            self._go.set()
            if self._thread is None:
                self.progress = self._with(STOPPED)
                self.record.unlink(missing_ok=True)

    def join(self, timeout_s: float = 60.0) -> None:
        """Wait until the thread has ended."""
        if self._thread is not None:
            self._thread.join(timeout_s)

    def save(self) -> None:
        """Write the record of a search that has not ended, so that it can be resumed exactly."""
        run = self.run
        if self.progress.state in (RUNNING, PAUSED) and run is not None and run.evaluations:
            with self._writing:
                write_record(self.record, self.plan, run)

    def _carry_out(self) -> None:
        replayed = 0 if self.recorded is None else len(self.recorded[1])
        keep = RunningRecord(self.record, self.plan, replayed)
        breath_s = 0.0

        def made(run: Run) -> None:
            nonlocal breath_s
            if run.evaluations < replayed:
                return
            self.run = run
            with self._writing:
                keep(run)
            if time.monotonic() >= self._due_s:
                self._show(run, self.progress.state)
                self._due_s = time.monotonic() + TOLD_EVERY_S
                self.told()
            if not self._go.is_set():
                self._show(run, PAUSED)
                self.save()
                self.told()
                self._go.wait()
            if self._stop.is_set():
                raise _StopSearch
            if time.monotonic() >= breath_s:
                time.sleep(BREATH_S)
                breath_s = time.monotonic() + BREATH_EVERY_S

        try:
            plan = self.plan
            optimizer = optimizers.make(plan.optimizer, budget=plan.budget, seed=plan.seed, **plan.options)
            objective = plan.problem.as_measured(plan.seed, replayed)
            run = minimise(objective, optimizer, plan.budget, recorded=self.recorded, on_batch=made)
            self._show(run, DONE)
        except _StopSearch:
            if self.run is not None:
                self._show(self.run, STOPPED)
        except Exception as error:
            self.progress = self._with(FAILED, str(error) or type(error).__name__)
        self.record.unlink(missing_ok=True)
        self.told()

    def _show(self, run: Run, state: str) -> None:
        self.run = run
        if run.best_point is None:
            return
        best = Waveform.from_array(np.asarray(self.plan.problem.bounds.from_unit(run.best_point)))
        self.progress = Progress(state, run.evaluations, self.plan.budget, run.best_cost, best, run.history)

    def _with(self, state: str, failure: str = "") -> Progress:
        now = self.progress
        return Progress(state, now.evaluations, now.budget, now.best_cost, now.best, now.history, failure)
