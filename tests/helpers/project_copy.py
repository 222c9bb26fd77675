"""Copies of the project to run, edit and damage, and commands in them."""

import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from omegaconf import OmegaConf

ROOT = Path(__file__).parents[2]
# one process: so little work takes less time than starting workers
SMOKE = {
    "scale": "smoke",
    "compute": "serial",
    "models": "[additive, wishart, gaussian]",
}
GIT = ["git", "-c", "init.defaultBranch=main"]
BY_HAND = {"reports/glossary.md"}  # pages of reports/ that no stage writes
# in one process: half the time of a run goes into starting a process for each stage
EVERY_COMMAND = """
import shlex, sys
from pipeline.__main__ import main

for words in map(shlex.split, sys.argv[1:]):
    sys.argv = ["pipeline", *words]
    if main() != 0:
        sys.exit(f"{shlex.join(words)} failed")
"""
NAMES = "GIT_AUTHOR_NAME GIT_AUTHOR_EMAIL GIT_COMMITTER_NAME GIT_COMMITTER_EMAIL"
IDENTITY = dict.fromkeys(NAMES.split(), "test@example.org")


def run(
    *command: str,
    cwd: Path,
    seconds: float | None = None,
    home: bool = True,
    umask: int = -1,
    **environment: str,
) -> subprocess.CompletedProcess:
    """Run a command in ``cwd``, with PATH alone of this process's environment, and as HOME a folder
    that git ignores; output captured. TimeoutExpired after ``seconds``.
    """
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    places = {"PATH": path, "GIT_CONFIG_NOSYSTEM": "1"}
    if home:
        places["HOME"] = str(cwd / ".dvc/tmp/home")
    return subprocess.run(
        command,
        cwd=cwd,
        env=places | IDENTITY | environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        timeout=seconds,
        umask=umask,
    )


def succeeds(*command: str, cwd: Path, **options: object) -> str:
    """Run a command that must succeed; return its standard output."""
    done = run(*command, cwd=cwd, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def error_line(done: subprocess.CompletedProcess) -> str:
    """The project's own message, one line, among the errors of a failed command."""
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("error:"))
    assert done.returncode != 0 and "Traceback" not in done.stderr
    return line


def copy_project(folder: Path) -> None:
    """Copy every file that git tracks or would add, without outputs of stages; the copy is a DVC
    project of its own, without git.
    """
    listed = succeeds("git", "ls-files", "-z", "-co", "--exclude-standard", cwd=ROOT)
    for name in filter(None, listed.split("\0")):
        source = ROOT / name
        target = folder / name
        written = name.startswith("reports/") and name not in BY_HAND
        written |= source.name == "dvc.lock"
        if source.is_file() and not written:
            target.parent.mkdir(parents=True, exist_ok=True)
            # compiled code stays valid: copies keep the times and sizes of their sources
            shutil.copy2(source, target, follow_symlinks=False)

    for compiled in (ROOT / "pipeline").rglob("__pycache__/*.pyc"):
        (folder / compiled.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(compiled, folder / compiled.relative_to(ROOT))

    (folder / ".dvc/config.local").write_text("[core]\n    no_scm = true\n")
    share_machine_code(folder)


def copy_reproduced(reproduced: Path, folder: Path) -> Path:
    """Copy the reproduced project with what its stages wrote and their cache; return ``folder``."""
    shutil.copytree(reproduced, folder, symlinks=True)
    share_machine_code(folder)
    return folder


def share_machine_code(folder: Path) -> None:
    """Let a copy of the project load from this project's machine code, and add to it: numba names
    the folders of its cache after the absolute paths of the sources.
    """
    from pipeline.core.compiled import cache_folder

    code = cache_folder()
    links = folder / "pipeline/__pycache__" / code.name
    links.mkdir(parents=True, exist_ok=True)
    for package in {file.parent for file in (ROOT / "pipeline").rglob("*.py")}:
        here = code / numba_folder(package)
        here.mkdir(exist_ok=True)
        (links / numba_folder(folder / package.relative_to(ROOT))).symlink_to(here)


def numba_folder(package: Path) -> str:
    """The name of numba's folder for the machine code of a package."""
    return f"{package.name}_{hashlib.sha1(str(package).encode()).hexdigest()}"


def set_parameters(folder: Path, **values: object) -> None:
    """Edit top-level lines of the copy's params.yaml, comments kept."""
    file = folder / "params.yaml"
    text = file.read_text(encoding="utf-8")
    for name, value in values.items():
        text, lines = re.subn(rf"(?m)^{name}:.*$", f"{name}: {value}", text)
        assert lines == 1, name
    file.write_text(text, encoding="utf-8")


def planned(output: str) -> dict[str, str]:
    """The stages that ``dvc repro --dry`` lists in ``output``, in their order, each with the words
    that follow ``python -m pipeline``.
    """
    return dict(
        re.findall(
            r"^Running stage '(.+)':\n> python -m pipeline (.+)$",
            output,
            re.MULTILINE,
        ),
    )


def in_one_process(folder: Path, *targets: str) -> tuple[list[str], str]:
    """Run every stage of the plan of ``dvc repro`` in one process; their names and output."""
    stages = planned(succeeds("dvc", "repro", "--force", "--dry", *targets, cwd=folder))
    return [*stages], succeeds(
        "python",
        "-c",
        EVERY_COMMAND,
        *stages.values(),
        cwd=folder,
    )


def outputs(folder: Path, *stages: str) -> dict[str, str]:
    """Hash of every output in the lock files of the paper and of its recordings, or of ``stages``
    alone, without the configuration, which names where trials run.
    """
    locked = {}
    for file in (folder / "dvc.lock", folder / "data/raw/youbot/dvc.lock"):
        for name, stage in OmegaConf.load(file).stages.items():
            if not stages or name in stages:
                locked |= {out["path"]: out["md5"] for out in stage["outs"]}

    locked.pop("data/config.yaml", None)
    return locked


def edit_text(file: Path, text: str) -> None:
    """Replace ``file``, which may be a link into DVC's cache, by another of this text."""
    file.unlink()
    file.write_text(text, newline="", encoding="utf-8")


def make_writable(folder: Path) -> None:
    """Make files writable that DVC has linked from its cache."""
    for file in folder.rglob("*"):
        if file.is_file() and not file.is_symlink():
            file.chmod(0o644)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below ``folder`` by its path there."""
    files = (file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def shell_commands(page: str, word: str = "") -> list[list[str]]:
    """The commands of the shell blocks of the project's ``page`` that hold ``word``."""
    blocks = re.findall(
        r"```sh\n(.*?)```",
        (ROOT / page).read_text(encoding="utf-8"),
        re.DOTALL,
    )
    lines = [line for block in blocks if word in block for line in block.splitlines()]
    return [shlex.split(line, comments=True) for line in lines]
