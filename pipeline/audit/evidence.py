"""Where a number of a run stands, and what it is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import pandas as pd

from pipeline.audit.strict import texts
from pipeline.errors import ConfigError

# file below reports without its suffix (metrics/motion, tables/sigma_s) → name → value, or the rows of a table
Evidence = Mapping[str, Mapping[str, float] | pd.DataFrame]


@dataclass(frozen=True)
class Reference:
    """A metric by ``file`` and ``key``, or the ``column`` of the one row of a table whose columns equal ``rows``.

    ``{name}`` in any of them stands for that name's value in a case. Raises ConfigError where it is neither.
    """

    file: str
    key: str = ""
    rows: dict = field(default_factory=dict)
    column: str = ""

    def __post_init__(self) -> None:
        texts(self, "file", "key", "column")
        if bool(self.key) == bool(self.column) or not isinstance(self.rows, dict) or (self.key and self.rows):
            raise ConfigError("a reference names a key, or a column and the rows it is read from", file=self.file)

    @property
    def address(self) -> str:
        """File and place within it, for a reader."""
        if self.key:
            return f"reports/{self.file}.json: {self.key}"
        rows = ", ".join(f"{column} = {value}" for column, value in self.rows.items())
        return f"reports/{self.file}.csv: {self.column}" + (f" where {rows}" if rows else "")

    def of_case(self, case: Mapping[str, object]) -> Reference:
        """This reference with the values of ``case`` in its placeholders. Raises ConfigError for one that the case does not have."""

        def filled(text: object) -> object:
            return text.format(**case) if isinstance(text, str) else text

        try:
            rows = {column: filled(value) for column, value in self.rows.items()}
            return Reference(filled(self.file), filled(self.key), rows, filled(self.column))
        except (KeyError, IndexError, ValueError):
            raise ConfigError(f"a placeholder that is not among {', '.join(case) or 'none'}", file=self.file) from None

    def look_up(self, evidence: Evidence) -> float | None:
        """The number, or None where the run has none. Raises ConfigError where more than one row of the table fits."""
        found = evidence.get(self.file)
        if found is None:
            return None
        if self.key:
            value = None if isinstance(found, pd.DataFrame) else found.get(self.key)
        else:
            value = self._cell(found)
        return None if value is None or pd.isna(value) else float(value)

    def _cell(self, table: object) -> object:
        if not isinstance(table, pd.DataFrame) or not {self.column, *self.rows} <= set(table.columns):
            return None
        fits = table
        for column, wanted in self.rows.items():
            fits = fits[fits[column] == wanted]
        if len(fits) > 1:
            raise ConfigError(f"{len(fits)} rows fit; name more columns", file=self.file, rows=self.rows)
        return fits[self.column].iloc[0] if len(fits) else None
