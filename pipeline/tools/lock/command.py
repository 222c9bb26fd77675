"""``python -m pipeline lock``: stages of every dvc.lock in the order of its dvc.yaml, without those
that are gone.

DVC appends a stage when it first runs: after a run that was ended midway git would show a change.
"""

import re
from itertools import product
from pathlib import Path

from pipeline.core import contracts
from pipeline.core.typed_yaml import read_yaml

ARGUMENTS: dict = {}


def run() -> None:
    """Sort all lock files below the project's root, and print the changed ones."""
    changed = []
    for place in ("dvc.yaml", "data/raw/*/dvc.yaml", "pipeline/**/dvc.yaml"):
        for file in sorted(Path().glob(place)):
            lock = file.with_name("dvc.lock")
            text = lock.read_text(encoding="utf-8") if lock.is_file() else ""
            head, *entries = re.split(r"(?m)^  (?=\S)", text)
            by_name = {entry.partition(":")[0]: f"  {entry}" for entry in entries}
            ordered = head + "".join(by_name.get(name, "") for name in _stages(file))
            if ordered != text:
                contracts.write_text(ordered, lock)
                changed.append(str(lock))
    done = f"{', '.join(changed)} put in order" if changed else "every dvc.lock is in order"
    print(f"lock: {done}")


def _stages(file: Path) -> list[str]:
    """Stages of a dvc.yaml as the lock names them, those of a matrix one by one."""
    names = []
    for name, stage in read_yaml(file)["stages"].items():
        lists = [
            read_yaml(Path("params.yaml"))[values[2:-1]] if isinstance(values, str) else values
            for values in stage.get("matrix", {}).values()
        ]
        names += [f"{name}@{'-'.join(items)}" if lists else name for items in product(*lists)]
    return names
