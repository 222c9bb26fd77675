"""YAML files of keys and values, and what they hold checked against dataclasses.

YAML is read as OmegaConf reads it, and nowhere else: PyYAML takes 1e-3 for a text.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf._utils import get_yaml_loader
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from pipeline.core.errors import ConfigError

MOST_BYTES = 1 << 24  # of a file
MOST_LEVELS = 50  # of lists and mappings in one another
MOST_VALUES = 200_000  # of a file, what it repeats by reference counted each time


class Loader(yaml.cyaml.CParser, get_yaml_loader()):
    """OmegaConf's own, its text parsed by libyaml: every stage reads dvc.yaml, and would spend more
    on it than on many a table.
    """

    def __init__(self, stream: str | bytes) -> None:
        yaml.cyaml.CParser.__init__(self, stream)
        yaml.constructor.SafeConstructor.__init__(self)
        yaml.resolver.Resolver.__init__(self)


def load_yaml(file: Path) -> DictConfig:
    """What a YAML file of keys and values holds; ConfigError where it cannot be read, or is
    something else.
    """
    try:
        return OmegaConf.create(read_yaml(file))
    except (OmegaConfBaseException, ValueError) as error:
        raise ConfigError(
            f"cannot be read as YAML: {' '.join(str(error).split())}", file=file
        ) from None


def read_yaml(file: Path) -> dict:
    """As :func:`load_yaml`, as plain data."""
    try:
        with file.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
        require_bounded(content)
        loaded = yaml.load(content, Loader)
    except FileNotFoundError:
        raise ConfigError(
            "no such file; run the pipeline from the project's root", file=file
        ) from None
    except (yaml.YAMLError, OSError, ValueError) as error:
        raise ConfigError(
            f"cannot be read as YAML: {' '.join(str(error).split())}", file=file
        ) from None
    if not isinstance(loaded, dict | None):
        raise ConfigError("must hold keys and values", file=file)
    return loaded or {}


def require_bounded(text: str | bytes) -> None:
    """Raise ValueError where YAML nests deeper than MOST_LEVELS, unfolds into more than
    MOST_VALUES, refers to a part of itself that holds the reference, or is no YAML: whoever builds
    what it means goes down by recursion, and at some depth takes the process along. No recording
    or option comes near these bounds, so that none is an option.
    """
    if len(text) > MOST_BYTES:
        raise ValueError(f"it has more than {MOST_BYTES >> 20} MiB")
    try:
        _count(text)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None


def _count(text: str | bytes) -> None:
    sizes: dict[str, int] = {}  # anchor → how many values it stands for, 0 as long as it is open
    opened: list[tuple[str | None, int]] = []  # the anchor of each level, the values before it
    values = 0
    for event in yaml.parse(text, yaml.CSafeLoader):
        if isinstance(event, yaml.AliasEvent):
            if sizes.get(event.anchor) == 0:
                raise ValueError(f"*{event.anchor} stands in what it refers to")
            values += sizes.get(event.anchor, 1)
        elif isinstance(event, yaml.CollectionStartEvent):
            opened.append((event.anchor, values))
            sizes[event.anchor] = 0
            values += 1
        elif isinstance(event, yaml.ScalarEvent):
            values += 1
            sizes[event.anchor] = 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = opened.pop()
            sizes[anchor] = values - before
        if len(opened) > MOST_LEVELS:
            raise ValueError(f"it nests deeper than {MOST_LEVELS} levels")
        if values > MOST_VALUES:
            raise ValueError(f"it unfolds into more than {MOST_VALUES} values")


def structured(structure: Any) -> DictConfig:
    """The type as a node that values can be merged into, also where it nests frozen dataclasses."""
    node = OmegaConf.structured(structure)
    nodes = [node]
    while nodes:
        current = nodes.pop()
        OmegaConf.set_readonly(current, None)
        nodes += [
            child
            for child in (current._get_node(key) for key in current)
            if isinstance(child, DictConfig) and not child._is_none()
        ]
    return node


def said(error: Exception) -> str:
    """The first line of what Hydra or OmegaConf says, with the keys that there are where one is
    unknown.
    """
    message, known = str(error).splitlines()[0], getattr(error, "object_type", None)
    if isinstance(error, ConfigAttributeError | ConfigKeyError) and is_dataclass(known):
        message += f"; there are {', '.join(field.name for field in fields(known))}"
    return message


def typed(structure: Any, values: Any, section: str = "") -> DictConfig:
    """``values`` of a section checked against a dataclass; ConfigError names the key where they do
    not fit.
    """
    prefix = f"{section}." if section else ""
    if not isinstance(values, DictConfig) or values._is_none():
        raise ConfigError("must hold keys and values", key=section)
    try:
        merged = OmegaConf.merge(structured(structure), values)
        missing = sorted(OmegaConf.missing_keys(merged))
    except OmegaConfBaseException as error:
        raise ConfigError(
            said(error), key=(prefix + (getattr(error, "full_key", None) or "")).rstrip(".") or None
        ) from None
    if missing:
        raise ConfigError(
            f"no value for {', '.join(prefix + name for name in missing)}", key=prefix + missing[0]
        )
    # makes the objects, whose types may check ranges of their own
    OmegaConf.to_object(merged)
    return merged


def parsed(text: str, **evidence: object) -> Any:
    """What ``text`` holds as YAML; ConfigError with ``evidence`` where it is none."""
    try:
        return yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError) as error:
        message = f"cannot be read as YAML: {' '.join(str(error).split())}"
        raise ConfigError(message, **evidence) from None
