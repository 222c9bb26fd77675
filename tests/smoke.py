"""The whole pipeline on the smallest scale, in a copy of the project: ``python tests/smoke.py FOLDER``."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
UNWRITTEN = ("reports/claims.yaml", "reports/benchmarks/experiment.json")  # the reports that stages read and none writes
COMPILED = {".pyc", ".nbi", ".nbc"}  # by Python and by Numba
# so little work is done sooner in one process than workers are started
SMOKE = {"scale": "smoke", "compute": "serial", "models": "[additive, wishart, gaussian]"}


def copy_project(folder: Path) -> None:
    """Copy every file that git knows or would add, none of what stages wrote; the copy is a DVC project of its own, without git."""
    listed = subprocess.run(["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=ROOT, check=True, capture_output=True, text=True)
    for name in filter(None, listed.stdout.split("\0")):
        source = ROOT / name
        written = (name.startswith("reports/") and name not in UNWRITTEN) or Path(name).name == "dvc.lock"
        if source.is_file() and not written:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, folder / name, follow_symlinks=False)
    # what is compiled of equal sources need not be compiled again; times and sizes decide, and copies keep them
    for compiled in (ROOT / "pipeline").rglob("__pycache__/*"):
        # not what another process is writing, which has its own name only when it is whole
        if compiled.suffix in COMPILED:
            (folder / compiled.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(compiled, folder / compiled.relative_to(ROOT))
    (folder / ".dvc/config.local").write_text("[core]\n    no_scm = true\n")


def set_parameters(folder: Path, **values: object) -> None:
    """Edit top-level lines of the copy's params.yaml, comments kept."""
    file = folder / "params.yaml"
    lines = file.read_text().splitlines()
    for name, value in values.items():
        place = next(i for i, line in enumerate(lines) if line.startswith(f"{name}:"))
        lines[place] = f"{name}: {value}"
    file.write_text("\n".join(lines) + "\n")


def planned(output: str) -> dict[str, str]:
    """Of what ``dvc repro --dry`` says: the stages in their order, each with the words that follow ``python -m pipeline``."""
    return dict(re.findall(r"^Running stage '(.+)':\n> python -m pipeline (.+)$", output, re.MULTILINE))


def main(folder: Path) -> int:
    """Copy, set the scale to smoke, reproduce."""
    # what an earlier smoke run left is of no use to this one
    shutil.rmtree(folder, ignore_errors=True)
    copy_project(folder)
    set_parameters(folder, **SMOKE)
    done = subprocess.run(["dvc", "repro"], cwd=folder, check=False)
    if done.returncode == 0:
        print(f"smoke: the whole pipeline ran in {folder}; its numbers mean nothing, its figures are in {folder / 'reports/figures'}")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
