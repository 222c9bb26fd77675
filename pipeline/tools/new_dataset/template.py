"""The two files of a dataset from one commented template: known values, and ??? for the others.

A value is YAML as text, with ` # note` behind it or not, or a mapping of names to values.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.core.datasheet import OPEN

TEMPLATE = Path(__file__).with_name("template.yaml")
LINE = re.compile(r"(?P<indent> *)(?P<key>\w+):(?: (?P<value>[^#]*?))?(?: # (?P<hint>.*))?")
RESERVED = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
Values = dict[str, Any]  # by dotted key of the template


def fill_template(name: str, known: Mapping[str, Any]) -> list[str]:
    """Return the texts of datasheet and option file of the dataset ``name``. An optional key of the
    template (?) without a ``known`` value at it or below it is left out, with all below it.
    """
    texts = TEMPLATE.read_text(encoding="utf-8").replace("{name}", name).split("---\n")
    return ["\n".join(_filled(text, known)) + "\n" for text in texts]


def _filled(text: str, known: Mapping[str, Any]) -> Iterator[str]:
    path, left_out = [], 1000  # left_out: indentation of the key whose lines are left out
    for line in text.splitlines():
        body = line.removeprefix("?")
        depth = len(body) - len(body.lstrip())
        if depth > left_out:
            continue
        left_out = 1000
        if (parts := LINE.fullmatch(body)) is None:
            yield body  # a comment
            continue
        path = [*path[: depth // 2], parts["key"]]
        key = ".".join(path)
        if line != body and not any(f"{one}.".startswith(f"{key}.") for one in known):
            left_out = depth
            continue
        given, value, note = known.get(key, ""), "", ""
        if not isinstance(given, Mapping):
            value, _, note = given.partition(" # ")
            value = value or parts["value"] or ""
        hint = "; ".join(filter(None, [note, parts["hint"]]))
        yield f"{' ' * depth}{parts['key']}:{value and ' '}{value}{hint and ' # '}{hint}"
        if isinstance(given, Mapping):
            yield from _nested(given, depth + 2)


def _nested(values: Mapping[str, Any], depth: int) -> Iterator[str]:
    for name, value in values.items():
        inner = isinstance(value, Mapping)
        yield f"{' ' * depth}{text_of(name)}:{'' if inner else f' {value}'}"
        if inner:
            yield from _nested(value, depth + 2)


def asked(note: str = "") -> str:
    """Return ??? with a ``note`` for the user."""
    return f"{OPEN} # {note}" if note else OPEN


def chosen(choices: Iterable[str]) -> str:
    """Return the only one of the ``choices``, else ??? and what there is to choose from."""
    listed = [*choices]
    return listed[0] if len(listed) == 1 else asked(f"one of {', '.join(listed)}" if listed else "")


def agreed(values: Iterable[float | None]) -> str:
    """Return the one value that all recordings state, else ???."""
    stated = set(values)
    return f"{stated.pop():.10g}" if len(stated) == 1 and None not in stated else OPEN


def several(names: Iterable[str]) -> str:
    """Return ``names`` as a list in YAML has them, without its brackets."""
    return ", ".join(map(text_of, names))


def text_of(text: str) -> str:
    """Return ``text`` as YAML, quoted where it could be read as anything else."""
    plain = re.fullmatch(r"[A-Za-z_][\w./*-]*|\.\.?/[\w./*-]*", text, re.ASCII)
    return text if plain and text.lower() not in RESERVED else json.dumps(text, ensure_ascii=False)
