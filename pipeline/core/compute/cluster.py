"""Trials on a Dask cluster: a running cluster, or one that this process starts and ends.

joblib's backend for Dask is not used. It computes in this process once the scheduler is lost, waits
without end for a task that cannot be unpickled, and keeps all results.
"""

import hashlib
import logging
import math
import os
import pickle
import platform
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.metadata import distributions
from itertools import islice
from pathlib import Path

import dask
import numpy as np
from distributed import Client, Future, LocalCluster, get_worker
from distributed.comm import CommClosedError
from distributed.scheduler import KilledWorker
from distributed.utils import get_mp_context

from pipeline.core.compute.pickled import call_pickled
from pipeline.core.environment import BOUNDS
from pipeline.core.errors import ComputeError
from pipeline.core.options.analysis import Compute
from pipeline.core.sources import sources_hash

OPTION = "pipeline/conf/compute/dask.yaml"  # explains how to start a cluster
# no log of messages, which would keep trials in memory; no warning of a large function
SILENT = {
    "distributed.admin.low-level-log-length": 0,
    "distributed.admin.large-graph-warning-threshold": "1TB",
}
# workers of a local cluster are forks of one process that has imported PRELOAD
FORKED = {"distributed.worker.multiprocessing-method": "forkserver"}
PRELOAD = ["distributed", "pipeline.core.compute.cluster", "pandas", "numba"]
BLOCK = 0.2  # s, duration of the trials of a task, long compared with its submission
AHEAD = 16  # blocks per worker that are submitted before the first result is taken
LOST = (
    "the connection to the Dask scheduler is lost; start it again and rerun the stage; earlier "
    "results are unchanged"
)


def results_of_cluster(
    function: bytes, trials: Iterator, compute: Compute, label: str
) -> Iterator:
    """Yield the results of ``trials`` in order, submitted in blocks of about BLOCK s; the dashboard
    shows a block as a task ``label``. A block whose worker is lost runs again.

    Raises ComputeError for a lost scheduler, for no workers within the timeout of ``compute``, for
    trials that end their workers, and for a worker that might compute other bytes.
    """

    def run(shared: bytes, block: list[bytes]) -> tuple[float, list[bytes]]:
        # sent as code, so that a worker without the project fails here
        from pipeline.core.compute.cluster import run_on_worker

        return run_on_worker(shared, block)

    with connect(compute) as client:
        cluster = client, client.scheduler.address, compute.dask.timeout
        workers = f"{workers_of(*cluster)} worker(s) of {client.scheduler.address}"
        print(f"{label}: {workers}, dashboard {client.dashboard_link}", flush=True)
        # a task runs again if its worker is lost; scattered data would be lost
        shared, key = (
            pickle.dumps((fingerprint(), function)),
            f"{label}, what they share-0",
        )
        shared = client.submit(bytes, shared, key=f"{key}-{client.id}")
        waiting: deque[Future] = deque()
        begun, size = 0, 1
        while True:
            while len(waiting) < AHEAD * workers_of(*cluster):
                if not (
                    block := [pickle.dumps(trial) for trial in islice(trials, size)]
                ):
                    break
                # futures of Client.get_executor never end if the scheduler is lost meanwhile
                key = f"{label}-{begun}-{client.id}"
                waiting.append(client.submit(run, shared, block, key=key))
                begun += len(block)
            if not waiting:
                return
            for _ in range(1 + len(waiting) // 2):
                seconds, results = result_of(waiting.popleft(), *cluster)
                yield from map(pickle.loads, results)
            size = max(1, math.floor(BLOCK * len(results) / seconds))


class _Client(Client):
    """Client that closes itself if it finds no scheduler; closing by garbage collection can
    deadlock with the start of another client.
    """

    def __init__(self, address: str, timeout: float) -> None:
        try:
            super().__init__(address, timeout=timeout)
        except BaseException:
            with suppress(TimeoutError):
                self.close()
            raise

    def __del__(self) -> None:
        pass


@contextmanager
def connect(compute: Compute) -> Iterator[Client]:
    """Yield a client of the cluster of ``compute``, or of a new cluster; else ComputeError."""
    for logger in (
        "distributed",
        "distributed.client",
    ):  # ComputeError reports lost connections
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    address, timeout = compute.dask.address, compute.dask.timeout
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(SILENT | FORKED))
        if address is None:
            workers = compute.workers or len(os.sched_getaffinity(0))
            local = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
            get_mp_context().set_forkserver_preload(PRELOAD)
            cluster = LocalCluster(n_workers=workers, threads_per_worker=1, **local)
            address = stack.enter_context(cluster).scheduler_address
        try:
            client = _Client(address, timeout)
        # AssertionError: Dask's thread has not started within 10 s, as on a busy machine
        except (OSError, ValueError, AssertionError) as error:
            message = f"no Dask scheduler answers within {timeout:g} s ({error}); start one as "
            message += f"{OPTION} says, or give the address of a running one"
            raise ComputeError(message, address=address) from None
        try:
            yield client
        finally:
            with suppress(TimeoutError):
                client.close()


