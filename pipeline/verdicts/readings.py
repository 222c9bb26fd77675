"""Verdicts that change under another reading of "LU or QR" (Eq. LUDecom), on the report's page."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import table

TABLE = "readings"
HOLDS, FAILS, UNKNOWN = "holds", "fails", "no evidence"
SIGNS = {HOLDS: "✓", FAILS: "✗", UNKNOWN: "–"}
DEFAULT = (
    'The paper says "LU or QR depending on the redundancy" and computes in MATLAB, whose `lu` '
    "pivots: pivoted LU of a square Jacobian and QR of J of a redundant arm are the default. The "
    "printed numbers do not determine the decomposition "
    "([which-decomposition](errata.md#which-decomposition)). QR of Jᵀ is the control: it depends "
    "on no unit."
)
AGAIN = (
    "The claims' rules under the other decompositions, on the same takes with equal random "
    "numbers, whichever recordings decide them"
)


def readings_part(runs: Sequence[Run]) -> str:
    """A row for each claim and run whose rule comes out otherwise under another reading, the run's
    own reading in bold, and how many claims have no evidence under which.
    """
    rows, notes = [], []
    for run in runs:
        if TABLE not in run.tables:
            continue
        ruled = _ruled(run.tables[TABLE])
        for claim, signs in ruled[_changes(ruled)].iterrows():
            shown = signs.map(SIGNS)
            shown.iloc[0] = f"**{shown.iloc[0]}**"
            rows.append((claim, run.dataset, shown))
        missing = run.tables[TABLE].query("holds == @UNKNOWN and refused.notna() and refused != ''")
        for reading, lacking in missing.groupby("reading", sort=False):
            reason = lacking["refused"].iloc[0].partition(" [")[0].partition(";")[0]
            notes.append(
                f"- {run.dataset}, {reading}: {len(lacking)} claims lack numbers ({reason})."
            )
    if not rows:
        return DEFAULT
    header = list(dict.fromkeys(name for _, _, signs in rows for name in signs.index))
    body = [[claim, name, *signs.reindex(header, fill_value="")] for claim, name, signs in rows]
    changed = table(["claim (the run's own reading in bold)", "dataset", *header], body)
    return "\n\n".join(filter(None, [f"{DEFAULT} {AGAIN}:", changed, "\n".join(notes)]))


def _ruled(rows: pd.DataFrame) -> pd.DataFrame:
    """Outcome of the rules by claim and reading, the run's own first."""
    by_reading = rows.pivot(index="claim", columns="reading", values="holds")
    return by_reading[rows["reading"].unique()]


def _changes(ruled: pd.DataFrame) -> pd.Series:
    """Claims with another outcome under another reading than the run's own."""
    own, others = ruled.iloc[:, 0], ruled.iloc[:, 1:]
    otherwise = others.ne(own, axis=0) & others.ne(UNKNOWN)
    return otherwise.any(axis=1) & (own != UNKNOWN)
