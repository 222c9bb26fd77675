"""Trials on a Dask cluster: a running cluster, or one that this process starts and ends.

joblib's backend for Dask is not used: it waits without end for trials that end their workers.
"""

import hashlib
import logging
import os
import pickle
import platform
from collections import deque
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.metadata import distributions
from itertools import count, islice
from pathlib import Path

import dask
import numpy as np
from distributed import Client, Future, LocalCluster, get_worker
from distributed.comm import CommClosedError
from distributed.scheduler import KilledWorker

from pipeline.core.compute.pickled import call_pickled
from pipeline.core.environment import BOUNDS
from pipeline.core.errors import ComputeError
from pipeline.core.options.analysis import Compute
from pipeline.core.sources import sources_hash

OPTION = "pipeline/conf/compute/dask.yaml"  # explains how to start a cluster
SILENT = {"distributed.admin.low-level-log-length": 0}  # a log would keep the trials
AHEAD = 16  # trials per worker that are submitted before the first result is taken
LOST = (
    "the Dask scheduler is lost; start it again, rerun the stage; results are unchanged"
)


def results_of_cluster(
    function: bytes,
    trials: Iterator,
    compute: Compute,
    label: str,
) -> Iterator:
    """Yield the results of ``trials`` in order. The dashboard shows a trial as a task ``label``; a
    trial whose worker is lost runs again.

    Raises ComputeError for a lost scheduler, for no workers within the timeout of ``compute``, for
    trials that end their workers, and for a worker that might compute other bytes.
    """

    def run(shared: bytes, trial: bytes) -> bytes:
        # sent as code, so that a worker without the project fails here
        from pipeline.core.compute.cluster import run_on_worker

        return run_on_worker(shared, trial)

    with connect(compute) as client:
        workers = workers_of(client, compute)
        print(
            f"{label}: {workers} worker(s), dashboard {client.dashboard_link}",
            flush=True,
        )
        content = pickle.dumps((fingerprint(), function))
        # a task, which runs again if its worker is lost; scattered data would be lost
        shared = client.submit(bytes, content, key=f"{label}, common-0-{client.id}")
        waiting: deque[Future] = deque()
        numbers = count()
        while True:
            for trial in islice(trials, AHEAD * workers - len(waiting)):
                key = f"{label}-{next(numbers)}-{client.id}"
                waiting.append(client.submit(run, shared, pickle.dumps(trial), key=key))
            if not waiting:
                return
            yield pickle.loads(result_of(waiting.popleft(), client, compute))


@contextmanager
def connect(compute: Compute) -> Iterator[Client]:
    """Yield a client of the cluster of ``compute``, or of a new cluster; else ComputeError."""
    for logger in ("distributed", "distributed.client"):  # ComputeError says the same
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    address = compute.dask.address
    timeout = compute.dask.timeout
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(SILENT))
        if address is None:
            workers = compute.workers or len(os.sched_getaffinity(0))
            local = LocalCluster(workers, threads_per_worker=1, dashboard_address=None)
            address = stack.enter_context(local).scheduler_address
        try:
            client = Client(address, timeout=timeout)
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


def workers_of(client: Client, compute: Compute) -> int:
    """Return the number of workers, at least one; ComputeError without one for the timeout."""
    timeout = compute.dask.timeout
    address = compute.dask.address
    try:
        cores = client.sync(client.scheduler.ncores, callback_timeout=timeout)
        if not cores:
            client.wait_for_workers(1, timeout=timeout)
    except TimeoutError:
        message = f"the Dask cluster has no scheduler or workers for {timeout:g} s; start them as "
        raise ComputeError(f"{message}{OPTION} says", address=address) from None
    except (OSError, AttributeError):  # a client has no scheduler after it gave up
        raise ComputeError(LOST, address=address) from None
    return max(len(cores), 1)


def result_of(future: Future, client: Client, compute: Compute) -> bytes:
    """Return the pickled result of a trial; raises its error, ComputeError for a lost cluster."""
    while True:
        try:
            return future.result(compute.dask.timeout)
        except TimeoutError:
            if future.status == "error":  # the trial has raised it
                raise
            workers_of(client, compute)  # raises where none is left
        except (CancelledError, CommClosedError):
            raise ComputeError(LOST, address=compute.dask.address) from None
        except KilledWorker as error:
            ended = error.allowed_failures + 1
            message = (
                f"{ended} workers ended while they ran a trial, as happens when memory "
            )
            message += "runs out; give them more memory or start fewer per machine"
            trial = error.task.removesuffix(f"-{client.id}")
            raise ComputeError(message, trials=trial) from None
        except ImportError as error:
            message = f"a worker cannot import what it needs: {error}; start it as {OPTION} says"
            raise ComputeError(message, address=compute.dask.address) from None


def run_on_worker(shared: bytes, trial: bytes) -> bytes:
    """Return the pickled result; ComputeError where this worker might compute other bytes."""
    expected, function = pickle.loads(shared)
    worker = get_worker()
    threads = "the number of a worker's threads"
    # threads of one process would share the state of libraries
    there = fingerprint() | {threads: str(worker.state.nthreads)}
    for name, state in (expected | {threads: "1"}).items():
        if there[name] != state:
            message = (
                f"a worker may compute other bytes: {name} is {there[name]} there and "
            )
            message += f"{state} here; restart it as {OPTION} says"
            raise ComputeError(message, worker=worker.address)
    return call_pickled(function, trial)


@cache
def fingerprint() -> dict[str, str]:
    """Return by name what results depend on besides the trials, at the first call."""
    x = np.linspace(0.1, 3.0, 40_000).reshape(200, 200)
    # the last bits depend on the instruction set and on threads
    values = [np.exp(x), np.tan(x), x**1.7, x.sum(axis=0), x @ x.T, np.linalg.svd(x)[0]]
    libraries = sorted(f"{d.name} {d.version}" for d in distributions())
    project = Path("dvc.yaml")
    changed = str(project.stat().st_mtime_ns) if project.exists() else "none"
    return {
        "the code of pipeline": sources_hash(),
        "python": platform.python_version(),
        **{name: os.environ.get(name, "unset") for name in BOUNDS},
        "hash of the libraries' versions": digest("\n".join(libraries).encode()),
        "numpy's arithmetic": digest(b"".join(value.tobytes() for value in values)),
        "the project's folder (time of its dvc.yaml)": changed,
    }


def digest(content: bytes) -> str:
    """Return the first digits of the SHA-256 of ``content``."""
    return hashlib.sha256(content).hexdigest()[:12]
