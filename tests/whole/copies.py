"""The pipeline in copies of the project. ``python tests/whole/copies.py FOLDER`` runs it on the
smoke scale; ``… FOLDER DATASET…`` runs it on other datasets and takes their evidence back.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("..", "helpers")]
from project_copy import ROOT, SMOKE, copy_project, set_parameters

from pipeline.configuration.config import CONF, dataset_values
from pipeline.core.errors import RecordingError
from pipeline.recordings.inventory import PULLED, listing, raw_folder

# beside the project, where the datasheets of real robots say that their recordings are
BESIDE = ROOT.parent / "shared"
EVIDENCE = "reports/datasets"  # a file a dataset, which the report compares


def reproduce(
    copy: Path, *targets: str, pulled: Path | None = None, **parameters: object
) -> bool:
    """Copy the project with the ``pulled`` recordings, set ``parameters`` and run ``dvc repro``;
    return its success.
    """
    copy_project(copy)
    if pulled is not None:
        shutil.copytree(ROOT / pulled, copy / pulled, dirs_exist_ok=True)
    set_parameters(copy, **parameters)
    command = ["dvc", "repro", *targets]
    return subprocess.run(command, cwd=copy, check=False).returncode == 0


def recordings_of(dataset: str) -> Path | None:
    """Return the folder of a real dataset's recordings, from the project's root: the pulled ones,
    else those beside the project; None where the laboratory records them. RecordingError without
    recordings.
    """
    stated = dataset_values(CONF / "dataset" / f"{dataset}.yaml")["recordings"]
    place = raw_folder(stated)
    if place.parts[0] != ".." and not place.is_relative_to(PULLED):
        return None
    listing(place)
    return place


def main(folder: Path, *datasets: str) -> int:
    """Run on the smoke scale, or on the ``datasets``; the first that fails ends it."""
    os.chdir(ROOT)
    try:
        places = {dataset: recordings_of(dataset) for dataset in datasets}
    except RecordingError as error:
        print(f"error: {error}", file=sys.stderr)
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
    if BESIDE.is_dir():
        (folder / BESIDE.name).symlink_to(BESIDE)
    (ROOT / EVIDENCE).mkdir(parents=True, exist_ok=True)
    for dataset, place in places.items():
        pulled = place if place and place.is_relative_to(PULLED) else None
        if not reproduce(folder / dataset, "score", pulled=pulled, dataset=dataset):
            return 1
        evidence = folder / dataset / "data/score/evidence.json"
        shutil.copyfile(evidence, ROOT / EVIDENCE / f"{dataset}.json")
    print(f"evidence: written to {EVIDENCE}; `dvc repro` reads it")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), *sys.argv[2:]))
