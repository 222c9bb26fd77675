"""The pipeline on every dataset of a real robot, each in a copy of the project, and its evidence back: ``python tests/real.py FOLDER``."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from smoke import ROOT, copy_project, set_parameters

DATASETS = ("ur5", "ur5_rounds")
# beside the project, where the datasets say that their recordings are
BESIDE = ROOT.parent / "shared"
EVIDENCE = "reports/datasets"


def main(folder: Path) -> int:
    """Reproduce the evidence of each dataset in ``folder`` and take it into this project; the first that fails ends it."""
    if not (BESIDE / "recordings/ur5").is_dir():
        print(f"error: there are no recordings in {BESIDE}; data/raw/ur5/README.md says where they come from", file=sys.stderr)
        return 1
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / BESIDE.name).symlink_to(BESIDE)
    for dataset in DATASETS:
        copy = folder / dataset
        copy_project(copy)
        set_parameters(copy, dataset=dataset)
        if subprocess.run(["dvc", "repro", "evidence"], cwd=copy, check=False).returncode:
            return 1
        (ROOT / EVIDENCE).mkdir(exist_ok=True)
        shutil.copy2(copy / EVIDENCE / f"{dataset}.json", ROOT / EVIDENCE)
    print(f"real: the evidence is in {EVIDENCE}; `dvc repro` takes it into the report and the page")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
