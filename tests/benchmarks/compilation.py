"""What compiled functions cost when they are first used, as reports/benchmarks/compilation.json: every stage on the smoke scale, in a copy
of the project in which nothing is compiled. ``python tests/benchmarks/compilation.py FOLDER``
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from machine import machine
from stages import in_one_process

sys.path.append(str(Path(__file__).parents[1]))
from smoke import ROOT, copy_project

LIMIT = 20  # s


def main(folder: Path) -> None:
    """Copy, run, and write what was compiled in which stage."""
    shutil.rmtree(folder, ignore_errors=True)
    copy_project(folder)
    for compiled in [*folder.rglob("__pycache__")]:
        shutil.rmtree(compiled)
    (run,) = in_one_process(folder, "smoke")
    stages = {stage: round(seconds, 2) for stage, seconds in run["compiling"].items()}
    measured = {"machine": machine(), "limit": LIMIT, "seconds": round(sum(stages.values()), 2), "stages": stages}
    (ROOT / "reports/benchmarks/compilation.json").write_text(json.dumps(measured, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
