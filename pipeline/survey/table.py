"""The table of a survey: columns, units and ranges, as :mod:`pipeline.tables` declares those between stages.

Declared here and not there, for every stage depends on that module, and no stage on a survey.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pandera.pandas as pa
import pyarrow
from pyarrow.parquet import ParquetWriter

from pipeline.audit.claims import ABOUT
from pipeline.audit.sensitivity import FAILS, HOLDS, UNKNOWN
from pipeline.survey.conditions import FACTORS
from pipeline.tables import TABLES

FINITE = pa.Check(np.isfinite, error="must be finite")
WORDS = (HOLDS, FAILS, UNKNOWN)
SCALED = (*FACTORS, "kappa", "tension_std")
CONDITION = {  # what a condition is, as text, count or factor
    "study": pa.Column("str", pa.Check.isin(("motion", "wrench")), description="whose claims are decided"),
    "trajectory": pa.Column("str", description="name of the trajectory; empty for the wrench"),
    "particles": pa.Column("int64", pa.Check.ge(0), description="particles of the filter; 0 for the wrench"),
    "agents": pa.Column("str", description="numbers of cables that are compared; empty for the motion"),
} | {
    name: pa.Column("float64", [FINITE, pa.Check.ge(0)], nullable=True, description=f"factor on {name}; missing for the other study")
    for name in SCALED
}
MEASURED = {
    "value": "what the rule looks at, in the claim's unit; missing where there is no evidence or it is not finite",
    "than": "what it is compared with, likewise",
    "low": "lower end of the value's 95 % interval, where there is one",
    "high": "upper end",
}
SURVEY = {
    "point": pa.Column("str", description="hash of all that decides the condition"),
    "seed": pa.Column("int64", pa.Check.ge(0), description="seed of all random numbers of the condition"),
    **CONDITION,
    "claim": pa.Column("str", description="id of the claim in reports/claims.yaml, or of the conclusion"),
    "about": pa.Column("str", pa.Check.isin(ABOUT), description="whose behaviour the claim is about"),
    "case": pa.Column("str", description="case of the claim"),
    **{name: pa.Column("float64", FINITE, nullable=True, description=text) for name, text in MEASURED.items()},
    "holds": pa.Column("str", pa.Check.isin(WORDS), description="whether the claim's rule holds in the case"),
    "verdict": pa.Column("str", pa.Check.isin(WORDS), description="whether it holds in every case on which there is evidence"),
    "cpu_seconds": pa.Column("float64", [FINITE, pa.Check.ge(0)], description="processor time that the whole condition took, s"),
}
TABLES["survey"] = SURVEY
GROUP = 100_000  # rows of a group of the file at least: what is in memory at once


def write(tables: Iterable[pd.DataFrame], folder: Path) -> None:
    """Write ``tables``, each of which keeps the contract, as one, group by group; equal tables give equal bytes."""
    groups = _groups(tables)
    first = pyarrow.Table.from_pandas(next(groups), preserve_index=False)
    with closing(ParquetWriter(folder / "survey.parquet", first.schema, compression="zstd")) as file:
        file.write_table(first)
        for group in groups:
            file.write_table(pyarrow.Table.from_pandas(group, schema=first.schema, preserve_index=False))


def _groups(tables: Iterable[pd.DataFrame]) -> Iterator[pd.DataFrame]:
    """``tables`` joined, as many at a time as make up a group."""
    waiting, rows = [], 0
    for table in tables:
        waiting.append(table)
        rows += len(table)
        if rows >= GROUP:
            yield pd.concat(waiting, ignore_index=True)
            waiting, rows = [], 0
    if waiting:
        yield pd.concat(waiting, ignore_index=True)
