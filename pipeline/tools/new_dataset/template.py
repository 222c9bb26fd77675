"""Text of datasheet and option file: a template with known values, and ??? for other values."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from pipeline.configuration.datasheet import OPEN
from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import parse_yaml

LINE = re.compile(
    r'(?P<optional>\??)(?P<indent> *)(?P<key>"(?:[^"\\]|\\.)*"|[^\s#:"]+):'
    r'(?: (?P<value>"(?:[^"\\]|\\.)*"|[^#].*?))?(?: # (?P<hint>.*))?',
)
SUGGESTED = re.compile("suggested is [^;]*; ")
PLAIN = re.compile(r"[A-Za-z_.][\w./*-]*", re.ASCII)


class Entry(NamedTuple):
    """Value of a key (YAML or mapping; None: ???), note for the comment, False if a suggestion."""

    value: str | Mapping[str, Any] | None = None
    note: str = ""
    certain: bool = True

    @property
    def text(self) -> str:
        """The value, "" if there is none or if it has parts."""
        return self.value if isinstance(self.value, str) else ""


Entries = dict[str, Entry]


def suggestion(note: str, value: str | None = None) -> Entry:
    """Return a value that only a person can confirm, with the ``note`` of its reason."""
    return Entry(value, note, certain=False)


def choice_of(choices: Iterable[str], suggested: str | None = None) -> Entry:
    """Return the only one of the ``choices``, else a note that lists all ``choices``."""
    listed = [text_of(choice) for choice in choices]
    if len(listed) == 1:
        return Entry(listed[0])
    note = f"one of {', '.join(listed)}" if listed else ""
    return suggestion(note, suggested)


def list_of_names(names: Iterable[str]) -> str:
    """Return the ``names`` as the inside of a YAML list."""
    return ", ".join(text_of(name) for name in names)


def text_of(text: str | int) -> str:
    """Return ``text`` as YAML, quoted if YAML could read another value; a number as it is."""
    if not isinstance(text, str):
        return str(text)
    if PLAIN.fullmatch(text) and parse_yaml(text) == text:
        return text
    return json.dumps(text, ensure_ascii=False)


def yaml_of(value: str) -> str:
    """Return ``value`` if it is YAML without a comment, else as a quoted text."""
    with suppress(ConfigError):
        parse_yaml(f"key: {value}")
        if not re.search("(^| )#", value):
            return value
    return json.dumps(value, ensure_ascii=False)


def keyed_lines(text: str) -> Iterator[tuple[str, str, re.Match | None]]:
    """Yield line, dotted key and parts of every line; "" and None for a comment."""
    path: list[tuple[int, str]] = []  # indent and name of the keys above
    for line in text.splitlines():
        parts = LINE.fullmatch(line)
        if parts is None:
            yield line, "", None
            continue
        depth = len(parts["indent"])
        name = parts["key"]
        if name.startswith('"'):
            name = json.loads(name)
        path = [above for above in path if above[0] < depth]
        path.append((depth, name))
        yield line, ".".join(name for _, name in path), parts


def fill_template(template: str, entries: Mapping[str, Entry]) -> str:
    """Return the ``template`` with the certain ``entries``, without unused optional (?) keys."""
    used = {""}
    for key in entries:
        while key not in used:  # its sections are used too
            used.add(key)
            key = key.rpartition(".")[0]
    lines = []
    left_out = " "
    for line, key, parts in keyed_lines(template):
        if parts is None:
            lines.append(line)
            continue
        if f"{key}.".startswith(left_out):
            continue
        if parts["optional"] and key not in used:
            left_out = f"{key}."
            continue
        entry = entries.get(key, Entry(""))
        if isinstance(entry.value, Mapping):
            lines.append(_line(parts, "", entry.note, parts["hint"]))
            lines += _block(entry.value, f"{parts['indent']}  ")
        else:
            lines.append(_entry_line(parts, entry))
    return "\n".join(lines) + "\n"


def _entry_line(parts: re.Match, entry: Entry) -> str:
    """Return the line of an ``entry``: its value, the template's, or ??? with a suggestion."""
    value = OPEN
    suggested = ""
    if entry.certain and entry.value is not None:
        value = entry.value or parts["value"] or ""
    elif entry.value:
        suggested = f"suggested is {entry.value}"
    return _line(parts, value, suggested, entry.note, parts["hint"])


def set_value(text: str, key: str, value: str) -> str:
    """Return ``text`` with the ``value`` (YAML) of ``key`` in its line, else in a new line below
    the first line of its section, or at the end. Raises ConfigError for a key with parts, and for
    one below a value.
    """
    places: dict[str, tuple[int, re.Match]] = {}
    for number, (_, line_key, parts) in enumerate(keyed_lines(text)):
        if parts:
            places.setdefault(line_key, (number, parts))
    above = key
    while above and above not in places:
        above = above.rpartition(".")[0]

    lines = text.splitlines()
    number, parts = places.get(above, (len(lines) - 1, None))
    stated = parts["value"] if parts else None
    if above == key:
        if not stated:
            raise ConfigError(f"has parts: set {key}.PART", key=key)
        hint = SUGGESTED.sub("", parts["hint"] or "")
        lines[number] = _line(parts, value, hint)
    else:
        if stated:
            message = f"{above} is {stated}: set {above} to {{key: value, …}}"
            raise ConfigError(message, key=key)
        indent = f"{parts['indent']}  " if parts else ""
        names = key.removeprefix(above).strip(".").split(".")
        lines[number + 1 : number + 1] = _nested_lines(names, value, indent)
    return "\n".join(lines) + "\n"


def _nested_lines(names: Sequence[str], value: str, indent: str) -> list[str]:
    """Return the lines of a ``value`` whose key is nested in keys of these ``names``."""
    lines = [f"{indent}{'  ' * depth}{name}:" for depth, name in enumerate(names)]
    lines[-1] = f"{lines[-1]} {value}"
    return lines


def _line(parts: re.Match, value: str, *hints: str | None) -> str:
    """Return a line with the indent and the key of ``parts``."""
    words = [f"{parts['indent']}{parts['key']}:"]
    if value:
        words.append(value)
    hint = "; ".join(filter(None, hints))
    if hint:
        words.append(f"# {hint}")
    return " ".join(words)


def _block(values: Mapping[str, Any], indent: str) -> Iterator[str]:
    """Yield the lines of nested ``values``."""
    for name, value in values.items():
        key = f"{indent}{text_of(name)}:"
        if isinstance(value, Mapping) and value:
            yield key
            yield from _block(value, f"{indent}  ")
        else:
            yield f"{key} {value}"
