"""Two clones of what is committed: one as it is, and one in which every stage runs again, with
nothing that an earlier run left.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from pipeline.core.errors import PipelineError
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.audit.lock import lock_files, read_locks

COMMITTED, RERUN = "committed", "rerun"
DVC = (sys.executable, "-m", "dvc")


def commit(root: Path) -> str:
    """The commit that the repository is at. Raises PipelineError where there is none."""
    return _git(root, "rev-parse", "HEAD").strip()


def changes(root: Path) -> list[str]:
    """The files that are not as committed."""
    return [line[3:] for line in _git(root, "status", "--porcelain").splitlines()]


def clone(root: Path, folder: Path) -> tuple[Path, Path]:
    """Two clones of the commit of ``root`` in ``folder``: as committed, and to be run. Neither has
    a cache of DVC.

    What lies beside the project lies beside the clones too: recordings that are read in place.
    """
    folder.mkdir(parents=True, exist_ok=True)
    clones = folder / COMMITTED, folder / RERUN
    for copy in clones:
        shutil.rmtree(copy, ignore_errors=True)
        _git(folder, "clone", "--quiet", str(root), str(copy))
        if not lock_files(copy):
            raise PipelineError(
                "no lock file is committed, so there is nothing to compare a run with; run `dvc "
                "repro` and commit",
                file=root,
            )
    for sheet in sorted(root.glob("data/raw/*/dataset.yaml")):
        up, *names = Path(read_yaml(sheet).get("recordings", "")).parts or ("",)
        if up == ".." and names and not (folder / names[0]).is_symlink():
            (folder / names[0]).symlink_to(root.parent / names[0])
    return clones


def rerun(project: Path) -> list[str]:
    """Run every stage of the clone ``project`` anew and return their names; DVC's messages go to
    standard error.

    What the stages are to write is taken away first, so that nothing is judged that this run did
    not write.
    """
    environment = os.environ | {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        "DVC_NO_ANALYTICS": "1",
        # what DVC remembers of files between runs lies outside its cache
        "DVC_SITE_CACHE_DIR": str(project / ".dvc/tmp/site"),
    }
    repro = [*DVC, "repro", "--force"]
    planned = subprocess.run(
        [*repro, "--dry"],
        cwd=project,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    names = re.findall(r"^Running stage '([^']+)'", planned.stdout, re.MULTILINE)
    if planned.returncode or not names:
        raise PipelineError(
            "DVC cannot say which stages it would run; its message stands above", file=project
        )
    locked = read_locks(project)
    for path in [path for name in names if name in locked for path in locked[name].outputs]:
        _remove(project / path)
    if subprocess.run(
        repro, cwd=project, env=environment, stdout=sys.stderr, check=False
    ).returncode:
        raise PipelineError(
            "the run of the clone ended with an error, which stands above", file=project
        )
    return names


def fetch_cached(committed: Path, root: Path, paths: Sequence[str]) -> None:
    """Put those of ``paths`` into the clone that the cache of the project at ``root`` holds:
    outputs that git does not.
    """
    wanted = [path for path in paths if not (committed / path).exists()]
    if wanted:
        cache = subprocess.run(
            [*DVC, "cache", "dir"], cwd=root, capture_output=True, text=True, check=True
        ).stdout.strip()
        (committed / ".dvc/config.local").write_text(
            f'[cache]\n    dir = "{cache}"\n    type = copy\n'
        )
        # it fails where the cache lacks one of them, and has then taken the others out
        subprocess.run(
            [*DVC, "checkout", "--allow-missing", *wanted],
            cwd=committed,
            capture_output=True,
            check=False,
        )


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _git(folder: Path, *words: str) -> str:
    try:
        done = subprocess.run(
            ["git", *words], cwd=folder, capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        raise PipelineError("git is missing; install it") from None
    if done.returncode:
        raise PipelineError(
            f"git {words[0]}: {' '.join(done.stderr.split())}; an audit needs a repository with "
            "a commit",
            file=folder,
        )
    return done.stdout
