"""Times of the environment and of `make repro` from nothing, and of `make smoke`, as
reports/benchmarks/times.json: ``python tests/benchmarks/times.py FOLDER``, where FOLDER is for the
copies of the project. `make repro` compiles everything; `make smoke` loads this project's machine
code.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

from contests import ROOT, machine, write_results
from project_copy import copy_project

RUNNING = re.compile(r"Running stage '([^']+)'")
SMOKE = ("youbot", "ur5")  # datasets of the smoke runs
COPIES = ROOT / "tests/whole/copies.py"


def stage_seconds(lines: Iterable[str], clock: Callable[[], float]) -> dict[str, float]:
    """Return the wall clock in s from the start of each stage to the start of the next, as the
    ``lines`` of ``dvc repro`` name them; ``start`` is the time before the first stage.
    """
    seconds: dict[str, float] = {}
    stage = "start"
    begin = clock()
    for line in lines:
        started = RUNNING.search(line)
        if started:
            now = clock()
            seconds[stage] = now - begin
            stage = started[1]
            begin = now
    seconds[stage] = clock() - begin
    return seconds


def output_lines(command: list[str], folder: Path) -> Iterator[str]:
    """Yield the lines that ``command`` prints in ``folder``; CalledProcessError if it fails."""
    process = subprocess.Popen(command, cwd=folder, text=True, stdout=subprocess.PIPE)
    yield from process.stdout
    if process.wait():
        raise subprocess.CalledProcessError(process.returncode, command)


def processor_seconds() -> float:
    """Processor time in s of all child processes that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def timed(run: Callable[[], object]) -> dict[str, float]:
    """Return wall clock and processor time in s of the commands of ``run``."""
    begin = time.perf_counter()
    before = processor_seconds()
    run()
    return {
        "seconds": time.perf_counter() - begin,
        "processor_seconds": processor_seconds() - before,
    }


def without_compiled_code(project: Path) -> None:
    """Delete bytecode and machine code in a copy of the project."""
    for folder in [*project.rglob("__pycache__")]:
        shutil.rmtree(folder)


def reproduce(project: Path) -> dict[str, object]:
    """Run ``make repro`` in a copy; return its times, and the wall clock in s by stage."""
    stages: dict[str, float] = {}

    def run() -> None:
        lines = output_lines(["make", "repro"], project)
        stages.update(stage_seconds(lines, time.perf_counter))

    return timed(run) | {"stages": stages}


def main(folder: Path) -> None:
    """Measure in copies of the project, and write."""
    shutil.rmtree(folder, ignore_errors=True)
    project = folder / "project"
    copy_project(project)
    without_compiled_code(project)
    environment = partial(subprocess.run, ["make", "env"], cwd=project, check=True)
    measured = {"machine": machine(), "environment": timed(environment)}
    measured["repro"] = reproduce(project)
    measured["smoke"] = {}
    for dataset in SMOKE:
        command = [sys.executable, COPIES, folder / "smoke", dataset, "--smoke"]
        smoke = partial(subprocess.run, command, cwd=ROOT, check=True)
        measured["smoke"][dataset] = timed(smoke)
    write_results("times", measured)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
