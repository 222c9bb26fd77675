"""What identifies a run besides its outputs: the libraries that are locked, the options, and what
the stages cost.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from hashlib import sha256
from pathlib import Path


@dataclass(frozen=True)
class Costs:
    """What the stages took on one machine: of each its name and, in s, the time by the clock and of
    the processor.
    """

    machine: str
    scale: str
    stages: list[tuple[str, float, float]]


def measured_costs(file: Path) -> Costs:
    """The costs that `make bench-experiment` left in ``file``."""
    measured = json.loads(file.read_text(encoding="utf-8"))
    stages = [(stage["stage"], stage["elapsed"], stage["cpu"]) for stage in measured["stages"]]
    return Costs(measured["machine"], measured["scale"], stages)


def sha256_of(file: Path) -> str:
    """SHA-256 of a file, as `sha256sum` prints it."""
    return sha256(file.read_bytes()).hexdigest()


def locked_libraries(text: str) -> dict[str, str]:
    """Library → version of a lock file as pip reads it."""
    return dict(re.findall(r"^([A-Za-z0-9._-]+)(?:\[[^\]]*\])?==([^\s;\\]+)", text, re.MULTILINE))


def flat_options(section: object, path: str) -> dict[str, object]:
    """Dotted name → value of every option below a section, which is a dataclass, a mapping or a
    value.
    """
    values = asdict(section) if is_dataclass(section) else section
    if isinstance(values, Mapping) and values:
        options = {}
        for key, value in values.items():
            options |= flat_options(value, f"{path}.{key}")
        return options
    return {path: values}
