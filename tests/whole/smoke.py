"""The whole pipeline on the smallest scale, in a copy of the project: ``python
tests/whole/smoke.py FOLDER``.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
from project_copy import SMOKE, copy_project, set_parameters


def main(folder: Path) -> int:
    """Copy the project, set the scale to smoke, reproduce; the exit code of ``dvc repro``."""
    shutil.rmtree(folder, ignore_errors=True)  # the files of an earlier run
    copy_project(folder)
    set_parameters(folder, **SMOKE)
    done = subprocess.run(["dvc", "repro"], cwd=folder, check=False)
    if done.returncode == 0:
        print(
            f"smoke: the whole pipeline ran in {folder}; its numbers mean nothing, its figures "
            f"are in {folder / 'reports' / 'DATASET' / 'figures'}"
        )
    return done.returncode


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
