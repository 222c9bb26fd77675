"""The declarations of tables, read from the files ``tables.yaml``: of the paper's stages beside
this module, of a study in its folder.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pandera.pandas as pa

from pipeline.core.typed_yaml import read_yaml

PAPER = Path(__file__).with_name("tables.yaml")
DECLARATION = re.compile(
    r"(?P<kind>real|log|count|flag|text)"
    r"(?: \((?P<among>[^)]*)\))?(?: (?P<low>[^ .]+)\.\.(?P<high>[^ ]*))?(?P<gaps> gaps)?"
    r"(?P<optional> optional)? \| (?P<meaning>.+)"
)


@cache
def declared(file: Path = PAPER) -> dict[str, dict[str, pa.Column]]:
    """Columns by name of every table of ``file``; a name with ``*`` or ``#`` stands for a
    family.
    """
    tables = {name: lines for name, lines in read_yaml(file).items() if name[0] != "."}
    return {
        name: {column: _column(text) for column, text in lines.items()}
        for name, lines in tables.items()
    }


def expanded(declaration: dict[str, pa.Column], present: list[str]) -> dict[str, pa.Column]:
    """The ``declaration`` with every family replaced by its members among the columns ``present``.

    A family of which there is none stays as it is declared, so that its absence is noticed, but for
    an optional one.
    """
    columns = {}
    for name, column in declaration.items():
        pattern = re.escape(name).replace(r"\*", "[^:]+").replace(r"\#", "[1-9]")
        single = pattern == re.escape(name)
        family = [name] if single else [c for c in present if re.fullmatch(pattern, str(c))]
        columns |= dict.fromkeys(family or [name] * column.required, column)
    return columns


def _column(text: str) -> pa.Column:
    parts = DECLARATION.fullmatch(text)
    if parts is None:
        raise ValueError(f"not the declaration of a column: {text!r}")
    kind, gaps, meaning = parts["kind"], parts["gaps"] is not None, parts["meaning"]
    bounds = [pa.Check.ge(float(parts["low"]))] if parts["low"] else []
    bounds += [pa.Check.le(float(parts["high"]))] if parts["high"] else []
    match kind:
        case "real":
            finite = pa.Check(np.isfinite, error="must be finite")
            checks, required = [finite, *bounds], parts["optional"] is None
            return pa.Column(
                "float64", checks, nullable=gaps, required=required, description=meaning
            )
        case "log":
            below = pa.Check(lambda x: x < np.inf, error="must not be plus infinity")
            return pa.Column("float64", below, nullable=True, description=meaning)
        case "count":
            return pa.Column("int64", bounds or pa.Check.ge(0), description=meaning)
        case "flag":
            return pa.Column("bool", description=meaning)
    among = [name.strip() for name in (parts["among"] or "").split(",") if name]
    return pa.Column("str", pa.Check.isin(among) if among else None, description=meaning)
