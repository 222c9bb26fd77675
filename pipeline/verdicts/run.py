"""Metrics and tables of a run, and references to single numbers in them."""

import hashlib
import io
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, TypeVar

import pandas as pd
from pydantic import Field

from pipeline.core.columns import PLANE
from pipeline.core.errors import ConfigError, ContractError
from pipeline.core.validation import options, validated
from pipeline.evidence.table import DECLARED, KEYS, NUMBERS, QUANTITIES

# rows of the table ``evidence`` by their keys
IndexedEvidence = Mapping[tuple[str, ...], Mapping[str, float]]
HASH = "sha256"  # key of the hash of all other content
EVIDENCE_TABLES = ("evidence", "readings")
T = TypeVar("T")
Number = Annotated[float, Field(strict=True)]  # no text and no truth value
TestName = Annotated[str, Field(pattern="::")]  # FILE::NAME
PLACEHOLDER = re.compile(r"\{([^{}]*)\}")
NUMBERED = 3  # number of joints of the paper's arm
PROJECT = Path("pyproject.toml")  # it states the version


class ArmNames(NamedTuple):
    """Names of an arm's joints, base to tip, and of the rows of its task."""

    joints: tuple[str, ...]
    task: tuple[str, ...]

    @property
    def numbered(self) -> dict[str, str]:
        """Names by ``joint N`` of the three joints of a planar chain whose task is the whole pose;
        {} for any other arm.
        """
        papers = len(self.joints) == NUMBERED and self.task == PLANE
        return (
            {f"joint {n}": name for n, name in enumerate(self.joints, 1)}
            if papers
            else {}
        )


def filled(text: str, names: Mapping[str, object]) -> str:
    """Return ``text`` with ``names`` in place of each ``{name}``; other placeholders stay."""
    return PLACEHOLDER.sub(lambda place: str(names.get(place[1], place[0])), text)


@options(frozen=True)
class Reference:
    """Place of a number in the table ``evidence``: the ``column`` of the row with these keys;
    raises ConfigError for an undeclared quantity. A ``{name}`` stands for the value of this name in
    a case, ``{joint 2}`` for the name of the second of the :attr:`ArmNames.numbered` joints.
    """

    quantity: str
    model: str = ""
    estimator: str = ""
    rival: str = ""
    joint: str = ""
    entry: str = ""
    configuration: str = ""
    steps: str = ""
    column: Literal[NUMBERS] = "value"

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            message = f"the table of evidence has no quantity {self.quantity!r}; see tables.yaml"
            raise ConfigError(message, key="quantity")

    def look_up(
        self,
        evidence: IndexedEvidence,
        names: Mapping[str, object],
    ) -> float | None:
        """Return the number with ``names`` in place of their placeholders, None if missing."""
        row = evidence.get(tuple(filled(getattr(self, key), names) for key in KEYS), {})
        value = row.get(self.column)
        return None if value is None or pd.isna(value) else float(value)


def index_evidence(table: pd.DataFrame, **place: object) -> IndexedEvidence:
    """Return the rows of the table ``evidence`` by their keys; raises ContractError with the
    ``place`` for two rows with equal keys.
    """
    for twice in table.loc[table.duplicated([*KEYS]), [*KEYS]].to_numpy():
        message = f"two rows of the evidence have equal keys: {', '.join(filter(None, twice))};"
        raise ContractError(f"{message} run the stage score again", **place)
    return table.set_index([*KEYS]).to_dict("index")


def parse_entries(
    structure: type[T],
    entries: object,
    kind: str,
    name: str = "id",
) -> list[T]:
    """Return a ``structure`` for each of ``entries``; raises ConfigError with the ``kind`` and
    ``name`` of the entry and the key for an invalid entry and for two entries of equal name.
    """
    if not isinstance(entries, list):
        raise ConfigError(f"must be a list, got {entries!r:.40}", key=f"{kind}s")
    result = {}
    for number, entry in enumerate(entries, 1):
        own = (entry.get(name) if isinstance(entry, dict) else None) or number
        if own in result:
            raise ConfigError(
                f"two {kind}s have the same {name}",
                **{kind: own, "key": name},
            )
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
    # of a synthetic arm's noise; runs of equal ``arm`` differ only in it
    cause: str = ""
    version: str = ""  # of the project that computed the numbers; "" before 0.4

    @property
    def arm(self) -> ArmNames:
        """Names of the joints and of the task rows."""
        return ArmNames(tuple(self.joints), tuple(self.task))

    @property
    def raw_hashes(self) -> list[str]:
        """Hashes of the raw files by file or folder of the recordings, without licences."""
        files = self.tables.get("raw_files", pd.DataFrame(columns=["place", "sha256"]))
        licences = files["place"].astype(str).str.upper().str.startswith("LICEN")
        return [*files.loc[~licences, "sha256"]]

    @property
    def evidence(self) -> pd.DataFrame:
        """The table ``evidence``."""
        return self.tables.get("evidence", pd.DataFrame(columns=[*DECLARED]))

    def recorded(self, quantity: str, default: float) -> float:
        """Return a number of the recordings in the table ``evidence``, or ``default``."""
        rows = self.evidence.query("quantity == @quantity and model == 'recorded'")
        return float(rows["value"].iloc[0]) if len(rows) else default

    def to_json(self) -> str:
        """Return JSON with full precision and a hash of it; a table is a list of CSV lines."""
        values = {**vars(self), "joints": list(self.joints), "task": list(self.task)}
        values["tables"] = {
            stem: rows.to_csv(index=False).splitlines()
            for stem, rows in self.tables.items()
        }
        values |= {HASH: _content_hash(values)}
        return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def project_version() -> str:
    """Return the version of the project."""
    return tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["version"]


def _content_hash(values: Mapping[str, object]) -> str:
    content = json.dumps(values, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(content.encode()).hexdigest()


def read_runs(folder: Path, first: Path) -> list[Run]:
    """Return the run of the file ``first``, then the runs of other datasets in ``folder`` by file
    name; raises ContractError if ``first`` is missing or a file is not of :meth:`Run.to_json`.
    """
    if not first.is_file():
        dataset = first.stem
        message = f"there is no evidence of the dataset {dataset}; run the stage score with it"
        raise ContractError(message, file=first)
    files = [file for file in sorted(folder.glob("*.json")) if file.name != first.name]
    return [read_run(file) for file in (first, *files)]


def read_run(file: Path) -> Run:
    """Read one run; raises ContractError for a ``file`` that is not of :meth:`Run.to_json`, or that
    was edited since.
    """
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
        if values.pop(HASH) != _content_hash(values):
            message = "the evidence was edited after its stage wrote it: the content does not have"
            message += " the stated sha256; restore the file, or run the dataset again"
            raise ContractError(message, file=file)
        if (name := values["dataset"]) != file.stem:
            message = f"the evidence is of the dataset {name}; rename the file, or remove the copy"
            raise ContractError(message, file=file)
        for stem, lines in values["tables"].items():
            text = dict.fromkeys(KEYS, str) if stem in EVIDENCE_TABLES else {}
            table = pd.read_csv(io.StringIO("\n".join(lines)), dtype=text)
            values["tables"][stem] = table.fillna(dict.fromkeys(text, ""))
        run = Run(**values)
        index_evidence(run.evidence, file=file)
        return run
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        RecursionError,
    ) as error:
        message = (
            f"cannot read the evidence of a run ({error}); run the stage score again"
        )
        raise ContractError(message, file=file) from None
