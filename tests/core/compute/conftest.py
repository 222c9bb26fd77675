"""Schedulers and workers of Dask in processes of their own, over loopback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

import pytest
from distributed import Client

from pipeline.core.options.analysis import Compute, Dask

ROOT = Path(__file__).parents[3]
WAIT = 60.0  # s, until a process counts as not starting


@contextmanager
def process(*words: str, **variables: str) -> Iterator[subprocess.Popen]:
    """A Dask process in the project's folder, with these environment variables; killed in the end,
    as its children then end too.
    """
    dask = str(Path(sys.executable).parent / "dask")
    command = [dask, *words, "--host", "127.0.0.1", "--no-dashboard"]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, cwd=ROOT, env=variables, **silent) as started:
        try:
            yield started
        finally:
            started.kill()


class Running:
    """A scheduler, and what starts workers for it."""

    def __init__(self, scheduler: subprocess.Popen, file: Path) -> None:
        end = time.monotonic() + WAIT
        # the file is there before it is written to its end
        while not (file.exists() and file.read_text().endswith("}")):
            assert scheduler.poll() is None and time.monotonic() < end, "no scheduler starts"
            time.sleep(0.05)
        self.scheduler, self.address = scheduler, json.loads(file.read_text())["address"]

    def compute(self, timeout: float = WAIT) -> Compute:
        return Compute(dask=Dask(self.address, timeout))

    def documented_workers(self) -> AbstractContextManager[subprocess.Popen]:
        """Two as pipeline/conf/compute/dask.yaml says, of a person who has set none of our
        environment variables.
        """
        options = "--nthreads 1 --nworkers 2 --preload pipeline.core.environment"
        path = {"PATH": os.environ["PATH"], "PYTHONPATH": "."}
        return process("worker", self.address, *options.split(), **path)

    def worker(
        self, threads: int = 1, **variables: str
    ) -> AbstractContextManager[subprocess.Popen]:
        """One that starts sooner, for nothing watches over it; our environment variables are set,
        but for those given.
        """
        words = "worker", self.address, "--nthreads", str(threads), "--no-nanny"
        return process(*words, **os.environ | variables)


@contextmanager
def scheduler(folder: Path) -> Iterator[Running]:
    file = folder / "scheduler.json"
    words = "scheduler", "--port", "0", "--scheduler-file", str(file)
    with process(*words, PATH=os.environ["PATH"]) as started:
        yield Running(started, file)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A scheduler with two workers."""
    with scheduler(tmp_path_factory.mktemp("running")) as started:
        with started.documented_workers():
            yield started


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A scheduler without workers."""
    with scheduler(tmp_path_factory.mktemp("idle")) as started:
        yield started


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[], Running]]:
    """Starts a scheduler with one worker, which the test may end."""
    with ExitStack() as stack:

        def started() -> Running:
            cluster = stack.enter_context(scheduler(tmp_path))
            stack.enter_context(cluster.worker(PYTHONPATH="."))
            with Client(cluster.address, timeout=WAIT, set_as_default=False) as client:
                client.wait_for_workers(1, timeout=WAIT)
            return cluster

        yield started
