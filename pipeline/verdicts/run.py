"""Metrics and tables of a run, and references to single numbers in them."""

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

# metrics/STEM → values by name; tables/STEM → rows
Evidence = Mapping[str, Mapping[str, float] | pd.DataFrame]
T = TypeVar("T")
Number = Annotated[float, Field(strict=True)]  # no text and no truth value
TestName = Annotated[str, Field(pattern="::")]  # FILE::NAME
NUMBERED = 3  # number of joints of the paper's arm
JOINT = re.compile(r"\{joint (\d+)\}")
PLACEHOLDER = re.compile(r"\{(?!joint \d+\})([^{}]*)\}")


class ArmNames(NamedTuple):
    """Names of an arm's joints, base to tip, and of the rows of its task."""

    joints: tuple[str, ...]
    task: tuple[str, ...]

    @property
    def numbered(self) -> tuple[str, ...]:
        """Three joints of a planar chain whose task is the whole pose; else no joint."""
        return self.joints if len(self.joints) == NUMBERED and self.task == PLANE else ()

    def named(self, text: str) -> str:
        """Return ``text`` with the joint's name in place of each ``{joint N}``."""
        names = {str(number): name for number, name in enumerate(self.numbered, 1)}
        return JOINT.sub(lambda place: names.get(place[1], place[0]), text)


@options(frozen=True)
class Reference:
    """Place of a number: a metric by ``file`` and ``key``, or the ``column`` of the table row whose
    columns equal ``rows``; raises ConfigError without key or column.

    ``{joint 2}`` stands for the name of the second of the :attr:`ArmNames.numbered` joints, any
    other ``{name}`` for the value of this name in a case.
    """

    file: str
    key: str = ""
    rows: dict = field(default_factory=dict)
    column: str = ""

    def __post_init__(self) -> None:
        if bool(self.key) == bool(self.column) or (self.key and self.rows):
            message = f"{self.file}: needs a key, or a column and the rows of the number"
            raise ConfigError(message, key="key")

    @property
    def address(self) -> str:
        """File in the dataset's reports, and place in the file."""
        if self.key:
            return f"{self.file}.json: {self.key}"
        rows = ", ".join(f"{column} = {value}" for column, value in self.rows.items())
        return f"{self.file}.csv: {self.column}" + (f" where {rows}" if rows else "")

    @property
    def joint_numbers(self) -> list[int]:
        """Numbers of the joints in ``{joint N}``."""
        return [int(n) for text in vars(self).values() for n in JOINT.findall(str(text))]

    def in_case(self, case: Mapping[str, object]) -> "Reference":
        """Return this reference with the values of ``case``; ConfigError if it lacks a name."""

        def value(place: re.Match) -> str:
            if place[1] not in case:
                message = f"unknown placeholder; the claim has {', '.join(case) or 'none'}"
                raise ConfigError(message, file=self.file)
            return str(case[place[1]])

        return self._with(lambda text: PLACEHOLDER.sub(value, text))

    def look_up(self, evidence: Evidence, arm: ArmNames) -> float | None:
        """Return the number, None if it is missing; raises ConfigError if several rows fit."""
        if any(number > len(arm.numbered) for number in self.joint_numbers):
            return None
        named, value = self._with(arm.named), None
        content = evidence.get(self.file)
        if self.key and isinstance(content, Mapping):
            value = content.get(named.key)
        elif isinstance(content, pd.DataFrame) and {named.column, *named.rows} <= {*content}:
            for column, wanted in named.rows.items():
                content = content[content[column] == wanted]
            if len(content) > 1:
                message = f"{len(content)} rows fit; name more columns"
                raise ConfigError(message, file=self.file, rows=named.rows)
            value = content[named.column].iloc[0] if len(content) else None
        return None if value is None or pd.isna(value) else float(value)

    def _with(self, change: Callable[[str], str]) -> "Reference":
        rows = {c: change(v) if isinstance(v, str) else v for c, v in self.rows.items()}
        return Reference(change(self.file), change(self.key), rows, change(self.column))


def parse_entries(structure: type[T], entries: object, kind: str, name: str = "id") -> list[T]:
    """Return a ``structure`` for each of ``entries``; raises ConfigError with the ``kind`` and
    ``name`` of the entry and the key for an invalid entry and for two entries of equal name.
    """
    if not isinstance(entries, list):
        raise ConfigError(f"must be a list, got {entries!r:.40}", key=f"{kind}s")
    result = {}
    for number, entry in enumerate(entries, 1):
        own = (entry.get(name) if isinstance(entry, dict) else None) or number
        if own in result:
            raise ConfigError(f"two {kind}s have the same {name}", **{kind: own, "key": name})
        try:
            result[own] = validated(structure, entry)
        except ConfigError as error:
            raise ConfigError(error.message, **{kind: own} | error.evidence) from None
    return list(result.values())


@dataclass(frozen=True)
class Run:
    """Results of a run: kinds of the models by name, metrics and tables by file stem."""

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
        """Names of the joints and of the task rows."""
        return ArmNames(tuple(self.joints), tuple(self.task))

    @property
    def evidence(self) -> Evidence:
        """Metrics and tables by the file names of :class:`Reference`."""
        metrics = {f"metrics/{stem}": values for stem, values in self.metrics.items()}
        return metrics | {f"tables/{stem}": rows for stem, rows in self.tables.items()}

    def to_json(self) -> str:
        """Return JSON with full precision; a table is a list of CSV lines."""
        values = {**vars(self), "joints": list(self.joints), "task": list(self.task)}
        values["tables"] = {
            stem: rows.to_csv(index=False).splitlines() for stem, rows in self.tables.items()
        }
        return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def read_runs(folder: Path, first: str) -> list[Run]:
    """Return the runs in ``folder``, the dataset ``first`` before the others by file name; raises
    ContractError if ``first`` is missing or a file is not of :meth:`Run.to_json`.
    """
    runs = {run.dataset: run for run in map(read_run, sorted(folder.glob("*.json")))}
    if first not in runs:
        message = f"there is no evidence of the dataset {first}; run the stage score with it"
        raise ContractError(message, file=folder / f"{first}.json")
    return [runs.pop(first), *runs.values()]


def read_run(file: Path) -> Run:
    """Read one run; raises ContractError for a ``file`` that is not of :meth:`Run.to_json`."""
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
        for stem, lines in values["tables"].items():
            values["tables"][stem] = pd.read_csv(io.StringIO("\n".join(lines)))
        return Run(**values)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        message = f"cannot read the evidence of a run ({error}); run the stage score again"
        raise ContractError(message, file=file) from None
