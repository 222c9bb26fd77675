"""The options of the synthetic laboratory with what is said of them where they are declared: unit,
meaning and source.
"""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterator, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Option:
    """An option's dotted name, its value, what is said of it, and the value that it has where a
    dataset gives none, if that is another.
    """

    name: str
    value: object
    said: str
    default: object | None


@dataclass(frozen=True)
class Part:
    """A part of the laboratory: its name, what is said of it as a whole, and its options."""

    name: str
    said: str
    options: list[Option]


@dataclass(frozen=True)
class _Comment:
    text: str
    alone: bool  # on its line


def parts(source: str, kinds: Mapping[str, str], values: Mapping[str, Mapping]) -> list[Part]:
    """The parts in ``values`` (part → option → value), each of the class in ``kinds`` that the
    modules whose text is ``source`` declare.
    """
    classes = {node.name: node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)}
    comments = _comments(source)
    return [
        part
        for name, options in values.items()
        for part in _parts(name, classes[kinds[name]], options, classes, comments)
    ]


def _parts(
    name: str,
    declared: ast.ClassDef,
    values: Mapping,
    classes: Mapping[str, ast.ClassDef],
    comments: Mapping[int, _Comment],
) -> Iterator[Part]:
    """A part, and after it those that are options of it."""
    options, nested = [], []
    for field in declared.body:
        if not isinstance(field, ast.AnnAssign):
            continue
        key, kind = ast.unparse(field.target), ast.unparse(field.annotation)
        if kind in classes:
            nested += _parts(f"{name}.{key}", classes[kind], values[key], classes, comments)
            continue
        default = ast.literal_eval(field.value) if field.value else None
        same = default is None or _plain(default) == _plain(values[key])
        options.append(
            Option(
                f"{name}.{key}",
                _plain(values[key]),
                _said(field, comments),
                None if same else _plain(default),
            )
        )
    yield Part(name, " ".join((ast.get_docstring(declared) or "").split()), options)
    yield from nested


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def _said(field: ast.AnnAssign, comments: Mapping[int, _Comment]) -> str:
    """The comment beside a field, or else the lines of nothing but comments above it."""
    if field.end_lineno in comments:
        return comments[field.end_lineno].text
    lines, line = [], field.lineno - 1
    while line in comments and comments[line].alone:
        lines.insert(0, comments[line].text)
        line -= 1
    return " ".join(lines)


def _comments(source: str) -> dict[int, _Comment]:
    """The comment of every line that has one."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    result = [token for token in tokens if token.type == tokenize.COMMENT]
    return {
        token.start[0]: _Comment(token.string.lstrip("# "), token.line.lstrip().startswith("#"))
        for token in result
    }
