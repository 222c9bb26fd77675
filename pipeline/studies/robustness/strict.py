"""Dataclasses from what a YAML file holds, with no key unknown, none missing and every value of the
type that the dataclass declares.

``typed`` of core.typed_yaml converts what it can, a text into a number among others, and knows no
union with a list; what people write by hand here is refused instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from pipeline.core.errors import ConfigError

T = TypeVar("T")
NAMES = {str: "a text", float: "a number", int: "a whole number", list: "a list", dict: "a mapping"}


def build(structure: type[T], values: object, **evidence: object) -> T:
    """A dataclass ``structure`` of ``values``. Raises ConfigError with the key and ``evidence``."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"must hold keys and values, found {values!r}", **evidence)
    known = {field.name: field for field in fields(structure)}  # type: ignore[arg-type]
    types = get_type_hints(structure)
    for key, value in values.items():
        if key not in known:
            raise ConfigError(
                f"no key {key!r}; there are {', '.join(known)}", **evidence | {"key": key}
            )
        if not _fits(value, types[key]):
            raise ConfigError(
                f"must be {_name(types[key])}, found {value!r}", **evidence | {"key": key}
            )
    for key, field in known.items():
        if key not in values and field.default is MISSING and field.default_factory is MISSING:
            raise ConfigError(f"the key {key!r} is missing", **evidence | {"key": key})
    try:
        return structure(**values)
    except ConfigError as error:
        raise ConfigError(error.message, **evidence | error.evidence) from None


def is_number(value: Any) -> bool:
    """Whether ``value`` is a real number; True and False are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _fits(value: object, wanted: Any) -> bool:
    if isinstance(wanted, UnionType):
        return any(_fits(value, option) for option in get_args(wanted))
    if wanted is float:
        return is_number(value)
    if wanted is int:
        return is_number(value) and isinstance(value, int)
    return isinstance(value, get_origin(wanted) or wanted)


def _name(wanted: Any) -> str:
    options = get_args(wanted) if isinstance(wanted, UnionType) else (wanted,)
    names = [NAMES.get(get_origin(option) or option, option.__name__) for option in options]
    return " or ".join(name for name in names if name != "NoneType")
