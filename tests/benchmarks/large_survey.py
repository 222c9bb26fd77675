"""A share of the large survey's grid on a Dask cluster of which a worker is killed: the same bytes
as in one process, and what it cost against what was predicted.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import pandas as pd
from cost_growth import megabytes
from distributed import Client
from scenario import ROOT

from pipeline.core import config, rng
from pipeline.core.options.analysis import Compute, Dask
from pipeline.studies.survey.conditions import Condition, MotionCondition
from pipeline.studies.survey.options import read_survey
from pipeline.studies.survey.points import Gathered, code_version, gather, keys_of
from pipeline.studies.survey.stage import HERE, SENSITIVITY, study_of

COST = ROOT / "reports/studies/survey/small/cost.json"
HOUR = 3600.0  # s
WAIT = 120.0  # s


def chosen(conditions: list[Condition], count: int) -> list[Condition]:
    """``count`` of the conditions by chance, a sixth of them of the wrench."""
    stream = rng.stream(2017, "scale.survey")
    motion = [number for number, each in enumerate(conditions) if isinstance(each, MotionCondition)]
    wrench = range(len(motion), len(conditions))
    parts = ((motion, count - count // 6), (wrench, count // 6))
    numbers = [
        int(number) for part, size in parts for number in stream.choice(part, size, replace=False)
    ]
    return [conditions[number] for number in numbers]


def kinds(conditions: list[Condition]) -> Counter[str]:
    """How many conditions are of the motion, and how many of the wrench."""
    return Counter(
        "motion" if isinstance(each, MotionCondition) else "wrench" for each in conditions
    )


def predicted(counts: Counter[str], cost: dict[str, float]) -> float:
    """Processor time in s by the survey's ``cost``: its mean of each kind of condition."""
    return sum(n * cost[f"{kind}_cpu_seconds_per_condition_mean"] for kind, n in counts.items())


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


def kill_once_begun(process: int, folder: Path) -> Thread:
    """A thread that kills ``process`` as soon as there is a point in ``folder``."""

    def watch() -> None:
        end = time.monotonic() + WAIT
        while not list(folder.glob("*/[!.]*/survey.parquet")) and time.monotonic() < end:
            time.sleep(0.05)
        os.kill(process, signal.SIGKILL)

    thread = Thread(target=watch)
    thread.start()
    return thread


def alike(one: Gathered, other: Gathered) -> int:
    """How many points of ``one`` are in ``other`` byte for byte, the time that they took apart."""
    theirs = dict(zip(other.keys, other.tables(), strict=True))
    return sum(
        _bytes(mine) == _bytes(theirs[key])
        for key, mine in zip(one.keys, one.tables(), strict=True)
    )


def _bytes(table: pd.DataFrame) -> bytes:
    return table.drop(columns="cpu_seconds").to_parquet(index=False)


def spent(gathered: Gathered) -> dict[str, float]:
    """Processor time in s of the points by kind."""
    seconds: Counter[str] = Counter()
    for table in gathered.tables():
        seconds[table["study"].iloc[0]] += float(table["cpu_seconds"].iloc[0])
    return dict(seconds)


def run(folder: Path, count: int, alone: int, workers: int, name: str = "large") -> dict:
    """``count`` conditions of the survey ``name`` on a cluster, of which a worker is killed, and
    ``alone`` of them in this process; it has to stand in the folder of the project, where
    the paper has been run.
    """
    options = read_survey(HERE / f"{name}.yaml")
    study = study_of(options, config.sections("sensitivity", SENSITIVITY / "dvc.yaml"))
    begin, before = time.process_time(), megabytes("VmRSS")
    conditions = options.conditions
    names = keys_of(conditions, study, code_version())
    naming, held = time.process_time() - begin, 1e6 * (megabytes("VmRSS") - before)
    some, cost = chosen(conditions, count), json.loads(COST.read_text())
    few, kept = some[:: count // alone][:alone], folder / "cluster"
    serial = gather(few, study, folder / "serial", Compute(1))
    with cluster(folder, workers) as (address, processes):
        killer = kill_once_begun(next(iter(processes.values())), kept)
        begin = time.perf_counter()
        across = gather(some, study, kept, Compute(dask=Dask(address)))
        clock = time.perf_counter() - begin
        killer.join()
        with Client(address, timeout=WAIT, set_as_default=False) as client:
            left = len(client.scheduler_info()["workers"])
    whole = predicted(kinds(conditions), cost)
    return {
        "survey": name,
        "grid": len(conditions),
        "naming_seconds": naming,
        "bytes_of_a_name": max(held, 0.0) / len(names),
        "conditions": dict(kinds(some)),
        "workers": workers,
        "workers_left": left,
        "seconds_by_the_clock": clock,
        "alone": alone,
        "equal_bytes": alike(serial, across),
        "spent_seconds": spent(across),
        "predicted_seconds": predicted(kinds(some), cost),
        # the serial run tells how fast this machine is beside that of the prediction
        "spent_alone_seconds": sum(spent(serial).values()),
        "predicted_alone_seconds": predicted(kinds(few), cost),
        "grid_core_hours": whole / HOUR,
        "kept_bytes": across.size,
        # a folder and what is in it
        "kept_files": sum(
            len([*place.iterdir()]) + 1 for place in (folder / "cluster").glob("*/*")
        ),
    }
