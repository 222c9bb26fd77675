"""Text of datasheet and option file: a template with known values, and ??? for other values."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

from pipeline.configuration.datasheet import OPEN
from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import parse_yaml

LINE = re.compile(
    r'(?P<optional>\??)(?P<indent> *)(?P<key>"(?:[^"\\]|\\.)*"|[^\s#:"]+):'
    r'(?: (?P<value>"(?:[^"\\]|\\.)*"|[^#].*?))?(?: # (?P<hint>.*))?'
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
    path: list[tuple[int, str]] = []
    for line in text.splitlines():
        if (parts := LINE.fullmatch(line)) is None:
            yield line, "", None
            continue
        depth, name = len(parts["indent"]), parts["key"]
        path = [above for above in path if above[0] < depth]
        path.append((depth, json.loads(name) if name[0] == '"' else name))
        yield line, ".".join(name for _, name in path), parts


def fill_template(template: str, entries: Mapping[str, Entry]) -> str:
    """Return the ``template`` with the certain ``entries``, without unused optional (?) keys."""
    lines, left_out = [], " "
    for line, key, parts in keyed_lines(template):
        below = f"{key}."
        if parts is None:
            lines.append(line)
        elif below.startswith(left_out):
            continue
        elif parts["optional"] and not any(
            f"{one}.".startswith(below) for one in entries
        ):
            left_out = below
        else:
            value, note, certain = entries.get(key, Entry(""))
            if isinstance(value, Mapping):
                lines += [_line(parts, "", note, parts["hint"])]
                lines += _block(value, f"{parts['indent']}  ")
                continue
            suggested = f"suggested is {value}" if value and not certain else ""
            value = (
                (value or parts["value"] or "")
                if certain and value is not None
                else OPEN
            )
            lines.append(_line(parts, value, suggested, note, parts["hint"]))
    return "\n".join(lines) + "\n"


def set_value(text: str, key: str, value: str) -> str:
    """Return ``text`` with the ``value`` (YAML) of ``key`` in its line, else in a new line below
    the first line of its section, or at the end. Raises ConfigError for a key with parts, and for
    one below a value.
    """
    lines, places = text.splitlines(), {}
    for number, (_, own, parts) in enumerate(keyed_lines(text)):
        if parts:
            places.setdefault(own, (number, parts))
    above = key
    while above and above not in places:
        above = above.rpartition(".")[0]
    number, parts = places.get(above, (len(lines) - 1, None))
    stated = parts is not None and parts["value"]
    if above == key and stated:
        lines[number] = _line(parts, value, SUGGESTED.sub("", parts["hint"] or ""))
    elif above == key:
        raise ConfigError(f"has parts: set {key}.PART", key=key)
    elif stated:
        raise ConfigError(
            f"{above} is {stated}: set {above} to {{key: value, …}}", key=key
        )
    else:
        indent = f"{parts['indent']}  " if parts else ""
        names = key.removeprefix(above).strip(".").split(".")
        added = [f"{indent}{'  ' * depth}{name}:" for depth, name in enumerate(names)]
        lines[number + 1 : number + 1] = [*added[:-1], f"{added[-1]} {value}"]
    return "\n".join(lines) + "\n"


def _line(parts: re.Match, value: str, *hints: str | None) -> str:
    """Return a line with the indent and the key of ``parts``."""
    hint = "; ".join(filter(None, hints))
    words = f"{parts['indent']}{parts['key']}:", value, hint and f"# {hint}"
    return " ".join(filter(None, words))


def _block(values: Mapping[str, Any], indent: str) -> Iterator[str]:
    for name, value in values.items():
        inner = value if isinstance(value, Mapping) else {}
        yield f"{indent}{text_of(name)}:{'' if inner else f' {value}'}"
        yield from _block(inner, f"{indent}  ")
