"""What compiled functions cost when they are first used, as reports/benchmarks/compilation.json: every stage on the smoke scale, a process
of its own as in `dvc repro`, in a copy of the project in which nothing is compiled. ``python tests/benchmarks/compilation.py FOLDER``
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

from machine import machine
from stages import HERE, plan

sys.path.append(str(Path(__file__).parents[1]))
from smoke import ROOT, copy_project, set_parameters

LIMIT = 20  # s


def main(folder: Path) -> None:
    """Copy, run, and write what was compiled in which stage."""
    shutil.rmtree(folder, ignore_errors=True)
    copy_project(folder)
    for compiled in [*folder.rglob("__pycache__")]:
        shutil.rmtree(compiled)
    set_parameters(folder, scale="smoke", compute="serial")
    stages: Counter[str] = Counter()
    for stage, *item in plan(folder):
        answer = folder / "first_use.json"
        subprocess.run([sys.executable, HERE / "first_use.py", answer, stage, *item], cwd=folder, check=True)
        stages[stage] += json.loads(answer.read_text())
    measured = {"machine": machine(), "limit": LIMIT, "seconds": round(stages.total(), 2)}
    measured |= {"stages": {stage: round(seconds, 2) for stage, seconds in stages.items()}}
    (ROOT / "reports/benchmarks/compilation.json").write_text(json.dumps(measured, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
