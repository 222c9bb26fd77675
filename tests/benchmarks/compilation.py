"""What compiled functions cost when they are first used, as reports/benchmarks/compilation.json:
every stage on the smoke scale, a process of its own as in `dvc repro`, in a copy of the project in
which nothing is compiled; stages that compile, again, and of each the median. ``python
tests/benchmarks/compilation.py FOLDER``
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from statistics import median

from machine import machine
from stages import HERE, plan

sys.path.append(str(Path(__file__).parents[1]))
from project_copy import ROOT, copy_project, set_parameters

LIMIT = 10  # s
ROUNDS = 3


def main(folder: Path) -> None:
    """Copy, run, and write what was compiled in which stage."""
    shutil.rmtree(folder, ignore_errors=True)
    copy_project(folder)
    set_parameters(folder, scale="smoke", compute="serial")
    seconds = {tuple(words): [] for words in plan(folder)}
    for number in range(ROUNDS):
        for compiled in [*folder.rglob("__pycache__")]:
            shutil.rmtree(compiled)
        for words, result in seconds.items():
            if number == 0 or result[0] > 0:
                result.append(first_use(folder, words))
    stages: Counter[str] = Counter()
    for (stage, *_), result in seconds.items():
        stages[stage] += median(result)
    measured = {
        "machine": machine(),
        "limit": LIMIT,
        "rounds": ROUNDS,
        "seconds": round(stages.total(), 2),
    }
    measured |= {"stages": {stage: round(time, 2) for stage, time in stages.items()}}
    (ROOT / "reports/benchmarks/compilation.json").write_text(json.dumps(measured, indent=1) + "\n")


def first_use(folder: Path, words: tuple[str, ...]) -> float:
    """Processor time in s that the stage and its item ``words`` take to compile what is not yet
    compiled.
    """
    answer = folder / "first_use.json"
    subprocess.run([sys.executable, HERE / "first_use.py", answer, *words], cwd=folder, check=True)
    return json.loads(answer.read_text())


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
