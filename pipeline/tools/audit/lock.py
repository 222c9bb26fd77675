"""What the lock files of DVC hold: the hash of every output, and what its stage was run on."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.core.typed_yaml import read_yaml

LOCKS = ("dvc.lock", "data/raw/*/dvc.lock")


@dataclass(frozen=True)
class Entry:
    """A stage in a lock file: the hashes of its outputs and of its dependencies by path, its
    command and its parameters.
    """

    outputs: Mapping[str, str]
    inputs: Mapping[str, object]


def lock_files(project: Path) -> list[str]:
    """The lock files of a project, from its root."""
    return sorted(
        file.relative_to(project).as_posix() for pattern in LOCKS for file in project.glob(pattern)
    )


def read_locks(project: Path) -> dict[str, Entry]:
    """The stages in the lock files of a project by the names that DVC prints. Raises ConfigError
    for a file that cannot be read.
    """
    outputs = {}
    for file in lock_files(project):
        folder = Path(file).parent.as_posix()
        prefix = "" if folder == "." else f"{folder}/dvc.yaml:"
        outputs |= {
            prefix + name: _entry(stage)
            for name, stage in read_yaml(project / file).get("stages", {}).items()
        }
    return outputs


def changed_inputs(committed: Entry, rerun: Entry, written: Collection[str]) -> list[str]:
    """What the two were not run alike on: paths, parameters by file and section, or the command;
    but for what stages have ``written``.
    """
    names = [
        name
        for name in {**committed.inputs, **rerun.inputs}
        if committed.inputs.get(name) != rerun.inputs.get(name)
    ]
    return [name for name in names if not any(_overlap(Path(name), Path(path)) for path in written)]


def _overlap(path: Path, other: Path) -> bool:
    """Whether one is the other or lies in it."""
    return path == other or path in other.parents or other in path.parents


def _entry(stage: Mapping) -> Entry:
    inputs: dict[str, object] = {"the command": stage["cmd"]}
    inputs |= {dep["path"]: dep["md5"] for dep in stage.get("deps", [])}
    inputs |= {
        f"{file}: {key}": value
        for file, values in stage.get("params", {}).items()
        for key, value in values.items()
    }
    return Entry({out["path"]: out["md5"] for out in stage.get("outs", [])}, inputs)
