"""A dataset's datasheet: facts on its recordings, merged with the option file of the dataset."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import About
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated

DATASHEETS = Path(__file__).parents[2] / "data" / "raw"
OPEN = "???"  # a value that a person has yet to fill in


@dataclass(frozen=True)
class Datasheet:
    """Keys that the datasheet in ``file`` adds to the section ``dataset``, without ``about``."""

    file: Path
    values: dict[str, Any]

    def holds(self, key: str) -> bool:
        """Return True if the nested ``key`` of the dataset stands in it."""
        node: Any = self.values
        for part in key.split("."):
            if not isinstance(node, dict) or part not in node:
                return False
            node = node[part]
        return True


def path_of(dataset: str) -> Path:
    """File of a dataset's datasheet: beside its recordings, or in their place where they are read
    elsewhere.
    """
    return DATASHEETS / dataset / "dataset.yaml"


def read(file: Path) -> Datasheet:
    """Read the datasheet in ``file``; ConfigError where it cannot be read or ``about`` is
    incomplete.
    """
    values = read_yaml(file)
    about = values.pop("about", None)
    if about is None:
        raise ConfigError(
            "a datasheet needs about: subject, source and licence of its recordings",
            key="about",
            file=file,
        )
    if any(unfilled_keys(about)):
        _refuse(unfilled(file), file)
    validated(About, about, "about", file)
    return Datasheet(file, values)


def unfilled(file: Path) -> list[str]:
    """The keys of a YAML file that have ??? for a value."""
    return list(unfilled_keys(read_yaml(file)))


def require_apart(option: dict[str, Any], sheet: Datasheet, option_file: Path) -> None:
    """ConfigError for a key that stands both in the ``option`` of the dataset, of ``option_file``,
    and in its datasheet.
    """
    if keys := list(_common(option, sheet.values, "dataset.")):
        verb, of_each = ("stands", "them") if len(keys) == 1 else ("stand", "each")
        raise ConfigError(
            f"{', '.join(keys)} {verb} in {option_file.name} too: keep one of {of_each}",
            key=keys[0],
            file=sheet.file,
        )


def require_filled(composed: dict[str, Any], sheet: Datasheet, option_file: Path) -> None:
    """ConfigError with the file and all keys of the ``composed`` dataset that were left to fill in
    and that no override fills.
    """
    keys = list(unfilled_keys(composed.get("dataset")))
    mine = [key for key in keys if sheet.holds(key.partition("[")[0])]
    _refuse(mine, sheet.file)
    _refuse(keys, option_file)


def _common(option: dict[str, Any], sheet: dict[str, Any], prefix: str) -> Iterator[str]:
    """The keys that stand in both, down to where one of them holds a value."""
    for key in sheet:
        stated, other = sheet[key], option.get(key)
        if isinstance(stated, dict) and isinstance(other, dict):
            yield from _common(other, stated, f"{prefix}{key}.")
        elif key in option:
            yield f"{prefix}{key}"


def unfilled_keys(values: Any, key: str = "") -> Iterator[str]:
    """The keys of ``values`` that hold ???, in their order."""
    if isinstance(values, str) and values == OPEN:
        yield key
    elif isinstance(values, dict):
        for name, value in values.items():
            yield from unfilled_keys(value, f"{key}.{name}" if key else str(name))
    elif isinstance(values, list):
        for place, value in enumerate(values):
            yield from unfilled_keys(value, f"{key}[{place}]")


def _refuse(keys: Iterable[str], file: Path) -> None:
    if names := list(keys):
        raise ConfigError(
            f"fill in {', '.join(names)}: there is ??? for a value", key=names[0], file=file
        )
