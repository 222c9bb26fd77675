"""Option types as pydantic dataclasses, and all faults of values as one ConfigError."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import cache, wraps
from pathlib import Path
from typing import (
    Any,
    TypeVar,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic import dataclasses as pydantic_dataclasses

from pipeline.core.errors import ConfigError

T = TypeVar("T")
RULES = ConfigDict(extra="forbid", allow_inf_nan=False)
MISSING = "no value for "  # start of the message about a missing value
adapter = cache(TypeAdapter)


class Fault(ValueError):
    """A fault of the value at ``key``, relative to the section whose validator raises it."""

    def __init__(self, key: str, message: str) -> None:
        self.key = key
        super().__init__(message)


@dataclass_transform(field_specifiers=(Field,))
def options(**arguments: Any) -> Callable[[type[T]], type[T]]:
    """Decorate the type of a section: a pydantic dataclass whose faults are ConfigErrors."""

    def decorate(cls: type[T]) -> type[T]:
        made = pydantic_dataclasses.dataclass(cls, config=RULES, **arguments)
        construct = made.__init__

        @wraps(construct)
        def init(self, *values: Any, **named: Any) -> None:
            try:
                construct(self, *values, **named)
            except ValidationError as error:
                raise joined_faults(
                    [_fault(one, made, "") for one in error.errors()]
                ) from None

        made.__init__ = init
        return made

    return decorate


def validated(
    structure: type[T], values: Any, section: str = "", file: Path | None = None
) -> T:
    """Return the object of ``values``; raises ConfigError with every fault and its key."""
    found, faults = all_faults(structure, values, section)
    if faults:
        raise joined_faults(faults, file)
    return found


def all_faults(
    structure: type[T], values: Any, section: str = ""
) -> tuple[T | None, list[ConfigError]]:
    """Return the object of ``values``, None if they are faulty, and one ConfigError per fault."""
    try:
        return adapter(structure).validate_python(values), []
    except ValidationError as error:
        return None, [_fault(one, structure, section) for one in error.errors()]
    except ConfigError as error:  # from a check within the type
        key = f"{section}.{error.evidence.get('key', '')}".strip(".")
        return None, [ConfigError(error.message, **error.evidence | {"key": key})]


def joined_faults(faults: list[ConfigError], file: Path | None = None) -> ConfigError:
    """Return one ConfigError with a line for each of the ``faults``."""
    message = faults[0].message
    if len(faults) > 1:
        message = f"{len(faults)} faults:\n"
        for fault in faults:
            key = str(fault.evidence.get("key"))
            message += f"  {key}: {fault.message.removeprefix(key.rpartition('.')[2] + ': ')}\n"
        message += " "
    return ConfigError(message, **{"file": file} | faults[0].evidence)


def _fault(error: Any, structure: type, section: str) -> ConfigError:
    """Return pydantic's ``error`` with key, value, allowed values and the nearest of them."""
    place, kind, given = [*error["loc"]], error["type"], error["input"]
    if (
        kind != "invalid_key"
        and place
        and isinstance(place[0], int)
        and is_dataclass(structure)
    ):
        place[0] = fields(structure)[place[0]].name  # an argument by position
    place, context, known = [str(part) for part in place], error.get("ctx", {}), []
    if isinstance(cause := context.get("error"), Fault):
        place.append(cause.key)
    key = ".".join(filter(None, [section, *place]))
    if isinstance(cause, Fault):
        message = str(cause)
    elif kind in ("unexpected_keyword_argument", "extra_forbidden"):
        given, known = place[-1], _keys_at(structure, place[:-1])
        message = f"unknown key '{given}'; there are {', '.join(known)}"
    elif kind == "missing":
        return ConfigError(f"{MISSING}{key}", key=key)
    elif kind in ("dataclass_type", "dict_type"):
        message = "must contain keys and values"
    else:
        message = f"{error['msg'][0].lower()}{error['msg'][1:]}, got {given!r}"
        known = (
            str(context.get("expected", ""))
            .replace(" or ", ", ")
            .replace("'", "")
            .split(", ")
        )
    if isinstance(given, str) and (near := get_close_matches(given, known, n=1)):
        message += f"; did you mean {near[0]}?"
    if place and place[-1] not in message:
        message = f"{place[-1]}: {message}"
    return ConfigError(message, key=key)


def _keys_at(structure: Any, place: list[str]) -> list[str]:
    """Return the field names of the dataclass at ``place`` below ``structure``."""

    def section(hint: Any) -> Any:
        return next(filter(is_dataclass, (hint, *get_args(hint))), None)

    for part in place:
        if get_origin(structure) in (dict, list, tuple):
            structure = get_args(structure)[-1]
        elif section(structure) is not None:
            structure = get_type_hints(section(structure)).get(part)
    here = section(structure)
    return [] if here is None else [one.name for one in fields(here)]
