"""``python -m pipeline lock``: sort the entries of every dvc.lock as in its dvc.yaml and delete
removed stages.

DVC appends a stage when it first runs, so that git would show a change after an interrupted run.
"""

import re
from itertools import product
from pathlib import Path

from pipeline.core import contracts
from pipeline.core.typed_yaml import read_yaml

ARGUMENTS: dict = {}


def run() -> None:
    """Sort the entries of all lock files and print the names of changed files."""
    changed = []
    for place in ("dvc.lock", "data/raw/*/dvc.lock", "pipeline/**/dvc.lock"):
        for lock in sorted(Path().glob(place)):
            text = lock.read_text(encoding="utf-8")
            head, *entries = re.split(r"(?m)^  (?=\S)", text)
            by_name = {entry.partition(":")[0]: f"  {entry}" for entry in entries}
            names = _stage_names(lock.with_name("dvc.yaml"))
            ordered = head + "".join(by_name.get(name, "") for name in names)
            if ordered != text:
                contracts.write_text(ordered, lock)
                changed.append(str(lock))
    done = f"{', '.join(changed)} put in order" if changed else "every dvc.lock is in order"
    print(f"lock: {done}")


def _stage_names(file: Path) -> list[str]:
    """Return the stage names of a dvc.yaml as in the lock file: one per item of a matrix."""
    names = []
    for name, stage in read_yaml(file)["stages"].items():
        lists = [
            read_yaml(Path("params.yaml"))[values[2:-1]] if isinstance(values, str) else values
            for values in stage.get("matrix", {}).values()
        ]
        names += [f"{name}@{'-'.join(items)}" if lists else name for items in product(*lists)]
    return names
