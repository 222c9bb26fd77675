"""``python -m pipeline audit FOLDER``: run all stages in a clone of the last commit and compare all
files with the committed files.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.environment import NOT_EQUAL, has_equal_bytes
from pipeline.core.errors import PipelineError
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.lock.command import stage_names

NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
# difference of numbers where the instruction set is not the commit's: searches end within 1e-6
ROUNDING = 1e-5


def run(folder: Path) -> None:
    """Clone the last commit to ``folder``, delete the outputs of the stages, run the stages and
    print the files that differ from the commit. Raises PipelineError for any difference.
    """
    root = Path.cwd()
    print(f"audit: commit {_git(root, 'rev-parse', 'HEAD').strip()}", flush=True)
    if edited := _git(root, "status", "--porcelain").splitlines():
        names = ", ".join(line[3:] for line in edited)
        print(f"audit: not committed, and left out: {names}", flush=True)
    project = clone_commit(root, folder.resolve())
    environment = os.environ | {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        "DVC_NO_ANALYTICS": "1",
        # DVC's state of files between runs, by default outside the project
        "DVC_SITE_CACHE_DIR": str(project / ".dvc/tmp/site"),
    }
    stages = _locked_stages(project)
    _remove_outputs(stages, project)
    repro = [sys.executable, "-m", "dvc", "repro", "--all-pipelines", "--force"]
    ran = subprocess.run(repro, cwd=project, env=environment, stdout=sys.stderr)
    if ran.returncode or not stages:
        raise PipelineError(
            "`dvc repro -P` failed; its message is above",
            folder=project,
        )
    # the lock files contain the hashes of files that are not in git
    changed = _git(project, "status", "--porcelain").splitlines()
    equal = "equal to the commit"
    if not has_equal_bytes():
        print(f"audit: {NOT_EQUAL}")
        changed = [line for line in changed if not _rounded(project, line)]
        equal = f"within {ROUNDING:g} of the commit; images and hashes are not compared"
    if changed:
        print("\n".join([*changed, _git(project, "diff", "--stat")]), end="")
        message = f"{len(changed)} files differ from the commit after a run of all"
        raise PipelineError(
            f"{message} stages; see `git -C '{project}' diff`",
            folder=project,
        )
    print(f"audit: {len(stages)} stages run again, every file {equal}")


def _locked_stages(project: Path) -> list[dict[str, Any]]:
    """Return the entries of the lock files of a ``project``, without removed stages."""
    stages = []
    for file in project.rglob("dvc.yaml"):
        lock = file.with_name("dvc.lock")
        entries = read_yaml(lock).get("stages", {}) if lock.is_file() else {}
        if not entries:
            continue
        for name in stage_names(file, project / "params.yaml"):
            if name in entries:
                stages.append(entries[name])
    return stages


def _remove_outputs(stages: list[dict[str, Any]], project: Path) -> None:
    for stage in stages:
        for entry in stage.get("outs", []):
            out = project / entry["path"]
            if out.is_dir():
                shutil.rmtree(out)
            else:
                out.unlink(missing_ok=True)


def _rounded(project: Path, line: str) -> bool:
    """Return True if a changed file (a ``line`` of git's status) is an image or a lock file, or
    agrees with the commit but for the rounding of numbers.
    """
    status = line[:2].strip()
    name = line[3:].strip('"')
    if status != "M" or name.endswith((".png", ".svg", "dvc.lock")):
        return status == "M"
    after = (project / name).read_text(encoding="utf-8")
    return agree(_git(project, "show", f"HEAD:{name}"), after)


def agree(before: str, after: str) -> bool:
    """Return True if two texts differ at most in numbers, by ROUNDING relative or absolute."""
    if NUMBER.sub("", before) != NUMBER.sub("", after):
        return False
    old = np.array(NUMBER.findall(before), float)
    new = np.array(NUMBER.findall(after), float)
    return np.allclose(old, new, rtol=ROUNDING, atol=ROUNDING)


def clone_commit(root: Path, folder: Path) -> Path:
    """Clone the commit of ``root`` into ``folder`` without DVC's cache, link recordings that a
    datasheet places outside the project, and return the clone.
    """
    folder.mkdir(parents=True, exist_ok=True)
    project = folder / "project"
    shutil.rmtree(project, ignore_errors=True)
    _git(folder, "clone", "--quiet", str(root), str(project))
    if not (project / "dvc.lock").is_file():
        raise PipelineError(
            "dvc.lock is not committed; run `dvc repro` and commit it",
            file=root,
        )
    for sheet in sorted(root.glob("data/raw/*/dataset.yaml")):
        up, *names = Path(read_yaml(sheet).get("recordings", "")).parts or ("",)
        if up == ".." and names and not (folder / names[0]).is_symlink():
            (folder / names[0]).symlink_to(root.parent / names[0])
    return project


def _git(folder: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        message = f"git {words[0]}: {' '.join(done.stderr.split())}"
        raise PipelineError(
            f"{message}; an audit needs a repository with a commit",
            folder=folder,
        )
    return done.stdout
