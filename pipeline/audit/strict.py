"""Dataclasses from what a YAML file holds, with no key unknown, none missing and every value of its type."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar

from pipeline.errors import ConfigError

T = TypeVar("T")


def build(structure: type[T], values: object, **evidence: object) -> T:
    """A ``structure`` (a dataclass that checks its own types) of ``values``. Raises ConfigError with the key and ``evidence``."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"must hold keys and values, found {values!r}", **evidence)
    known = {field.name: field for field in fields(structure)}  # type: ignore[arg-type]
    for key in values:
        if key not in known:
            raise ConfigError(f"no key {key!r}; there are {', '.join(known)}", **evidence | {"key": key})
    for key, field in known.items():
        if key not in values and field.default is MISSING and field.default_factory is MISSING:
            raise ConfigError(f"the key {key!r} is missing", **evidence | {"key": key})
    try:
        return structure(**values)
    except ConfigError as error:
        raise ConfigError(error.message, **evidence | error.evidence) from None


def texts(owner: object, *keys: str) -> None:
    """Refuse an attribute among ``keys`` that is no text."""
    for key in keys:
        if not isinstance(getattr(owner, key), str):
            raise ConfigError(f"must be a text, found {getattr(owner, key)!r}", key=key)


def is_number(value: Any) -> bool:
    """Whether ``value`` is a real number; True and False are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)
