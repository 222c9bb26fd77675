"""Evidence of one run for comparison with others, in a file whose changes git shows by line."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pipeline.core.errors import ContractError
from pipeline.verdicts.reference import ArmNames, Evidence


@dataclass(frozen=True)
class Run:
    """A run with ``dataset``: the names of its joints, base to tip, and of its task's rows, its
    models (name → kind), metrics (file stem → name → value) and tables (file stem → rows).
    """

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
