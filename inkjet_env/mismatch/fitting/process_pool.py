"""Work on several processes that start with all of the caller's memory: only the results are copied back."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

from inkjet_env.processes import end_with_parent

Task = TypeVar("Task")
Result = TypeVar("Result")

_job: tuple[Callable[[Any], Any], Sequence[Any]] | None = None


class ProcessPool:
    """A fixed number of processes if the system can fork; otherwise tasks run one after another.

    Threads would only take turns, because a simulation is mostly many short calls.

    Parameters
    ----------
    workers : int
        Number of processes, at least 1.
    """

    def __init__(self, workers: int) -> None:
        if workers < 1:
            raise ValueError(f"workers must be at least 1; got {workers}.")
        self.workers = workers if "fork" in multiprocessing.get_all_start_methods() else 1

    def map(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Iterator[Result]:
        """Results in the order of the tasks, each as soon as it is ready.

        Processes see everything that tasks and function refer to as it is at the time of the call.
        """
        global _job
        if self.workers == 1 or len(tasks) < 2:
            yield from map(function, tasks)
            return
        _job = (function, tasks)
        workers, fork = min(self.workers, len(tasks)), multiprocessing.get_context("fork")
        pool = ProcessPoolExecutor(workers, fork, initializer=end_with_parent, initargs=(os.getpid(),))
        try:
            yield from pool.map(_done, range(len(tasks)))
        finally:
            pool.shutdown(cancel_futures=True)
            _job = None


def _done(place: int) -> Any:
    if _job is None:
        raise RuntimeError("a worker began without its job.")
    function, tasks = _job
    return function(tasks[place])
