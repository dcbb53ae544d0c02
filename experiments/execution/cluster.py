"""Execution of jobs on a Dask cluster, or by processes on this machine; the work of a lost worker is repeated."""

from __future__ import annotations

import math
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from inkjet_env.experiments.execution.jobs import TRIES, ClusterError, WorkLostError
from inkjet_env.experiments.execution.local_processes import LocalProcesses
from inkjet_env.extras import extra

IN_FLIGHT_A_WORKER = 2
POLL_S = 0.1
COUNT_EVERY_S = 0.5
SAY_WAITING_AFTER_S = 10.0
CONNECT_S = 15.0


@contextmanager
def workers_of(scheduler: str | None, workers: int | None, preload: Sequence[str] = ()) -> Iterator[Any]:
    """A Dask client of the cluster at an address, or processes on this machine, which end with the block.

    Parameters
    ----------
    scheduler : str or None
        Address of the cluster, such as ``tcp://host:8786``; None for local processes.
    workers : int or None
        Number of local processes if there is no scheduler; the number of cores if None.
    preload : sequence of str
        Modules that local processes have imported when they start, where the system can copy processes.

    Raises
    ------
    ClusterError
        No scheduler answers at the address.
    """
    if scheduler is None:
        with LocalProcesses(workers or os.cpu_count() or 1, preload) as processes:
            yield processes
        return
    with extra("a Dask cluster"):
        import dask
        from distributed import Client
        from distributed.comm import get_address_host_port

    settings = {
        "distributed.scheduler.allowed-failures": 0,  # `run_each` restarts jobs itself, and counts
        "distributed.comm.timeouts.connect": f"{CONNECT_S}s",
    }
    with dask.config.set(settings):
        try:
            # connect first: a client without a scheduler keeps trying even after it is discarded
            socket.create_connection(get_address_host_port(scheduler), CONNECT_S).close()
            client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"no Dask scheduler answers at {scheduler} ({error}). Start one, or leave out --scheduler."
            ) from None
        with client:
            yield client


def run_each(
    client: Any,
    function: Callable[..., Any],
    jobs: Mapping[str, Callable[[], tuple[Any, ...]]],
    keep: Callable[[str, Any], None],
) -> None:
    """Call a function for every job, and keep each result as it arrives.

    Parameters
    ----------
    client : distributed.Client or LocalProcesses
        What `workers_of` gives.
    function : callable
        Function of a module that the workers can import.
    jobs : mapping of str to callable
        By the job's name, a function that makes the arguments when the job's turn comes.
    keep : callable
        Called in this process with name and result, once per job.

    Raises
    ------
    ClusterError
        The scheduler is gone, or `TRIES` workers did not survive a job. Results already kept remain.
    Exception
        Any exception of the function except `WorkLostError`, whose job is repeated. The results that other jobs have
        returned by then are kept first.
    """
    if isinstance(client, LocalProcesses):
        client.run_each(function, jobs, keep)
        return
    from distributed import as_completed

    waiting = list(jobs)[::-1]
    begun: dict[str, int] = {}
    running: dict[Any, str] = {}
    completed = as_completed(loop=client.loop)
    something = threading.Event()

    def begin(name: str) -> None:
        begun[name] = begun.get(name, 0) + 1
        key = f"{function.__name__}-{name}-{begun[name]}-{os.getpid()}-{time.monotonic_ns()}"
        future = client.submit(function, *jobs[name](), key=key, pure=False)
        running[future] = name
        completed.add(future)
        future.add_done_callback(lambda _: something.set())

    try:
        since_s, counted_s, workers = time.monotonic(), -math.inf, 0
        while waiting or running:
            _check_connection(client)
            if time.monotonic() - counted_s > COUNT_EVERY_S:
                workers, counted_s = worker_count(client), time.monotonic()
            while waiting and len(running) < max(1, IN_FLIGHT_A_WORKER * workers):
                begin(waiting.pop())
            done = completed.next_batch(block=False)
            failure: Exception | None = None
            for future in done:
                name = running.pop(future)
                lost = _lost(future)
                if lost is None:
                    try:
                        keep(name, future.result())
                    except Exception as error:
                        failure = failure or error
                elif begun[name] >= TRIES:
                    failure = failure or ClusterError(
                        f"{name} was started {TRIES} times and never ended: {lost}. See the workers' logs."
                    )
                else:
                    _check_connection(client)
                    waiting.append(name)
            if failure is not None:  # only after the results of all others are kept
                raise failure
            if done or workers:
                since_s = time.monotonic()
            elif time.monotonic() - since_s > SAY_WAITING_AFTER_S:
                print("no worker is connected; waiting for one …", file=sys.stderr, flush=True)
                since_s = time.monotonic()
            if not done:
                something.wait(POLL_S)
                something.clear()
    finally:
        if running and client.status == "running":
            client.cancel(list(running), force=True)


def worker_count(client: Any) -> int:
    """Number of local processes, or of worker threads of a cluster."""
    if isinstance(client, LocalProcesses):
        return client.count
    try:
        workers = client.scheduler_info(n_workers=-1)["workers"]
    except OSError:
        return 0  # the next check of the connection reports it
    return sum(worker["nthreads"] for worker in workers.values())


def _check_connection(client: Any) -> None:
    if client.status != "running":
        raise ClusterError(
            "the Dask scheduler is gone. Finished work is kept: start another scheduler and repeat the command."
        )


def _lost(future: Any) -> str | None:
    """How the work was lost, in words; None if there is a result or the function's own exception."""
    from concurrent.futures import CancelledError as Cancelled

    from distributed import CancelledError, KilledWorker

    if future.status == "finished":
        return None
    if future.status in ("cancelled", "lost"):
        return "its worker was lost"
    error = future.exception()
    if isinstance(error, (WorkLostError, KilledWorker, CancelledError, Cancelled)):
        return str(error)
    return None
