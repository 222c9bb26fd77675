"""A dataset's datasheet: what is known of its recordings, put together with what the option file
lets the analysis do with them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf

from pipeline.core.errors import ConfigError
from pipeline.core.options.about import About
from pipeline.core.typed_yaml import load_yaml, read_yaml, typed

DATASHEETS = Path(__file__).parents[2] / "data" / "raw"


@dataclass(frozen=True)
class Datasheet:
    """What the datasheet in ``file`` adds to the section ``dataset``: all its keys but the text
    ``about``.
    """

    file: Path
    values: DictConfig

    def holds(self, key: str) -> bool:
        """Whether it says anything of the nested ``key`` of the dataset."""
        node = self.values
        for part in key.split("."):
            if not isinstance(node, DictConfig) or (node := node._get_node(part)) is None:
                return False
        return True


def path_of(dataset: str) -> Path:
    """Where the datasheet of a dataset stands: beside its recordings, or in their place where they
    are read elsewhere.
    """
    return DATASHEETS / dataset / "dataset.yaml"


def read(file: Path) -> Datasheet:
    """The datasheet in ``file``; ConfigError where it cannot be read, and for ``about`` that is
    incomplete.
    """
    values = load_yaml(file)
    about = values.pop("about", None)
    if about is None:
        raise ConfigError(
            "a datasheet says in about what its recordings are, whence and on which terms",
            key="about",
            file=file,
        )
    if isinstance(about, DictConfig) and any(unfilled_keys(OmegaConf.to_container(about))):
        _refuse(unfilled(file), file)
    try:
        typed(About, about, "about")
    except ConfigError as error:
        raise ConfigError(error.message, key=error.evidence.get("key"), file=file) from None
    return Datasheet(file, values)


def unfilled(file: Path) -> list[str]:
    """The keys of a YAML file that have ??? for a value."""
    return list(unfilled_keys(read_yaml(file)))


def require_apart(option: DictConfig, sheet: Datasheet, option_file: Path) -> None:
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


def require_filled(composed: DictConfig, sheet: Datasheet, option_file: Path) -> None:
    """ConfigError with the file and all keys of the ``composed`` dataset that were left to fill in
    and that no override fills.
    """
    keys = list(unfilled_keys(OmegaConf.to_container(composed).get("dataset")))
    mine = [key for key in keys if sheet.holds(key.partition("[")[0])]
    _refuse(mine, sheet.file)
    _refuse(keys, option_file)


def _common(option: DictConfig, sheet: DictConfig, prefix: str) -> Iterator[str]:
    """The keys that stand in both, down to where one of them holds a value."""
    for key in sheet:
        stated, other = sheet._get_node(key), option._get_node(key)
        if (
            isinstance(stated, DictConfig)
            and isinstance(other, DictConfig)
            and not (stated._is_none() or other._is_none())
        ):
            yield from _common(other, stated, f"{prefix}{key}.")
        elif other is not None:
            yield f"{prefix}{key}"


def unfilled_keys(values: Any, key: str = "") -> Iterator[str]:
    """The keys of ``values`` that hold ???, in their order; as OmegaConf.missing_keys, without
    resolving what refers to another file.
    """
    if values == MISSING:
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
