"""Execution of jobs by processes on this machine.

Each process is an executor of its own, so that it is known which job a killed process had begun: that job alone is
repeated. Where the system allows it, processes are copies of one that has imported the modules and loaded the compiled
code, so that a further process starts within milliseconds.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import connection
from typing import Any

from inkjet_env.experiments.execution.jobs import ONE_THREAD, TRIES, ClusterError, WorkLostError

SECONDS_TO_CLEAN_UP = 5.0
"""Time that a process has to delete its temporary folders after its parent has ended."""
ENDED_ITSELF = "the process that did it ended"


class LocalProcesses:
    """Processes on this machine that end with this one, and leave Ctrl-C to it.

    Parameters
    ----------
    count : int
        Number of processes, at least 1.
    preload : sequence of str
        Modules that a process imports before its first job, if the system can copy a process that has.
    """

    def __init__(self, count: int, preload: Sequence[str] = ()) -> None:
        self.count = count
        fork = "forkserver" in multiprocessing.get_all_start_methods()
        self._context = multiprocessing.get_context("forkserver" if fork else "spawn")
        self._workers: list[_Worker | None] = [None] * count
        if fork:
            multiprocessing.set_forkserver_preload(list(preload))
            with _with_environment(ONE_THREAD), _deaf_to_ctrl_c():
                from multiprocessing import forkserver

                forkserver.ensure_running()

    def __enter__(self) -> LocalProcesses:
        """Wait until the first process is ready; all others are copies like it, or start meanwhile."""
        try:
            self._worker(0).ready()
        except (BrokenProcessPool, EOFError, OSError) as error:
            raise ClusterError(
                f"no process could be started ({error}). A script must start them below __main__."
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            if worker is not None:
                worker.end()

    def run_each(
        self,
        function: Callable[..., Any],
        jobs: Mapping[str, Callable[[], tuple[Any, ...]]],
        keep: Callable[[str, Any], None],
    ) -> None:
        """Call a function for every job; see `inkjet_env.experiments.execution.cluster.run_each`."""
        waiting, begun = list(jobs)[::-1], Counter[str]()
        idle, running = list(range(self.count))[::-1], dict[Future[Any], tuple[str, int]]()
        try:
            while waiting or running:
                while waiting and idle:
                    name, number = waiting.pop(), idle.pop()
                    begun[name] += 1
                    running[self._worker(number).pool.submit(_performed, function, *jobs[name]())] = name, number
                failure: Exception | None = None
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    name, number = running.pop(future)
                    idle.append(number)
                    try:
                        keep(name, future.result())
                    except (BrokenProcessPool, WorkLostError) as error:
                        broken = isinstance(error, BrokenProcessPool)
                        if broken:
                            self._end(number)
                        if begun[name] < TRIES:
                            waiting.append(name)
                        else:
                            reason = ENDED_ITSELF if broken else str(error)
                            failure = failure or ClusterError(
                                f"{name} was started {TRIES} times and never ended: {reason}. It may need more memory "
                                "than there is: use fewer --workers."
                            )
                    except Exception as error:
                        failure = failure or error
                if failure is not None:  # only after the results of all others are kept
                    raise failure
        finally:
            for _, number in running.values():
                self._end(number)

    def _worker(self, number: int) -> _Worker:
        worker = self._workers[number]
        if worker is None:
            with _deaf_to_ctrl_c():
                worker = self._workers[number] = _Worker(self._context)
        return worker

    def _end(self, number: int) -> None:
        """End a process at once, whatever it is doing; the next job starts another."""
        worker, self._workers[number] = self._workers[number], None
        if worker is not None:
            worker.kill()


class _Worker:
    """An executor with one process."""

    def __init__(self, context: Any) -> None:
        self.pool = ProcessPoolExecutor(1, context, _begin)
        self._id = self.pool.submit(os.getpid)

    def ready(self) -> None:
        """Wait until the process can work."""
        self._id.result()

    def end(self) -> None:
        """End the process after its job."""
        self.pool.shutdown()

    def kill(self) -> None:
        """End the process at once."""
        with suppress(BrokenProcessPool, ProcessLookupError):  # it has ended
            os.kill(self._id.result(), signal.SIGTERM)
        self.pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """Prepare a new process: one thread, deaf to Ctrl-C; it cleans up when ended, and ends with its parent."""
    import threadpoolctl

    os.environ.update(ONE_THREAD)
    threadpoolctl.threadpool_limits(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end_cleanly)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        connection.wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(SECONDS_TO_CLEAN_UP)
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


def _performed(function: Callable[..., Any], *arguments: Any) -> Any:
    """Result of a job; the process ends where a signal ends the job, as it would without clean-up."""
    try:
        return function(*arguments)
    except SystemExit:
        os._exit(1)


def _end_cleanly(number: int, _: object) -> None:
    """Handler of a signal: leaves every context, which deletes temporary folders and ends their processes."""
    sys.exit(128 + number)


@contextmanager
def _with_environment(variables: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Processes started within this context ignore Ctrl-C and leave it to this one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
