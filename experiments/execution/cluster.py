"""Where cases run: a Dask cluster on this machine, or any other; a lost worker loses nothing."""

from __future__ import annotations

import math
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
TRIES = 5
"""How often a case is begun before it counts as one that kills whoever works on it."""
IN_FLIGHT_A_WORKER = 2
POLL_S = 0.1
COUNT_EVERY_S = 0.5
SAY_WAITING_AFTER_S = 10.0
CONNECT_S = 15.0


class ClusterError(ValueError):
    """The cluster cannot do the work; what was finished is kept."""


class WorkLostError(RuntimeError):
    """A process was killed from outside: its work is to be done again."""


@contextmanager
def workers_of(scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """A Dask client: of the cluster at an address, or of processes on this machine, which end with the block.

    Parameters
    ----------
    scheduler : str or None
        As ``tcp://host:8786``.
    workers : int or None
        Processes, where there is no scheduler; as many as cores unless given.

    Raises
    ------
    ClusterError
        Nobody answers at the address.
    """
    import dask
    from distributed import Client, LocalCluster
    from distributed.comm import get_address_host_port

    settings = {
        "distributed.scheduler.allowed-failures": 0,  # `run_each` begins again, and counts
        "distributed.worker.daemon": False,
        "distributed.comm.timeouts.connect": f"{CONNECT_S}s",
        "distributed.nanny.pre-spawn-environ": ONE_THREAD,
    }
    with dask.config.set(settings):
        if scheduler is not None:
            try:
                # asked for first: a client that finds nobody goes on trying when it is thrown away
                socket.create_connection(get_address_host_port(scheduler), CONNECT_S).close()
                client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
            except (OSError, ValueError) as error:
                raise ClusterError(
                    f"no Dask scheduler answers at {scheduler} ({error}). Start one, or leave out --scheduler."
                ) from None
            with client:
                yield client
            return
        with _deaf_to_ctrl_c():
            cluster = LocalCluster(
                n_workers=workers or os.cpu_count() or 1,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",
                memory_limit=0,
                silence_logs="CRITICAL",
            )
        with cluster, Client(cluster, set_as_default=False) as client:
            yield client


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Processes that are started meanwhile leave Ctrl-C to this one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def run_each(
    client: Any,
    function: Callable[..., Any],
    jobs: Mapping[str, Callable[[], tuple[Any, ...]]],
    keep: Callable[[str, Any], None],
) -> None:
    """Call a function for every job on the cluster, and keep each result as it comes.

    Parameters
    ----------
    client : distributed.Client
    function : callable
        Of a module that the workers have too.
    jobs : mapping of str to callable
        By name: makes the arguments, when the job's turn comes.
    keep : callable
        Of name and result; called here, once a job.

    Raises
    ------
    ClusterError
        The scheduler is gone; or a job that `TRIES` workers did not survive. What was kept stays kept.
    Exception
        What the function raises, but for `WorkLostError`: its job is done again. What other jobs have returned by then
        is kept first.
    """
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
                        f"{name} was begun {TRIES} times and never ended: {lost}. See the workers' logs."
                    )
                else:
                    _check_connection(client)
                    waiting.append(name)
            if failure is not None:  # only now that the results of all others are kept
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
    """How many threads of a cluster there are to work."""
    try:
        told = client.scheduler_info(n_workers=-1)["workers"]
    except OSError:
        return 0  # the next look at the connection says so
    return sum(worker["nthreads"] for worker in told.values())


def _check_connection(client: Any) -> None:
    if client.status != "running":
        raise ClusterError(
            "the Dask scheduler is gone. What is finished is kept: start another, and give the same command."
        )


def _lost(future: Any) -> str | None:
    """How the work was lost, in words; None where there is a result, or an error of the function's own."""
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
