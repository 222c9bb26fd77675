"""Datasheet and option file as text: a template with known values, answers in place of ???."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.core.datasheet import OPEN
from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import parse_yaml
from pipeline.tools.check.command import value_faults

LINE = re.compile(
    r'(?P<optional>\??)(?P<indent> *)(?P<key>"(?:[^"\\]|\\.)*"|[^\s#:"]+):'
    r"(?: (?P<value>[^#].*?))?(?: # (?P<hint>.*))?"
)


class Entry(NamedTuple):
    """Value of a key as YAML or mapping, None: open; note for its comment; False: a suggestion."""

    value: str | Mapping[str, Any] | None = None
    note: str = ""
    certain: bool = True


class OpenValue(NamedTuple):
    """The comment beside a value that is still ???, and its line of ``file``, from 0."""

    hint: str
    file: Path
    line: int


def text_of(text: str) -> str:
    """Return ``text`` as YAML, quoted where it could be read as anything else."""
    plain = re.fullmatch(r"[A-Za-z_.][\w./*-]*", text, re.ASCII) and parse_yaml(text) == text
    return text if plain else json.dumps(text, ensure_ascii=False)


def _keyed(text: str) -> Iterator[tuple[str, str, re.Match | None]]:
    """Yield each line, its dotted key and its parts; neither of a comment."""
    path: list[tuple[int, str]] = []
    for line in text.splitlines():
        if (parts := LINE.fullmatch(line)) is None:
            yield line, "", None
            continue
        depth, name = len(parts["indent"]), parts["key"]
        path = [above for above in path if above[0] < depth]
        path.append((depth, json.loads(name) if name[0] == '"' else name))
        yield line, ".".join(name for _, name in path), parts


def filled_template(template: str, entries: Mapping[str, Entry]) -> str:
    """Return the ``template`` with the certain ``entries``, without unused optional (?) keys."""
    lines, left_out = [], " "
    for line, key, parts in _keyed(template):
        if parts is None:
            lines.append(line)
            continue
        below = f"{key}."
        if below.startswith(left_out):
            continue
        if parts["optional"] and not any(f"{one}.".startswith(below) for one in entries):
            left_out = below
            continue
        value, note, certain = entries.get(key, Entry(""))
        nested = value if isinstance(value, Mapping) else {}
        suggested = f"suggested is {value}" if value and not certain else ""
        if not nested:
            value = (value or parts["value"] or "") if certain and value is not None else OPEN
        hint = "; ".join(filter(None, [suggested, note, parts["hint"]]))
        head = f"{parts['indent']}{parts['key']}:"
        lines.append(" ".join([head, *filter(None, [not nested and value, hint and f"# {hint}"])]))
        lines += _block(nested, f"{parts['indent']}  ")
    return "\n".join(lines) + "\n"


def _block(values: Mapping[str, Any], indent: str) -> Iterator[str]:
    for name, value in values.items():
        inner = value if isinstance(value, Mapping) else {}
        yield f"{indent}{text_of(name)}:{'' if inner else f' {value}'}"
        yield from _block(inner, f"{indent}  ")


@dataclass
class Draft:
    """Texts of both files, which ``answer`` fills in."""

    texts: dict[Path, str]

    def values(self) -> dict[str, Any]:
        """Return the values of both files; ConfigError for a text that is no YAML."""
        merged: dict[str, Any] = {}
        for file, text in self.texts.items():
            _merge(merged, parse_yaml(text, file=file) or {})
        return merged

    def questions(self) -> dict[str, OpenValue]:
        """Return the values that are still ???, by key, in the order of the files."""
        return {
            key: OpenValue(parts["hint"] or "", file, number)
            for file, text in self.texts.items()
            for number, (_, key, parts) in enumerate(_keyed(text))
            if parts is not None and OPEN in (parts["value"] or "")
        }

    def answer(self, key: str, value: str) -> None:
        """Put ``value``, as YAML has it, in the place of a ???; ConfigError, and no change, where
        the key is not open, and the first new fault of the values where there is one.
        """
        questions = self.questions()
        if key not in questions:
            there_are = ", ".join(questions) or "none"
            message = f"no such value is still to be filled in; there are {there_are}"
            raise ConfigError(message, key=key)
        value = " ".join(value.split())
        if value in ("", OPEN):
            raise ConfigError("a value is required here", key=key)
        try:
            parse_yaml(f"key: {value}")
            plain = not re.search("(^| )#", value)
        except ConfigError:
            plain = False
        written = value if plain else json.dumps(value, ensure_ascii=False)
        _, file, number = questions[key]
        lines = self.texts[file].splitlines()
        line = re.sub(r"# suggested is [^;]*; ", "# ", lines[number])
        lines[number] = line.replace(OPEN, written, 1)
        changed = Draft(self.texts | {file: "\n".join(lines) + "\n"})
        before = {str(fault) for fault in value_faults(self.values())}
        for fault in value_faults(changed.values()):
            if str(fault) not in before:
                raise fault
        self.texts = changed.texts


def _merge(values: dict[str, Any], others: dict[str, Any]) -> None:
    for key, value in others.items():
        if isinstance(value, dict) and isinstance(values.get(key), dict):
            _merge(values[key], value)
        else:
            values[key] = value
