"""Types of options as pydantic dataclasses, and everything that is wrong with given values as one
ConfigError.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import cache, wraps
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar, dataclass_transform, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic import dataclasses as pydantic_dataclasses

from pipeline.core.errors import ConfigError

T = TypeVar("T")
RULES = ConfigDict(extra="forbid", allow_inf_nan=False)
UNKNOWN = ("unexpected_keyword_argument", "extra_forbidden")
# keys of earlier versions → the replacement that their refusal names
REPLACED = {
    "dataset.elimination": (
        "a dataset names no decomposition any more; remove the key and set decomposition in "
        "pipeline/conf/model/wishart.yaml (by_shape, pivoted_lu, qr, qr_transposed or given)"
    ),
}


class Fault(ValueError):
    """A fault of the value at ``key``, relative to the section whose validator raises it."""

    def __init__(self, key: str, message: str) -> None:
        self.key = key
        super().__init__(message)


@dataclass_transform(field_specifiers=(Field,))
def options(**arguments: Any) -> Callable[[type[T]], type[T]]:
    """Decorate the type of a section: a pydantic dataclass that takes no other keys.

    ``arguments`` are those of a dataclass. An object that is made directly raises ConfigError.
    """

    def decorate(cls: type[T]) -> type[T]:
        made = pydantic_dataclasses.dataclass(cls, config=RULES, **arguments)
        construct = made.__init__

        @wraps(construct)
        def init(self, *values: Any, **named: Any) -> None:
            try:
                construct(self, *values, **named)
            except ValidationError as error:
                raise _joined(_faults(error, made, "")) from None

        made.__init__ = init
        return made

    return decorate


def validated(structure: type[T], values: Any, section: str = "", file: Path | None = None) -> T:
    """Return the object of type ``structure`` that ``values`` describe.

    ConfigError names every fault by its key below ``section``: the allowed values, the known keys
    and the nearest of them.
    """
    try:
        return _adapter(structure).validate_python(values)
    except ValidationError as error:
        raise _joined(_faults(error, structure, section), file) from None


def all_faults(
    structure: type[T], values: Any, section: str = "", *, missing: bool = True
) -> tuple[T | None, list[ConfigError]]:
    """The object that ``values`` describe, None where there are faults, and a ConfigError a fault;
    without ``missing`` a value that is not there is no fault.
    """
    try:
        return _adapter(structure).validate_python(values), []
    except ValidationError as error:
        return None, [
            ConfigError(message, key=key)
            for key, message, kind in _faults(error, structure, section)
            if missing or kind != "missing"
        ]
    except ConfigError as error:  # of a check that an object makes of itself
        key = f"{section}.{error.evidence.get('key', '')}".strip(".")
        return None, [ConfigError(error.message, **error.evidence | {"key": key})]


def missing_keys(structure: type, values: Any) -> list[str]:
    """The keys of required values that ``values`` lack, sorted."""
    try:
        _adapter(structure).validate_python(values)
    except ValidationError as error:
        return sorted(key for key, _, kind in _faults(error, structure, "") if kind == "missing")
    return []


def joined_faults(faults: list[ConfigError], file: Path | None = None) -> ConfigError:
    """One ConfigError that says all ``faults``, a line each."""
    first = faults[0]
    evidence = {"file": file} | first.evidence
    if len(faults) == 1:
        return ConfigError(first.message, **evidence)
    lines = []
    for fault in faults:
        key = str(fault.evidence.get("key"))
        message = fault.message.removeprefix(f"{key.rpartition('.')[2]}: ")
        lines.append(f"\n  {key}: {message}")
    return ConfigError(f"{len(faults)} faults:{''.join(lines)}\n ", **evidence)


@cache
def _adapter(structure: type) -> TypeAdapter:
    return TypeAdapter(structure)


def _joined(faults: list[tuple[str, str, str]], file: Path | None = None) -> ConfigError:
    return joined_faults([ConfigError(message, key=key) for key, message, _ in faults], file)


def _faults(error: ValidationError, structure: type, section: str) -> list[tuple[str, str, str]]:
    """Key, message and pydantic's kind of each fault."""
    found = []
    for fault in error.errors(include_url=False):
        if fault["loc"] and isinstance(fault["loc"][0], int) and is_dataclass(structure):
            names = [one.name for one in fields(structure)]  # a value given by position
            if fault["type"] != "invalid_key" and fault["loc"][0] < len(names):
                fault["loc"] = (names[fault["loc"][0]], *fault["loc"][1:])
        place, kind = [str(part) for part in fault["loc"]], fault["type"]
        cause = fault.get("ctx", {}).get("error")
        known: list[str] = []
        if isinstance(cause, Fault):
            place, message = [*place, cause.key], str(cause)
        elif kind in UNKNOWN:
            known = _keys_at(structure, place[:-1])
            message = REPLACED.get(".".join(filter(None, [section, *place]))) or (
                f"unknown key '{place[-1]}'; there are {', '.join(known)}"
            )
        elif kind == "missing":
            message = f"no value for {'.'.join(filter(None, [section, *place]))}"
        elif kind in ("dataclass_type", "dict_type"):
            message = "must hold keys and values"
        else:
            text = fault["msg"][0].lower() + fault["msg"][1:]
            message = f"{text}, got {fault['input']!r}"
            known = [str(value) for value in _choices(fault)]
        wrong = place[-1] if kind in UNKNOWN else fault["input"]
        if isinstance(wrong, str) and (near := get_close_matches(wrong, known, n=1)):
            message += f"; did you mean {near[0]}?"
        if kind != "missing" and place and place[-1] not in message:
            message = f"{place[-1]}: {message}"
        found.append((".".join(filter(None, [section, *place])), message, kind))
    return found


def _choices(fault: dict[str, Any]) -> list[str]:
    expected = str(fault.get("ctx", {}).get("expected", ""))
    return expected.replace(" or ", ", ").replace("'", "").split(", ")


def _keys_at(structure: type, place: list[str]) -> list[str]:
    """Names of the fields of the dataclass at ``place`` below ``structure``."""
    current: Any = structure
    for part in place:
        held = next(_dataclasses(current), None)
        if held is not None:
            current = get_type_hints(held).get(part)
        elif get_origin(current) in (dict, list, tuple):
            current = get_args(current)[-1]
    held = next(_dataclasses(current), None)
    return [] if held is None else [one.name for one in fields(held)]


def _dataclasses(hint: Any) -> Iterator[type]:
    """The dataclasses among the alternatives of a type hint."""
    for one in (hint, *get_args(hint)):
        if isinstance(one, type) and one is not NoneType and is_dataclass(one):
            yield one
