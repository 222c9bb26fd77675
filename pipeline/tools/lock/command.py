"""``python -m pipeline lock``: mend what a killed DVC leaves, sort the entries of every dvc.lock as
in its dvc.yaml and delete removed stages.

DVC appends a stage when it first runs, so that git would show a change after an interrupted run.
"""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from pipeline.core import contracts
from pipeline.core.errors import PipelineError
from pipeline.core.typed_yaml import parse_yaml, read_yaml

CONFLICT = "<<<<<<< "  # mark of git's, in a file that is to be merged


def run() -> None:
    """Mend DVC's state, sort the entries of all lock files, without an entry that is cut off, and
    print the names of changed files.
    """
    changed = [str(path) for path in _mend()]
    for place in ("dvc.lock", "data/raw/*/dvc.lock", "pipeline/**/dvc.lock"):
        for lock in sorted(Path().glob(place)):
            text = lock.read_text(encoding="utf-8")
            head, *entries = re.split(r"(?m)^(?=  \S)", text)
            # DVC was killed while it wrote the last entry that is there
            if not _is_sound(text):
                entries = entries[:-1]
                if CONFLICT in text or (
                    entries and not _is_sound(head + "".join(entries))
                ):
                    continue  # another fault, which DVC names
            if not entries:
                lock.unlink()
                changed.append(str(lock))
                continue
            by_name = {entry[2:].partition(":")[0]: entry for entry in entries}
            names = stage_names(lock.with_name("dvc.yaml"))
            ordered = head + "".join(by_name.get(name, "") for name in names)
            if ordered != text:
                contracts.write_text(ordered, lock)
                changed.append(str(lock))
    done = (
        f"{', '.join(changed)} put in order"
        if changed
        else "every dvc.lock is in order"
    )
    print(f"lock: {done}")


def _is_sound(text: str) -> bool:
    """Return whether DVC can read the ``text`` of a lock file."""
    from dvc.schema import COMPILED_LOCKFILE_SCHEMA
    from voluptuous import Invalid

    try:
        COMPILED_LOCKFILE_SCHEMA(parse_yaml(text))
    except (PipelineError, Invalid):
        return False
    return True


def _mend() -> Iterator[Path]:
    """Remove and yield what DVC fails on after a kill: an unreadable file of its locks, and empty
    folders in its cache of runs.
    """
    if (locks := Path(".dvc/tmp/rwlock")).is_file():
        try:
            json.loads(locks.read_text(encoding="utf-8"))
        except ValueError:
            locks.unlink()
            yield locks
    command = [sys.executable, "-m", "dvc", "cache", "dir"]
    cache = subprocess.run(command, capture_output=True, text=True).stdout.strip()
    for run in Path(cache, "runs").glob("*/*"):
        if not any(run.iterdir()):
            run.rmdir()
            yield run


def stage_names(file: Path, params: Path = Path("params.yaml")) -> list[str]:
    """Return the stage names of a dvc.yaml as in the lock file: one per item of a matrix."""
    names = []
    for name, stage in read_yaml(file)["stages"].items():
        lists = [
            read_yaml(params)[values[2:-1]] if isinstance(values, str) else values
            for values in stage.get("matrix", {}).values()
        ]
        names += [
            f"{name}@{'-'.join(items)}" if lists else name for items in product(*lists)
        ]
    return names
