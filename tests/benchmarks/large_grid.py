"""A share of the large grid of the study robustness on a Dask cluster of which a worker is killed,
against the same conditions in one process.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from distributed import Client
from scenario import ROOT

from pipeline.cases.verdict import read_claims
from pipeline.core import config, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Compute, Dask
from pipeline.studies.robustness.conditions import verdicts
from pipeline.studies.robustness.stage import HERE, Options, laboratory_grid

COMBINED = ["sway_std", "clearance", "speed_exponent", "lasting", "depth_camera"]
WAIT = 120.0  # s


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, dict[str, int]]]:
    """Address of a scheduler with ``workers`` processes of one thread each, and their process ids
    by address.
    """
    file, program = folder / "scheduler.json", str(Path(sys.executable).parent / "dask")
    local = ["--host", "127.0.0.1", "--no-dashboard"]
    scheduler = [program, "scheduler", "--port", "0", "--scheduler-file", str(file), *local]
    worker = [program, "worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny"]
    worker += ["--preload", "pipeline.core.environment", *local]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": ROOT}
    started = [subprocess.Popen(scheduler, **quiet)]
    environment = os.environ | {"PYTHONPATH": "."}
    try:
        end = time.monotonic() + WAIT
        while not (file.exists() and file.read_text().endswith("}")):
            if time.monotonic() > end:
                raise TimeoutError("the scheduler does not start")
            time.sleep(0.1)
        started += [subprocess.Popen(worker, env=environment, **quiet) for _ in range(workers)]
        address = json.loads(file.read_text())["address"]
        with Client(address, timeout=WAIT, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=WAIT)
            processes = client.run(os.getpid)
        yield address, processes
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


def run(folder: Path, count: int, alone: int, workers: int) -> dict[str, object]:
    """Evaluate ``count`` conditions of the large grid on a cluster, of which a worker is killed
    after the first result, and ``alone`` of them in this process. The current directory has to be a
    project where the paper has been run.
    """
    folder.mkdir(parents=True, exist_ok=True)
    settings = config.sections("robustness", HERE / "dvc.yaml")
    options = config.study_options(HERE, Options)
    combined = [name for name in COMBINED if name in options.factors]
    claims = read_claims(HERE / "conclusions.yaml")
    grid, common = laboratory_grid(settings, replace(options, combined=combined), claims)
    stream = rng.stream(2017, "scale.grid")
    some = [grid[i] for i in stream.choice(len(grid), min(count, len(grid)), replace=False)]
    trial, label = partial(verdicts, common=common), "grid"
    begin = time.process_time()
    serial = list(run_trials(trial, some[:alone], compute=Compute(workers=1), label=label))
    spent = time.process_time() - begin
    across = []
    with cluster(folder, workers) as (address, processes):
        begin = time.perf_counter()
        for result in run_trials(trial, some, compute=Compute(dask=Dask(address)), label=label):
            if not across:
                os.kill(next(iter(processes.values())), signal.SIGKILL)
            across.append(result)
        clock = time.perf_counter() - begin
        with Client(address, timeout=WAIT, set_as_default=False) as client:
            left = len(client.scheduler_info()["workers"])
    equal = [
        one.to_parquet(index=False) == other.to_parquet(index=False)
        for one, other in zip(serial, across, strict=False)
    ]
    return {
        "grid": len(grid),
        "conditions": len(some),
        "workers": workers,
        "workers_left": left,
        "seconds_by_the_clock": clock,
        "alone": alone,
        "equal_bytes": sum(equal),
        "seconds_a_condition": spent / alone,
    }
