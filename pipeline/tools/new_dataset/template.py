"""The two files of a dataset from one commented template: known values, and ??? for the others."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from pipeline.tools.new_dataset.yaml_text import OPEN

TEMPLATE = Path(__file__).with_name("template.yaml")
LINE = re.compile(
    r"(?P<optional>\?)?(?P<indent> *)(?P<key>\w+):(?: (?P<value>[^#]*?))?(?: # (?P<hint>.*))?"
)
MARK = re.compile(r"\{(\w+)\}")


def fill_template(
    name: str, known: Mapping[str, str], blocks: Mapping[str, list[str]]
) -> list[str]:
    """Return the texts of datasheet and option file of the dataset ``name``.

    ``known`` holds YAML values by dotted key, each with ` # note` behind it or not; a block of
    lines below the key begins with a line end. An optional key (?) that is not in ``known`` is left
    out, with all below it. ``blocks`` are lines that a mark of the template stands for.
    """
    texts = TEMPLATE.read_text(encoding="utf-8").split("---\n")
    return ["\n".join(_filled(text, name, known, blocks)) + "\n" for text in texts]


def _filled(
    text: str, name: str, known: Mapping[str, str], blocks: Mapping[str, list[str]]
) -> list[str]:
    lines: list[str] = []
    path: list[str] = []
    left_out: int | None = None  # indentation of the key whose lines are left out
    for line in text.splitlines():
        if mark := MARK.fullmatch(line):
            lines += blocks.get(mark[1], [])
            continue
        body = line.removeprefix("?")
        depth = len(body) - len(body.lstrip())
        if left_out is not None and depth > left_out:
            continue
        left_out = None
        if body.lstrip().startswith("#"):
            lines.append(body.replace("{name}", name))
            continue
        parts = LINE.fullmatch(line)
        path = [*path[: depth // 2], parts["key"]]
        key = ".".join(path)
        if parts["optional"] and key not in known:
            left_out = depth
            continue
        lines.append(_line(parts, known.get(key, "")))
    return lines


def _line(parts: re.Match, known: str) -> str:
    value, _, note = ("", "", "") if known.startswith("\n") else known.partition(" # ")
    hint = "; ".join(filter(None, [note, parts["hint"]]))
    comment = f" # {hint}" if hint else ""
    start = f"{parts['indent']}{parts['key']}:"
    if known.startswith("\n"):
        return f"{start}{comment}{known}"
    value = value or parts["value"] or ""
    return f"{start}{' ' if value else ''}{value}{comment}"


def asked(note: str = "") -> str:
    """Return ??? with a ``note`` for the user."""
    return f"{OPEN} # {note}" if note else OPEN
