"""The declarations of tables, read from the files ``tables.yaml``: of the paper's stages beside
this module, of a study in its folder.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core.typed_yaml import read_yaml

PAPER = Path(__file__).with_name("tables.yaml")
DECLARATION = re.compile(
    r"(?P<kind>real|log|count|flag|text)"
    r"(?: \((?P<among>[^)]*)\))?(?: (?P<low>[^ .]+)\.\.(?P<high>[^ ]*))?(?P<gaps> gaps)?"
    r"(?P<optional> optional)? \| .+"
)
TYPES = {"real": "float64", "log": "float64", "count": "int64", "flag": "bool"}


@dataclass(frozen=True)
class Column:
    """What a column declares: its kind, its least and greatest value, the texts that it may hold
    (any, where there are none), whether a value and whether the column may be missing.
    """

    kind: str
    low: float
    high: float
    among: tuple[str, ...]
    gaps: bool
    optional: bool

    def fault(self, values: pd.Series) -> str | None:
        """The first rule that ``values`` break, and the first that breaks it; None if none does."""
        if self.kind == "text":
            if pd.api.types.infer_dtype(values) not in {"string", "empty"}:
                return "must be text"
            other = ~values.isin(self.among) & bool(self.among)
            rules = {
                "must have no gaps": values.isna(),
                f"must be one of {', '.join(self.among)}": other,
            }
        elif str(values.dtype) != TYPES[self.kind]:
            return f"must be {TYPES[self.kind]}, not {values.dtype}"
        else:
            numbers = values.to_numpy()
            rules = {
                "must have no gaps": np.isnan(numbers) & (not self.gaps),
                "must be finite": np.isinf(numbers) & (self.kind == "real"),
                "must not be plus infinity": numbers == np.inf,
                f"must be at least {self.low:g}": numbers < self.low,
                f"must be at most {self.high:g}": numbers > self.high,
            }
        for rule, broken in rules.items():
            if np.any(broken):
                return f"{rule}, not {values.to_numpy()[np.argmax(broken)]}"
        return None


@cache
def declared(file: Path = PAPER) -> dict[str, dict[str, Column]]:
    """Columns by name of every table of ``file``; a name with ``*`` or ``#`` stands for a
    family.
    """
    tables = {name: lines for name, lines in read_yaml(file).items() if name[0] != "."}
    return {
        name: {column: _column(text) for column, text in lines.items()}
        for name, lines in tables.items()
    }


def expanded(declaration: dict[str, Column], present: list[str]) -> dict[str, Column]:
    """The ``declaration`` with every family replaced by its members among the columns ``present``.

    A family of which there is none stays as it is declared, so that its absence is noticed, but for
    an optional one.
    """
    columns = {}
    for name, column in declaration.items():
        pattern = re.escape(name).replace(r"\*", "[^:]+").replace(r"\#", "[1-9]")
        family = [c for c in present if re.fullmatch(pattern, str(c))]
        columns |= dict.fromkeys(family or [name] * (not column.optional), column)
    return columns


def _column(text: str) -> Column:
    parts = DECLARATION.fullmatch(text)
    if parts is None:
        raise ValueError(f"not the declaration of a column: {text!r}")
    kind, among = parts["kind"], (parts["among"] or "").split(",")
    return Column(
        kind,
        low=float(parts["low"] or (0 if kind == "count" else -np.inf)),
        high=float(parts["high"] or np.inf),
        among=tuple(name.strip() for name in among if name),
        gaps=parts["gaps"] is not None or kind == "log",
        optional=parts["optional"] is not None,
    )
