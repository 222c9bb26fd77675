"""Text of datasheet and option file: a template with known values, and ??? for other values."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from pipeline.configuration.datasheet import OPEN
from pipeline.core.typed_yaml import parse_yaml

LINE = re.compile(
    r'(?P<optional>\??)(?P<indent> *)(?P<key>"(?:[^"\\]|\\.)*"|[^\s#:"]+):'
    r"(?: (?P<value>[^#].*?))?(?: # (?P<hint>.*))?"
)


class Entry(NamedTuple):
    """Value of a key (YAML or mapping; None: ???), note for the comment, False if a suggestion."""

    value: str | Mapping[str, Any] | None = None
    note: str = ""
    certain: bool = True


def text_of(text: str) -> str:
    """Return ``text`` as YAML, quoted if YAML could read another value."""
    plain = re.fullmatch(r"[A-Za-z_.][\w./*-]*", text, re.ASCII) and parse_yaml(text) == text
    return text if plain else json.dumps(text, ensure_ascii=False)


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
