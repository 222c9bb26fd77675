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
                faults = [_fault(fault, made, "") for fault in error.errors()]
                raise joined_faults(faults) from None

        made.__init__ = init
        return made

    return decorate


def validated(
    structure: type[T],
    values: Any,
    section: str = "",
    file: Path | None = None,
) -> T:
    """Return the object of ``values``; raises ConfigError with every fault and its key."""
    result, faults = all_faults(structure, values, section)
    if faults:
        raise joined_faults(faults, file)
    return result


def all_faults(
    structure: type[T],
    values: Any,
    section: str = "",
) -> tuple[T | None, list[ConfigError]]:
    """Return the object of ``values``, None if they are faulty, and one ConfigError per fault."""
    try:
        return adapter(structure).validate_python(values), []
    except ValidationError as error:
        faults = [_fault(fault, structure, section) for fault in error.errors()]
        return None, faults
    except ConfigError as error:  # from a check within the type
        key = f"{section}.{error.evidence.get('key', '')}".strip(".")
        return None, [ConfigError(error.message, **error.evidence | {"key": key})]


def joined_faults(faults: list[ConfigError], file: Path | None = None) -> ConfigError:
    """Return one ConfigError with a line for each of the ``faults``."""
    first, *further = faults
    evidence = {"file": file} | first.evidence
    if not further:
        return ConfigError(first.message, **evidence)
    lines = [f"{len(faults)} faults:"]
    for fault in faults:
        key = str(fault.evidence.get("key"))
        last = key.rpartition(".")[2]
        lines.append(f"  {key}: {fault.message.removeprefix(f'{last}: ')}")
    return ConfigError("\n".join([*lines, " "]), **evidence)


def _fault(error: Any, structure: type, section: str) -> ConfigError:
    """Return pydantic's ``error`` with key, value, allowed values and the nearest of them."""
    kind = error["type"]
    value = error["input"]
    place = _names_of(error, structure)
    context = error.get("ctx", {})
    cause = context.get("error")
    if isinstance(cause, Fault):
        place.append(cause.key)
    key = ".".join(filter(None, [section, *place]))
    allowed: list[str] = []
    if isinstance(cause, Fault):
        message = str(cause)
    elif kind in ("unexpected_keyword_argument", "extra_forbidden"):
        value = place[-1]
        allowed = _keys_at(structure, place[:-1])
        message = f"unknown key '{value}'; there are {', '.join(allowed)}"
    elif kind == "missing":
        return ConfigError(f"{MISSING}{key}", key=key)
    elif kind in ("dataclass_type", "dict_type"):
        message = "must contain keys and values"
    else:
        message = f"{error['msg'][0].lower()}{error['msg'][1:]}, got {value!r}"
        expected = str(context.get("expected", ""))
        allowed = expected.replace(" or ", ", ").replace("'", "").split(", ")
    if isinstance(value, str) and (near := get_close_matches(value, allowed, n=1)):
        message += f"; did you mean {near[0]}?"
    if place and place[-1] not in message:
        message = f"{place[-1]}: {message}"
    return ConfigError(message, key=key)


def _names_of(error: Any, structure: type) -> list[str]:
    """Return the keys from the top of ``structure`` to the place of pydantic's ``error``."""
    place = list(error["loc"])
    by_position = place and isinstance(place[0], int) and is_dataclass(structure)
    if by_position and error["type"] != "invalid_key":
        place[0] = fields(structure)[place[0]].name
    return [str(key) for key in place]


def _keys_at(structure: Any, place: list[str]) -> list[str]:
    """Return the field names of the dataclass at ``place`` below ``structure``."""

    def section(hint: Any) -> Any:
        return next(filter(is_dataclass, (hint, *get_args(hint))), None)

    for key in place:
        if get_origin(structure) in (dict, list, tuple):
            structure = get_args(structure)[-1]
        elif section(structure) is not None:
            structure = get_type_hints(section(structure)).get(key)
    here = section(structure)
    return [] if here is None else [field.name for field in fields(here)]
