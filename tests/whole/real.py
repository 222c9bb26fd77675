"""The pipeline on every dataset of a real robot, each in a copy of the project, and its evidence
back: ``python
tests/whole/real.py FOLDER``.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
from project_copy import ROOT, copy_project, set_parameters

DATASETS = ("ur5", "ur5_planar", "ur5_rounds", "lwr4")
# beside the project, where the datasets say that their recordings are
BESIDE = ROOT.parent / "shared"
# what a dataset leaves for the others to be held beside it
EVIDENCE = ("reports/datasets", "reports/studies/baselines")
STAGES = ("score", "pipeline/studies/baselines/dvc.yaml")


def main(folder: Path) -> int:
    """Reproduce the evidence of each dataset in ``folder`` and take it into this project; the first
    that fails ends it.
    """
    for robot in ("ur5", "lwr4"):
        if not (BESIDE / "recordings" / robot).is_dir():
            print(
                f"error: there are no recordings of {robot} in {BESIDE}; "
                f"data/raw/{robot}/README.md says where they come from",
                file=sys.stderr,
            )
            return 1
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / BESIDE.name).symlink_to(BESIDE)
    for dataset in DATASETS:
        copy = folder / dataset
        copy_project(copy)
        set_parameters(copy, dataset=dataset)
        if subprocess.run(["dvc", "repro", *STAGES], cwd=copy, check=False).returncode:
            return 1
        for place in EVIDENCE:
            (ROOT / place).mkdir(parents=True, exist_ok=True)
            shutil.copy2(copy / place / f"{dataset}.json", ROOT / place)
    print(f"real: {' and '.join(EVIDENCE)} hold the evidence; `dvc repro -P` takes it up")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
