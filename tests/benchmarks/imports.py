"""What the stages take to import, as reports/benchmarks/imports.json: every stage on the smoke
scale, a process of its own as in `dvc repro`, in a copy of the project; of several rounds the
least, in which everything is compiled. Beside them the libraries alone, below which no stage that
uses them can come. ``python tests/benchmarks/imports.py FOLDER``
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from statistics import median

from machine import machine
from stages import HERE, plan

sys.path.append(str(Path(__file__).parents[1]))
from project_copy import ROOT, copy_project, set_parameters

LIMITS = {"median": 1.0, "slowest": 1.5}  # s
ROUNDS = 5
# those of a stage that reads tables, moves an arm and has compiled loops; that of the stages `fit`
LIBRARIES = [["numpy", "pandas", "numba", "pinocchio"], ["cvxpy"]]


def main(folder: Path) -> None:
    """Copy, run, and write what each stage took."""
    shutil.rmtree(folder, ignore_errors=True)
    copy_project(folder)
    set_parameters(folder, scale="smoke", compute="serial")
    stages = {
        " ".join(words): min(import_time(folder, words) for _ in range(ROUNDS))
        for words in plan(folder)
    }
    libraries = {
        ", ".join(names): min(library_time(names) for _ in range(ROUNDS)) for names in LIBRARIES
    }
    measured = {
        "machine": machine(),
        "limits": LIMITS,
        "rounds": ROUNDS,
        "median": round(median(stages.values()), 3),
        "slowest": round(max(stages.values()), 3),
        "stages": {stage: round(seconds, 3) for stage, seconds in stages.items()},
        "libraries": {names: round(seconds, 3) for names, seconds in libraries.items()},
    }
    (ROOT / "reports/benchmarks/imports.json").write_text(json.dumps(measured, indent=1) + "\n")


def import_time(folder: Path, words: list[str]) -> float:
    """Processor time in s that the stage and its item ``words`` take to import."""
    answer = folder / "import_time.json"
    subprocess.run(
        [sys.executable, HERE / "import_time.py", answer, *words], cwd=folder, check=True
    )
    return json.loads(answer.read_text())


def library_time(names: list[str]) -> float:
    """Processor time in s that Python takes to start and to import the libraries ``names``."""
    script = f"import time, {', '.join(names)}; print(time.process_time())"
    ran = subprocess.run([sys.executable, "-c", script], check=True, stdout=subprocess.PIPE)
    return float(ran.stdout)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