def workers_of(client: Client, address: str, timeout: float) -> int:
    """Return the number of workers, at least one; ComputeError without one for ``timeout`` s."""
    try:
        number = len(client.sync(client.scheduler.ncores, callback_timeout=timeout))
    except (OSError, AttributeError):  # a client has no scheduler after it gave up
        raise ComputeError(LOST, address=address) from None
    if not number:
        try:
            client.wait_for_workers(1, timeout=timeout)
        except TimeoutError:
            message = f"the Dask cluster has been without workers for {timeout:g} s; start some as "
            message += f"{OPTION} says"
            raise ComputeError(message, address=address) from None
    return max(number, 1)


def result_of(
    future: Future, client: Client, address: str, timeout: float
) -> tuple[float, list[bytes]]:
    """Return time in s and pickled results of a block; raises ComputeError for a lost cluster."""
    while True:
        try:
            return future.result(timeout)
        except TimeoutError:
            if future.status == "error":  # a trial has raised it
                raise
            workers_of(client, address, timeout)  # raises where none is left
        except (CancelledError, CommClosedError):
            raise ComputeError(LOST, address=address) from None
        except KilledWorker as error:
            raise ComputeError(
                f"{error.allowed_failures + 1} workers ended while they ran a trial, "
                "as happens when memory runs out; give them more memory or start fewer per machine",
                trials=error.task.removesuffix(f"-{client.id}"),
            ) from None
        except ImportError as error:
            message = f"a worker cannot import what it needs: {error}; start it as {OPTION} says"
            raise ComputeError(message, address=address) from None


def run_on_worker(shared: bytes, block: list[bytes]) -> tuple[float, list[bytes]]:
    """Return time in s and results; ComputeError where this worker might compute other bytes."""
    expected, function = pickle.loads(shared)
    worker, threads = get_worker(), "the number of a worker's threads"
    # threads of one process would share the state of libraries
    there = fingerprint() | {threads: str(worker.state.nthreads)}
    for name, state in (expected | {threads: "1"}).items():
        # where one side lacks a library, its import fails
        if there.get(name, state) != state:
            raise ComputeError(
                f"a worker may compute other bytes: {name} is {there[name]} there and "
                f"{state} here; restart it as {OPTION} says",
                worker=worker.address,
            )
    begin = time.perf_counter()
    results = [call_pickled(function, trial) for trial in block]
    return time.perf_counter() - begin, results


@cache
def fingerprint() -> dict[str, str]:
    """Return by name everything that results depend on besides the trials, at the first call."""
    project = Path("dvc.yaml")
    changed = str(project.stat().st_mtime_ns) if project.exists() else "none"
    return {
        "the code of pipeline": sources_hash(),
        "python": platform.python_version(),
        **{name: os.environ.get(name, "unset") for name in BOUNDS},
        **{
            distribution.name.lower(): distribution.version
            for distribution in distributions()
        },
        "numpy's arithmetic": _arithmetic(),
        "the project's folder (time of its dvc.yaml)": changed,
    }


def _arithmetic() -> str:
    """Digest of sums and functions whose last bits depend on the instruction set and threads."""
    x = np.linspace(0.1, 3.0, 40_000).reshape(200, 200)
    positive = x @ x.T + 200 * np.eye(200)
    values = [function(x) for function in (np.exp, np.log, np.sin, np.tan, np.sqrt)]
    values += [
        x**1.7,
        x.sum(axis=0),
        positive,
        np.linalg.inv(positive),
        np.linalg.svd(x)[0],
    ]
    return hashlib.sha256(b"".join(value.tobytes() for value in values)).hexdigest()[
        :12
    ]
