"""Which verdicts change under another reading of "LU or QR" (Eq. LUDecom): on the report's page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pandas as pd

from pipeline.verdicts.decision import NOT_REPRODUCED, REPRODUCED, Decided
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import table

TABLE = "readings"
HOLDS, FAILS, UNKNOWN = "holds", "fails", "no evidence"
SIGNS = {HOLDS: "✓", FAILS: "✗", UNKNOWN: "–"}
RULED = {REPRODUCED: HOLDS, NOT_REPRODUCED: FAILS}
DEFAULT = (
    "The Wishart model decomposes the Jacobian by LU without pivoting here, which the paper's "
    "numbers allow ([which-lu](errata.md#which-lu))."
)
AGAIN = "Decided again under the other decompositions, on the same takes with equal random numbers"


def readings_part(runs: Sequence[Run], decided: Sequence[Decided]) -> str:
    """A row for each claim and each of the ``runs`` that decides it whose verdict changes under
    another reading, the run's own in bold, and what else a reader has to know of them. The first
    run is that of the report.
    """
    rows, notes = [], []
    if not any(TABLE in run.tables for run in runs):
        return DEFAULT
    for run, whose in zip(runs, decided, strict=True):
        if TABLE in run.tables:
            ruled = _ruled(run)
            turned = _turned(ruled)
            for verdict in whose.verdicts:
                if verdict.verdict in RULED and verdict.claim.id in turned:
                    signs = ruled.loc[verdict.claim.id].map(SIGNS)
                    signs.iloc[0] = f"**{signs.iloc[0]}**"
                    rows.append((verdict.claim.statement, run.dataset, signs))
            notes += _notes(run, ruled, turned, whose)
    header = list(dict.fromkeys(name for _, _, signs in rows for name in signs.index))
    body = [[said, name, *signs.reindex(header, fill_value="")] for said, name, signs in rows]
    changed = table(["what changes (the run's own in bold)", "dataset", *header], body)
    text = f"these come out otherwise:\n\n{changed}" if rows else "no verdict changes."
    link = " ([of this run](tables/readings.csv))" if TABLE in runs[0].tables else ""
    return "\n\n".join(filter(None, [f"{DEFAULT} {AGAIN}{link}, {text}", "\n".join(notes)]))


def _ruled(run: Run) -> pd.DataFrame:
    """Whether the rules hold, by claim and reading, the run's own first."""
    rows = run.tables[TABLE]
    by_reading = rows.pivot(index="claim", columns="reading", values="holds")
    return by_reading[rows["reading"].unique()]


def _turned(ruled: pd.DataFrame) -> set[str]:
    """The claims that another reading than the run's own turns."""
    own, others = ruled.iloc[:, 0], ruled.iloc[:, 1:]
    otherwise = others.ne(own, axis=0) & others.ne(UNKNOWN)
    return set(ruled.index[otherwise.any(axis=1) & (own != UNKNOWN)])


def _notes(run: Run, ruled: pd.DataFrame, turned: set[str], whose: Decided) -> Iterator[str]:
    """What comes out otherwise where nothing is decided, or by chance, and what has no evidence."""
    decides = {each.claim.id: RULED.get(each.verdict) for each in whose.verdicts}
    open_ones = [claim for claim in ruled.index if claim in turned and not decides.get(claim)]
    if open_ones:
        yield f"- On {run.dataset}, which does not decide them, also {', '.join(open_ones)}."
    own = ruled[ruled.columns[0]]
    chance = [
        claim
        for claim, holds in own.items()
        if holds != UNKNOWN and decides.get(claim) not in (None, holds)
    ]
    if chance:
        yield (
            f"- On {run.dataset} these random numbers alone decide otherwise than above: "
            f"{', '.join(chance)}."
        )
    rows = run.tables[TABLE]
    for reading, missing in rows[rows["holds"] == UNKNOWN].groupby("reading", sort=False):
        reason = missing["refused"].iloc[0].partition(" [")[0].partition(";")[0]
        count = f"claims without evidence under {reading}: {len(missing)}"
        yield f"- On {run.dataset}, {count} ({reason})."
