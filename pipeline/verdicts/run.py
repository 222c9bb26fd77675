"""Numbers of a run: metrics and tables in a file whose changes git shows by line, and the places
by which claims and errata refer to them.
"""

import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple, TypeVar

import pandas as pd
from pydantic import Field

from pipeline.core.columns import PLANE
from pipeline.core.errors import ConfigError, ContractError
from pipeline.core.validation import options, validated

# file of a dataset's reports without its suffix (metrics/motion, tables/sigma_s) → name → value, or
# the rows of a table
Evidence = Mapping[str, Mapping[str, float] | pd.DataFrame]
T = TypeVar("T")
Number = Annotated[float, Field(strict=True)]  # no text and no truth value
TestName = Annotated[str, Field(pattern="::")]  # FILE::NAME
NUMBERED = 3  # joints of the paper's arm
PLACEHOLDER, JOINT = re.compile(r"\{([^{}]*)\}"), re.compile(r"\{joint (\d+)\}")


class ArmNames(NamedTuple):
    """Names of the joints of a run's arm, base to tip, and of the rows of its task."""

    joints: tuple[str, ...]
    task: tuple[str, ...]

    @property
    def numbered(self) -> tuple[str, ...]:
        """Joints by number: of a planar chain of three with its whole pose as task."""
        same = len(self.joints) == NUMBERED and self.task == PLANE
        return self.joints if same else ()

    def named(self, text: str) -> str:
        """Return ``text`` with a joint's name in the place of each number that the arm has."""
        names = {str(number): name for number, name in enumerate(self.numbered, 1)}
        return JOINT.sub(lambda place: names.get(place[1], place[0]), text)


@options(frozen=True)
class Reference:
    """A metric by ``file`` and ``key``, or the ``column`` of the one row of a table whose columns
    equal ``rows``; ConfigError if it is neither.

    ``{joint 2}`` in any of them is the name of the second of the :attr:`ArmNames.numbered` joints
    of a dataset; any other ``{name}`` is that name's value in a case.
    """

    file: str
    key: str = ""
    rows: dict = field(default_factory=dict)
    column: str = ""

    def __post_init__(self) -> None:
        if bool(self.key) == bool(self.column) or (self.key and self.rows):
            message = f"{self.file}: needs a key, or a column and the rows it is read from"
            raise ConfigError(message, key="key")

    @property
    def address(self) -> str:
        """File in the folder of the dataset's reports, and the place within it."""
        if self.key:
            return f"{self.file}.json: {self.key}"
        rows = ", ".join(f"{column} = {value}" for column, value in self.rows.items())
        return f"{self.file}.csv: {self.column}" + (f" where {rows}" if rows else "")

    @property
    def joint_numbers(self) -> list[int]:
        """Numbers of the joints that it names by their number."""
        return [int(n) for text in vars(self).values() for n in JOINT.findall(str(text))]

    def in_case(self, case: Mapping[str, object]) -> "Reference":
        """Return this reference with the values of ``case`` in its placeholders. Raises ConfigError
        for one that the case does not have.
        """

        def value(place: re.Match) -> str:
            if JOINT.fullmatch(place[0]):
                return place[0]
            if place[1] not in case:
                message = f"a placeholder that is not among {', '.join(case) or 'none'}"
                raise ConfigError(message, file=self.file)
            return str(case[place[1]])

        return self._with(lambda text: PLACEHOLDER.sub(value, text))

    def look_up(self, evidence: Evidence, arm: ArmNames) -> float | None:
        """Return the number, None if the run has none; ConfigError if several rows fit."""
        if any(number > len(arm.numbered) for number in self.joint_numbers):
            return None
        named, value = self._with(arm.named), None
        numbers = evidence.get(self.file)
        if self.key and isinstance(numbers, Mapping):
            value = numbers.get(named.key)
        elif isinstance(numbers, pd.DataFrame) and {named.column, *named.rows} <= {*numbers}:
            for column, wanted in named.rows.items():
                numbers = numbers[numbers[column] == wanted]
            if len(numbers) > 1:
                message = f"{len(numbers)} rows fit; name more columns"
                raise ConfigError(message, file=self.file, rows=named.rows)
            value = numbers[named.column].iloc[0] if len(numbers) else None
        return None if value is None or pd.isna(value) else float(value)

    def _with(self, change: Callable[[str], str]) -> "Reference":
        rows = {c: change(v) if isinstance(v, str) else v for c, v in self.rows.items()}
        return Reference(change(self.file), change(self.key), rows, change(self.column))


def parsed_entries(structure: type[T], entries: object, kind: str, name: str = "id") -> list[T]:
    """Return a ``structure`` for each of ``entries``, no two of one ``name``. Raises ConfigError
    with ``kind``, name and key.
    """
    if not isinstance(entries, list):
        raise ConfigError(f"must be a list, got {entries!r:.40}", key=f"{kind}s")
    result = {}
    for number, entry in enumerate(entries, 1):
        own = (entry.get(name) if isinstance(entry, dict) else None) or number
        if own in result:
            raise ConfigError(f"two {kind}s have one {name}", **{kind: own, "key": name})
        try:
            result[own] = validated(structure, entry)
        except ConfigError as error:
            raise ConfigError(error.message, **{kind: own} | error.evidence) from None
    return list(result.values())


@dataclass(frozen=True)
class Run:
    """A run: joints and task rows, models (name → kind), metrics and tables by file stem."""

    dataset: str
    scale: str
    synthetic: bool
    joints: Sequence[str]
    task: Sequence[str]
    models: Mapping[str, str]
    metrics: Mapping[str, Mapping[str, float]]
    tables: Mapping[str, pd.DataFrame]

    @property
    def arm(self) -> ArmNames:
        """Names of its joints and rows."""
        return ArmNames(tuple(self.joints), tuple(self.task))

    @property
    def evidence(self) -> Evidence:
        """The numbers by the names that claims and errata refer to them by."""
        metrics = {f"metrics/{stem}": values for stem, values in self.metrics.items()}
        return metrics | {f"tables/{stem}": rows for stem, rows in self.tables.items()}

    def to_json(self) -> str:
        """Return JSON in full precision; a table is a list of the lines of its CSV."""
        values = {**vars(self), "joints": list(self.joints), "task": list(self.task)}
        values["tables"] = {
            stem: rows.to_csv(index=False).splitlines() for stem, rows in self.tables.items()
        }
        return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def read_runs(folder: Path, first: str) -> list[Run]:
    """Read the runs of a folder by the names of their datasets, ``first`` before all others. Raises
    ContractError if that one is missing, or for a file that ``Run.to_json`` did not write.
    """
    runs = {run.dataset: run for run in map(read_run, sorted(folder.glob("*.json")))}
    if first not in runs:
        message = f"there is no evidence of the dataset {first}; run the stage score with it"
        raise ContractError(message, file=folder / f"{first}.json")
    return [runs.pop(first), *runs.values()]


def read_run(file: Path) -> Run:
    """Read one run."""
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
        lines = values.pop("tables").items()
        tables = {stem: pd.read_csv(io.StringIO("\n".join(rows))) for stem, rows in lines}
        return Run(**values, tables=tables)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        message = f"no evidence of a run ({error}); run the stage score with that dataset"
        raise ContractError(message, file=file) from None
