"""Trials on a Dask cluster: a running cluster, or one that this process starts and ends. The only
importer of dask.

By ``distributed`` itself: joblib's backend for it computes in this process once the scheduler is
lost, waits without end where a task cannot be unpickled, and keeps all results.
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

from pipeline.core.compiled import sources_hash
from pipeline.core.compute.trials import call_pickled
from pipeline.core.environment import BOUNDS
from pipeline.core.errors import ComputeError
from pipeline.core.options.analysis import Compute

OPTION = "pipeline/conf/compute/dask.yaml"  # says how a cluster is started
# no log of the last messages, which holds the trials in them; no warning of what the trials share,
# which is sent once
SILENT = {
    "distributed.admin.low-level-log-length": 0,
    "distributed.admin.large-graph-warning-threshold": "1TB",
}
BLOCK = 0.2  # s of trials that a worker is given at a time, long beside the submission
AHEAD = 16  # blocks per worker that are submitted before the first of them is taken back
LOST = (
    "the connection to the Dask scheduler is lost; start it again and rerun the stage; earlier "
    "results are unchanged"
)


def results_of_cluster(function: bytes, trials: Iterator, compute: Compute, label: str) -> Iterator:
    """Yield the results of ``trials`` in order, submitted in blocks of about BLOCK s; on the
    dashboard a block is a task with the name ``label``. A block whose worker is lost runs again.

    ComputeError where there is no scheduler or no worker for the timeout of ``compute``, where it
    is lost, where trials end their workers, and for a worker that might give other bytes.
    """

    def run(shared: bytes, block: list[bytes]) -> tuple[float, list[bytes]]:
        # sent as code, so that it runs and fails where the project is not
        from pipeline.core.compute.cluster import run_on_worker

        return run_on_worker(shared, block)

    with connected(compute) as client:
        cluster = client, client.scheduler.address, compute.dask.timeout
        workers = f"{workers_of(*cluster)} worker(s) of {client.scheduler.address}"
        print(f"{label}: {workers}, dashboard {client.dashboard_link}", flush=True)
        # a task and not scattered data, which would be lost with the worker that holds it
        shared, key = pickle.dumps((fingerprint(), function)), f"{label}, what they share-0"
        shared = client.submit(bytes, shared, key=f"{key}-{client.id}")
        waiting: deque[Future] = deque()
        begun, size = 0, 1
        while True:
            while len(waiting) < AHEAD * workers_of(*cluster):
                if not (block := [pickle.dumps(trial) for trial in islice(trials, size)]):
                    break
                # not by Client.get_executor, whose futures never end where the scheduler is lost
                # while it sends a result
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
    """A client that is closed where it finds no scheduler, and not by garbage collection, which in
    the midst of another client's start waits without end for a lock that its thread holds.
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
def connected(compute: Compute) -> Iterator[Client]:
    """Client of the cluster of ``compute``, or of one started here; ComputeError without one."""
    for logger in ("distributed", "distributed.client"):  # ComputeError tells of lost connections
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    address, timeout = compute.dask.address, compute.dask.timeout
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(SILENT))
        if address is None:
            number = compute.workers or len(os.sched_getaffinity(0))
            here = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
            own = LocalCluster(n_workers=number, threads_per_worker=1, **here)
            address = stack.enter_context(own).scheduler_address
        try:
            client = _Client(address, timeout)
        # AssertionError: Dask's thread has not begun within 10 s, as on a busy machine
        except (OSError, ValueError, AssertionError) as error:
            message = f"no Dask scheduler answers within {timeout:g} s ({error}); start one as "
            message += f"{OPTION} says, or name the address of one that runs"
            raise ComputeError(message, address=address) from None
        try:
            yield client
        finally:
            with suppress(TimeoutError):
                client.close()


def workers_of(client: Client, address: str, timeout: float) -> int:
    """Number of workers, the first of which is waited for; ComputeError without one."""
    try:
        number = len(client.sync(client.scheduler.ncores, callback_timeout=timeout))
    except (OSError, AttributeError):  # a client that has given up has no scheduler
        raise ComputeError(LOST, address=address) from None
    if not number:
        try:
            client.wait_for_workers(1, timeout=timeout)
        except TimeoutError:
            without = f"the Dask cluster has been without workers for {timeout:g} s"
            message = f"{without}; start some as {OPTION} says"
            raise ComputeError(message, address=address) from None
    return max(number, 1)


def result_of(
    future: Future, client: Client, address: str, timeout: float
) -> tuple[float, list[bytes]]:
    """Time in s and pickled results of a block; errors of the cluster are ComputeErrors."""
    while True:
        try:
            return future.result(timeout)
        except TimeoutError:
            if future.status == "error":  # of a trial itself
                raise
            workers_of(client, address, timeout)  # a long block, a result on its way, or none left
        except (CancelledError, CommClosedError):
            raise ComputeError(LOST, address=address) from None
        except KilledWorker as error:
            raise ComputeError(
                f"{error.allowed_failures + 1} workers ended while they ran a trial, "
                "as happens when memory runs out; give them more memory, or start fewer a machine",
                trials=error.task.removesuffix(f"-{client.id}"),
            ) from None
        except ImportError as error:
            message = f"a worker cannot import what it needs: {error}; start it as {OPTION} says"
            raise ComputeError(message, address=address) from None


def run_on_worker(shared: bytes, block: list[bytes]) -> tuple[float, list[bytes]]:
    """Refuse the worker where it might not give the same bytes, else run the block."""
    expected, function = pickle.loads(shared)
    worker, threads = get_worker(), "the number of a worker's threads"
    # threads of one process would share what libraries keep between calls
    there = fingerprint() | {threads: str(worker.state.nthreads)}
    for name, state in (expected | {threads: "1"}).items():
        # a library that only one side has is left to its import
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
    """Name and state of everything on which the bytes of results depend beside the trials, as it
    was at the first call: a worker that imported modules before an edit of the code is found out.
    """
    project = Path("dvc.yaml")
    changed = str(project.stat().st_mtime_ns) if project.exists() else "none"
    return {
        "the code of pipeline": sources_hash(),
        "python": platform.python_version(),
        **{name: os.environ.get(name, "unset") for name in BOUNDS},
        **{distribution.name.lower(): distribution.version for distribution in distributions()},
        "numpy's arithmetic": _arithmetic(),
        "the project's folder (time of its dvc.yaml)": changed,
    }


def _arithmetic() -> str:
    """A digest of sums and functions whose last bits depend on the instruction set and threads."""
    x = np.linspace(0.1, 3.0, 40_000).reshape(200, 200)
    positive = x @ x.T + 200 * np.eye(200)
    values = [function(x) for function in (np.exp, np.log, np.sin, np.tan, np.sqrt)]
    values += [x**1.7, x.sum(axis=0), positive, np.linalg.inv(positive), np.linalg.svd(x)[0]]
    return hashlib.sha256(b"".join(value.tobytes() for value in values)).hexdigest()[:12]
