"""What a page of results was made of: the hashes of every stage's output, and the libraries that are locked."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from hashlib import sha256
from pathlib import Path

CONFIGURATION = "data/config.yaml"


@dataclass(frozen=True)
class Output:
    """A file or folder that a stage wrote, and its MD5 in a lock file of DVC (of a folder that of the list of its files)."""

    stage: str
    path: str
    md5: str


@dataclass(frozen=True)
class Costs:
    """What the stages took on one machine: of each its name and, in s, the time by the clock and of the processor."""

    machine: str
    scale: str
    stages: list[tuple[str, float, float]]


def measured_costs(file: Path) -> Costs:
    """The costs that `make bench-experiment` left in ``file``."""
    measured = json.loads(file.read_text(encoding="utf-8"))
    stages = [(stage["stage"], stage["elapsed"], stage["cpu"]) for stage in measured["stages"]]
    return Costs(measured["machine"], measured["scale"], stages)


def locked_outputs(lock: Mapping[str, Mapping], names: Sequence[str], models: Sequence[str]) -> list[Output]:
    """The outputs of the stages ``names``, once or for each of ``models``, in the ``lock`` as DVC has it.

    Entries of models that are no longer chosen stay in a lock file and are passed over. The configuration is left out: it says where
    trials run, which changes no result.
    """
    asked = [of for name in names for of in (name, *(f"{name}@{model}" for model in models))]
    outputs = [(of, out) for of in asked for out in lock.get(of, {}).get("outs", [])]
    return [Output(of, out["path"], out["md5"]) for of, out in outputs if out["path"] != CONFIGURATION]


def sha256_of(file: Path) -> str:
    """SHA-256 of a file, as `sha256sum` prints it."""
    return sha256(file.read_bytes()).hexdigest()


def locked_libraries(text: str) -> dict[str, str]:
    """Library → version of a lock file as pip reads it."""
    return dict(re.findall(r"^([A-Za-z0-9._-]+)(?:\[[^\]]*\])?==([^\s;\\]+)", text, re.MULTILINE))


def options_of(section: object, path: str) -> dict[str, object]:
    """Dotted name → value of every option below a section, which is a dataclass, a mapping or a value."""
    values = asdict(section) if is_dataclass(section) else section
    if isinstance(values, Mapping) and values:
        found = {}
        for key, value in values.items():
            found |= options_of(value, f"{path}.{key}")
        return found
    return {path: values}
