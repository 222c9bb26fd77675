"""Processor time and memory of the whole experiment as `dvc repro` runs it, against the work itself
(work.py), as reports/benchmarks/experiment.json: ``python tests/benchmarks/experiment.py FOLDER
SCALE``, in a copy of the project.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from machine import machine
from stages import by_dvc, work_of

sys.path.append(str(Path(__file__).parents[1]))
from project_copy import ROOT, copy_project, set_parameters

RATIO_LIMIT = 1.2
MEMORY_LIMIT = 1.5e9  # bytes


def main(folder: Path, scale: str) -> None:
    """The work first, which leaves everything compiled, then the stages as the user runs them, then
    in one process each, as the work is measured; all on ``scale``.
    """
    shutil.rmtree(folder, ignore_errors=True)
    copy_project(folder)
    parameters = (folder / "params.yaml").read_text()
    _, work = work_of(folder, "smoke", scale)
    # where the user's parameters let trials run, the scale apart
    (folder / "params.yaml").write_text(parameters)
    set_parameters(folder, scale=scale)
    costs = by_dvc(folder)
    set_parameters(folder, compute="serial")
    serial = {cost["stage"]: cost["cpu"] for cost in by_dvc(folder)}
    measured = {
        "machine": machine(),
        "scale": scale,
        "ratio_limit": RATIO_LIMIT,
        "memory_limit": MEMORY_LIMIT,
    }
    elapsed = sum(cost["elapsed"] for cost in costs)
    measured |= {"elapsed": elapsed, "work": work, "stages": costs, "serial": serial}
    (ROOT / "reports/benchmarks/experiment.json").write_text(json.dumps(measured, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2])
