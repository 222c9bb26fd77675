"""The pipeline in copies of the project. ``python tests/whole/copies.py FOLDER`` runs it on the
smoke scale; ``… FOLDER DATASET…`` runs it on other datasets and takes their evidence back.
"""

import shutil
import subprocess
import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("..", "helpers")]
from project_copy import ROOT, SMOKE, copy_project, set_parameters

from pipeline.core.typed_yaml import read_yaml

# beside the project, where the datasheets of real robots say that their recordings are
BESIDE = ROOT.parent / "shared"
EVIDENCE = "reports/datasets"  # a file a dataset, which the report compares


def reproduce(copy: Path, *targets: str, **parameters: object) -> bool:
    """Copy the project, set ``parameters`` and run ``dvc repro``; return its success."""
    copy_project(copy)
    set_parameters(copy, **parameters)
    return (
        subprocess.run(["dvc", "repro", *targets], cwd=copy, check=False).returncode
        == 0
    )


def main(folder: Path, *datasets: str) -> int:
    """Run on the smoke scale, or on the ``datasets``; the first that fails ends it."""
    for dataset in datasets:
        place = Path(read_yaml(ROOT / f"data/raw/{dataset}/dataset.yaml")["recordings"])
        if ".." in place.parts and not (ROOT / place).is_dir():
            origin = f"data/raw/{dataset}/README.md says where they come from"
            print(
                f"error: no recordings of {dataset} in {place}; {origin}",
                file=sys.stderr,
            )
            return 1
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    if not datasets:
        if not reproduce(folder / "project", **SMOKE):
            return 1
        print(
            f"smoke: every stage ran in {folder / 'project'}; its numbers mean nothing"
        )
        return 0
    (folder / BESIDE.name).symlink_to(BESIDE)
    (ROOT / EVIDENCE).mkdir(parents=True, exist_ok=True)
    for dataset in datasets:
        if not reproduce(folder / dataset, "score", dataset=dataset):
            return 1
        evidence = folder / dataset / "data/score/evidence.json"
        shutil.copyfile(evidence, ROOT / EVIDENCE / f"{dataset}.json")
    print(f"evidence: written to {EVIDENCE}; `dvc repro` reads it")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), *sys.argv[2:]))
