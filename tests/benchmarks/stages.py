"""The stages of a copy of the project: run by DVC, each a process of its own, or one after another
in a single process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
from project_copy import planned

HERE = Path(__file__).parent


def by_dvc(project: Path) -> list[dict]:
    """Run ``dvc repro`` and return what each stage cost: stage, cpu (s), memory (bytes, of the
    largest process), elapsed (s).

    Raises CalledProcessError where it fails.
    """
    file = project / "costs.jsonl"
    file.unlink(missing_ok=True)
    environment = os.environ | {"PYTHONPATH": str(HERE / "probe"), "COST_OF_STAGES": str(file)}
    subprocess.run(["dvc", "repro", "--force"], cwd=project, env=environment, check=True)
    return [json.loads(line) for line in file.read_text().splitlines()]


def plan(project: Path) -> list[list[str]]:
    """All stages in the order in which they run, each with its item if it has one. Raises
    CalledProcessError where DVC fails.
    """
    said = subprocess.run(
        ["dvc", "repro", "--force", "--dry"],
        cwd=project,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    return [words.split() for words in planned(said).values()]


def work_of(project: Path, *scales: str) -> list[dict]:
    """Run all stages in a new process, once on each of ``scales``; of each time the work in s, as
    in work.py.

    Raises CalledProcessError where it fails.
    """
    # stages print, so the answer has a file of its own
    answer, order = project / "work.json", json.dumps({"scales": scales, "stages": plan(project)})
    subprocess.run(
        [sys.executable, HERE / "work.py", answer], cwd=project, input=order, check=True, text=True
    )
    return json.loads(answer.read_text())
