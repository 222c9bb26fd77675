"""The pipeline on other datasets than the run's own, each in a copy of the project, and its
evidence back: ``python tests/whole/evidence.py FOLDER DATASET…``.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path += [str(folder) for folder in Path(__file__).parents[1:3]]
from project_copy import ROOT, copy_project, set_parameters

from pipeline.core.typed_yaml import read_yaml

# beside the project, where the datasheets of real robots say that their recordings are
BESIDE = ROOT.parent / "shared"
# what a dataset leaves for the others to be held beside it
EVIDENCE = "reports/datasets"


def main(folder: Path, datasets: Sequence[str]) -> int:
    """Reproduce the evidence of each of the ``datasets`` in ``folder`` and take it into this
    project; the first that fails ends it.
    """
    for dataset in datasets:
        place = Path(read_yaml(ROOT / f"data/raw/{dataset}/dataset.yaml")["recordings"])
        if ".." in place.parts and not (ROOT / place).is_dir():
            print(
                f"error: there are no recordings of {dataset} in {place}; "
                f"data/raw/{dataset}/README.md says where they come from",
                file=sys.stderr,
            )
            return 1
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / BESIDE.name).symlink_to(BESIDE)
    for dataset in datasets:
        copy = folder / dataset
        copy_project(copy)
        set_parameters(copy, dataset=dataset)
        if subprocess.run(["dvc", "repro", "score"], cwd=copy, check=False).returncode:
            return 1
        (ROOT / EVIDENCE).mkdir(parents=True, exist_ok=True)
        shutil.copyfile(copy / "data/score/evidence.json", ROOT / EVIDENCE / f"{dataset}.json")
    print(f"evidence: {EVIDENCE} holds it; `dvc repro` reads it")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), sys.argv[2:]))
