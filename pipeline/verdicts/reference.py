"""Where a number of a run stands, and what it is there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, NamedTuple, TypeVar

import pandas as pd
from pydantic import Field

from pipeline.core.errors import ConfigError
from pipeline.core.task import PLANE
from pipeline.core.validation import options, validated

# file below reports without its suffix (metrics/motion, tables/sigma_s) → name → value, or the rows
# of a table
Evidence = Mapping[str, Mapping[str, float] | pd.DataFrame]
T = TypeVar("T")
Number = Annotated[float, Field(strict=True)]  # no text and no truth value
TestName = Annotated[str, Field(pattern="::")]  # FILE::NAME
NUMBERED = 3  # joints of the paper's arm
PLACEHOLDER, JOINT = re.compile(r"\{([^{}]*)\}"), re.compile(r"\{joint (\d+)\}")


class ArmNames(NamedTuple):
    """What a run calls the joints of its arm, base to tip, and the rows of its task."""

    joints: tuple[str, ...]
    task: tuple[str, ...]

    @property
    def numbered(self) -> tuple[str, ...]:
        """The joints where a number means one, as in the paper: those of a planar chain of three
        with its whole pose as the task; of any other arm none.
        """
        same = len(self.joints) == NUMBERED and self.task == PLANE
        return self.joints if same else ()


@options(frozen=True)
class Reference:
    """A metric by ``file`` and ``key``, or the ``column`` of the one row of a table whose columns
    equal ``rows``.

    ``{joint 2}`` in any of them stands for the name of the second of the :attr:`ArmNames.numbered`
    joints, which each dataset has of its own; any other ``{name}`` for that name's value in a case.
    Raises ConfigError where it is neither.
    """

    file: str
    key: str = ""
    rows: dict = field(default_factory=dict)
    column: str = ""

    def __post_init__(self) -> None:
        if bool(self.key) == bool(self.column) or (self.key and self.rows):
            raise ConfigError(
                f"a reference to {self.file} names a key, or a column and the rows it is read from",
                key="key",
            )

    @property
    def address(self) -> str:
        """File in the folder of the dataset's reports, and the place within it."""
        if self.key:
            return f"{self.file}.json: {self.key}"
        rows = ", ".join(f"{column} = {value}" for column, value in self.rows.items())
        return f"{self.file}.csv: {self.column}" + (f" where {rows}" if rows else "")

    @property
    def numbers_joints(self) -> bool:
        """Whether it names a joint by its number."""
        return any(JOINT.search(text) for text in self._texts)

    def in_case(self, case: Mapping[str, object]) -> Reference:
        """This reference with the values of ``case`` in its placeholders. Raises ConfigError for
        one that the case does not have.
        """

        def value(place: re.Match) -> str:
            name = place[1]
            if JOINT.fullmatch(place[0]):
                return place[0]
            if name not in case:
                raise ConfigError(
                    f"a placeholder that is not among {', '.join(case) or 'none'}", file=self.file
                )
            return str(case[name])

        return self._with(lambda text: PLACEHOLDER.sub(value, text))

    def look_up(self, evidence: Evidence, arm: ArmNames) -> float | None:
        """The number, or None where the run of ``arm`` has none, or no joint of that number.

        Raises ConfigError where more than one row of the table fits.
        """
        numbers = [int(number) for text in self._texts for number in JOINT.findall(text)]
        if any(number > len(arm.numbered) for number in numbers):
            return None
        return self._with(lambda text: joint_names(text, arm))._value(evidence.get(self.file))

    @property
    def _texts(self) -> list[str]:
        texts = [self.key, self.column, *self.rows.values()]
        return [text for text in texts if isinstance(text, str)]

    def _with(self, change) -> Reference:
        rows = {
            column: change(value) if isinstance(value, str) else value
            for column, value in self.rows.items()
        }
        return Reference(change(self.file), change(self.key), rows, change(self.column))

    def _value(self, numbers: Mapping[str, float] | pd.DataFrame | None) -> float | None:
        if self.column:
            value = self._cell(numbers) if isinstance(numbers, pd.DataFrame) else None
        else:
            value = numbers.get(self.key) if isinstance(numbers, Mapping) else None
        return None if value is None or pd.isna(value) else float(value)

    def _cell(self, table: pd.DataFrame) -> object:
        if not {self.column, *self.rows} <= set(table.columns):
            return None
        fits = table
        for column, wanted in self.rows.items():
            fits = fits[fits[column] == wanted]
        if len(fits) > 1:
            raise ConfigError(
                f"{len(fits)} rows fit; name more columns", file=self.file, rows=self.rows
            )
        return fits[self.column].iloc[0] if len(fits) else None


def joint_names(text: str, arm: ArmNames) -> str:
    """``text`` with the name of a joint in the place of each of its numbers that ``arm`` has."""
    named = {str(number): name for number, name in enumerate(arm.numbered, 1)}
    return JOINT.sub(lambda place: named.get(place[1], place[0]), text)


def parsed_entries(structure: type[T], entries: object, kind: str) -> list[T]:
    """An object of type ``structure`` for each of ``entries``, a YAML list. Raises ConfigError with
    the key and, under the name ``kind``, the id or number of the entry.
    """
    if not isinstance(entries, list):
        raise ConfigError(f"must be a list, got {entries!r:.40}", key=f"{kind}s")
    result = []
    for number, entry in enumerate(entries, 1):
        name = entry.get("id", number) if isinstance(entry, dict) else number
        try:
            result.append(validated(structure, entry))
        except ConfigError as error:
            raise ConfigError(error.message, **{kind: name} | error.evidence) from None
    return result
