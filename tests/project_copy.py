"""Copies of the project to run, edit and damage, and commands in them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from omegaconf import OmegaConf

ROOT = Path(__file__).parents[1]
# the reports that stages read and none writes
UNWRITTEN = ("reports/claims.yaml",)
COMPILED = {".pyc", ".nbi", ".nbc"}  # by Python and by Numba
# one process: so little work takes less time than starting workers
SMOKE = {"scale": "smoke", "compute": "serial", "models": "[additive, wishart, gaussian]"}

GIT = [
    "git",
    "-c",
    "user.name=test",
    "-c",
    "user.email=test@example.org",
    "-c",
    "init.defaultBranch=main",
]


def run(*command: str, cwd: Path, seconds: float | None = None) -> subprocess.CompletedProcess:
    """Run a command in ``cwd`` without this process's environment variables; output captured.
    TimeoutExpired after ``seconds``.
    """
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {"PATH": path, "HOME": str(cwd), "GIT_CONFIG_NOSYSTEM": "1"} | {
        f"GIT_{who}_{what}": "test@example.org"
        for who in ("AUTHOR", "COMMITTER")
        for what in ("NAME", "EMAIL")
    }
    return subprocess.run(
        command,
        cwd=cwd,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=seconds,
    )


def copy_project(folder: Path) -> None:
    """Copy every file that git knows or would add, none of what stages wrote; the copy is a DVC
    project of its own, without git.
    """
    listed = subprocess.run(
        ["git", "ls-files", "-z", "-co", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    for name in filter(None, listed.stdout.split("\0")):
        source = ROOT / name
        written = (name.startswith("reports/") and name not in UNWRITTEN) or Path(
            name
        ).name == "dvc.lock"
        if source.is_file() and not written:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, folder / name, follow_symlinks=False)
    # compiled files stay valid: copies keep the times and sizes of their sources
    for compiled in (ROOT / "pipeline").rglob("__pycache__/*"):
        # files that another process is still writing have another suffix
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
    """The stages that ``dvc repro --dry`` lists in ``output``, in their order, each with the words
    that follow ``python -m pipeline``.
    """
    return dict(
        re.findall(r"^Running stage '(.+)':\n> python -m pipeline (.+)$", output, re.MULTILINE)
    )


def reruns(folder: Path, configure: bool = True) -> set[str]:
    """The stages that ``dvc repro`` would run after an edit, at most, once ``configure`` has run:
    whose dependencies have changed, and all that follow them.
    """
    if configure:
        done = run("dvc", "repro", "configure", cwd=folder)
        assert done.returncode == 0, done.stdout + done.stderr
    plan = run("dvc", "repro", "--dry", "--force-downstream", cwd=folder)
    assert plan.returncode == 0, plan.stdout + plan.stderr
    return set(planned(plan.stdout))


def outputs(folder: Path, *stages: str) -> dict[str, str]:
    """Hash of every output in the lock files of the paper and of its recordings, or of those of
    ``stages``, but of the configuration, which names where trials run.
    """
    locked = {}
    for file in (folder / "dvc.lock", folder / "data/raw/youbot/dvc.lock"):
        for name, stage in OmegaConf.to_container(OmegaConf.load(file))["stages"].items():
            if not stages or name in stages:
                locked |= {out["path"]: out["md5"] for out in stage["outs"]}
    locked.pop("data/config.yaml", None)
    return locked


def edit_text(file: Path, text: str) -> None:
    """Replace ``file``, which may be a link into DVC's cache, by another of this text."""
    file.unlink()
    file.write_text(text, newline="")
