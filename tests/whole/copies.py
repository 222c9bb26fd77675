"""The pipeline in copies of the project. ``python tests/whole/copies.py FOLDER DATASET…`` runs it
on the datasets and takes their evidence back; with ``--smoke`` it runs every stage at the smallest
scale in one process, and takes nothing back.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("..", "helpers")]
from project_copy import (
    EVERY_COMMAND,
    ROOT,
    SMOKE,
    copy_project,
    planned,
    set_parameters,
    succeeds,
)

from pipeline.configuration.config import CONF, dataset_values
from pipeline.core.errors import RecordingError
from pipeline.recordings.inventory import PULLED, listing, raw_folder

# beside the project, where the datasheets of real robots say that their recordings are
BESIDE = ROOT.parent / "shared"
EVIDENCE = "reports/datasets"  # a file a dataset, which the report compares


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


def copy_with_recordings(copy: Path, recordings: Path | None) -> None:
    """Copy the project with pulled ``recordings``, and set no parameter."""
    copy_project(copy)
    if recordings is not None and recordings.is_relative_to(PULLED):
        shutil.copytree(ROOT / recordings, copy / recordings, dirs_exist_ok=True)


def smoke(copy: Path) -> bool:
    """Run the stages of ``dvc repro`` in one process; return their success."""
    plan = planned(succeeds("dvc", "repro", "--force", "--dry", cwd=copy))
    command = [sys.executable, "-c", EVERY_COMMAND, *plan.values()]
    return subprocess.run(command, cwd=copy, check=False).returncode == 0


def evidence_of(copy: Path, dataset: str) -> bool:
    """Run ``dvc repro``; take back the evidence on ``dataset`` and the hashes of its recordings,
    without which `dvc exp apply` fails in a clone. Return the success.
    """
    command = ["dvc", "repro", "score"]
    if subprocess.run(command, cwd=copy, check=False).returncode != 0:
        return False
    target = ROOT / EVIDENCE / f"{dataset}.json"
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(copy / "data/score/evidence.json", target)
    lock = Path("data/raw", dataset, "dvc.lock")
    shutil.copyfile(copy / lock, ROOT / lock)
    return True


def main(folder: Path, datasets: list[str], at_smoke_scale: bool) -> int:
    """Run the ``datasets`` in copies below ``folder``; the first that fails ends it."""
    os.chdir(ROOT)
    try:
        places = {dataset: recordings_of(dataset) for dataset in datasets}
    except RecordingError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    if BESIDE.is_dir():
        (folder / BESIDE.name).symlink_to(BESIDE)
    for dataset, place in places.items():
        copy = folder / dataset
        copy_with_recordings(copy, place)
        if at_smoke_scale:
            set_parameters(copy, **SMOKE, dataset=dataset)
            success = smoke(copy)
        else:
            set_parameters(copy, dataset=dataset)
            success = evidence_of(copy, dataset)
        if not success:
            return 1
    if at_smoke_scale:
        print(f"smoke: every stage ran below {folder}; its numbers mean nothing")
    else:
        print(f"evidence: written to {EVIDENCE}; `dvc repro` reads it")
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the copies, emptied first")
    parser.add_argument("datasets", nargs="+", help="names of datasets")
    parser.add_argument("--smoke", action="store_true", help="run the smallest scale")
    arguments = parser.parse_args()
    folder = arguments.folder.resolve()
    sys.exit(main(folder, arguments.datasets, arguments.smoke))
