"""``python -m pipeline lock``: the stages of every dvc.lock in the order of its dvc.yaml, without
those that are gone.

DVC appends a stage when it first runs, so that after a run that was ended midway git shows a change
where there is none.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from pipeline.core import contracts
from pipeline.core.typed_yaml import read_yaml

ENTRY = re.compile(r"^  (?=\S)", re.MULTILINE)


def run(words: list[str]) -> None:
    """Sort all lock files below the project's root, and say which have changed."""
    argparse.ArgumentParser(
        prog="python -m pipeline lock", description=__doc__.partition(": ")[2]
    ).parse_args(words)
    places = [Path("dvc.yaml"), *sorted(Path("data/raw").glob("*/dvc.yaml"))]
    places += sorted(Path("pipeline").rglob("dvc.yaml"))
    for file in (place.with_name("dvc.lock") for place in places):
        if not file.is_file():
            continue
        text = file.read_text(encoding="utf-8")
        stages = list(_names(file.with_name("dvc.yaml")))
        if (ordered := in_order(text, stages)) != text:
            contracts.write_text(ordered, file)
            print(f"lock: {file} put in order")


def in_order(lock: str, stages: list[str]) -> str:
    """The text of a lock file with the entries of ``stages`` in their order, and no others."""
    head, *entries = ENTRY.split(lock)
    by_name = {entry.partition(":")[0]: entry for entry in entries}
    return head + "".join(f"  {by_name[name]}" for name in stages if name in by_name)


def _names(file: Path) -> Iterator[str]:
    """The stages of a dvc.yaml as the lock names them, those of a matrix one by one; a list that a
    matrix names as ``${key}`` stands in params.yaml.
    """
    for name, stage in read_yaml(file)["stages"].items():
        lists = [
            read_yaml(Path("params.yaml"))[values[2:-1]] if isinstance(values, str) else values
            for values in stage.get("matrix", {}).values()
        ]
        for items in product(*lists):
            yield f"{name}@{'-'.join(items)}" if lists else name
