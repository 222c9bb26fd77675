"""The page of the study: how the faults ended, what stays unseen, and what a repair costs."""

from __future__ import annotations

import pandas as pd

from pipeline.studies import page
from pipeline.studies.faults.fault import REFUSED, UNNOTICED
from pipeline.verdicts.wording import table

ASKED = """A recording of real instruments has faults: rows are lost, labels exchanged, frames
damaged, clocks drift. Each kind of fault is inflicted on valid synthetic recordings, at three
severities, and the paper's stages then read them. A fault should be repaired and counted, or
refused with its place; one that changes results in silence is a danger. The faults, and what is
owed to each, stand in `pipeline/studies/faults/faults.yaml`."""


def sections(faults: pd.DataFrame) -> list[str]:
    """The page's sections from the table ``faults``."""
    link = page.write_csv(faults, "faults", "faults")
    return [
        ASKED,
        "## Answer",
        _answer(faults),
        page.figure("faults", "faults"),
        "## How each fault ends",
        f"From mild to grave; all columns are in {link}. The last column is the greatest error of "
        "what was still read, over that of the recording without the fault (of forces: the change "
        "of their moments).",
        _table(faults),
    ]


def _answer(faults: pd.DataFrame) -> str:
    kinds, wrong = faults["fault"].nunique(), faults[~faults["as_expected"]]
    text = [
        f"{kinds} kinds of faults were inflicted, {len(faults)} with their severities. "
        f"{_share(faults, REFUSED)} are refused in every trial, and "
        f"{'every one ends' if wrong.empty else f'all but {len(wrong)} end'} as is owed to it."
    ]
    if len(wrong):
        names = page.listed(list(wrong["fault"].unique()))
        text.append(f"Not as it should be: {names}.")
    silent = faults[faults["outcome"].str.contains(UNNOTICED)]["fault"].unique()
    if len(silent):
        text.append(f"Nothing in the recordings shows, at one severity at least: {_named(silent)}.")
    ratio = _costs(faults[faults["error_unit"] == "rad"]).dropna()
    if len(ratio):
        worst = faults.loc[ratio.idxmax()]
        text.append(
            f"Of the joint angles that are read in spite of a fault, half have at most "
            f"{ratio.median():.2f} times the error of the clean recording; the worst is "
            f"“{worst['fault']}” at {worst['severity']:g} {worst['severity_unit']}: "
            f"{ratio.max():.2f} times."
        )
    return " ".join(text)


def _share(faults: pd.DataFrame, outcome: str) -> str:
    return f"{(faults['outcome'] == outcome).sum()} of {len(faults)}"


def _named(faults: list[str]) -> str:
    return page.listed([f"“{fault}”" for fault in faults])


def _costs(rows: pd.DataFrame) -> pd.Series:
    return rows["error"] / rows["clean_error"]


def _table(faults: pd.DataFrame) -> str:
    rows = []
    for name, levels in faults.groupby("fault", sort=False):
        force = levels["error_unit"].iloc[0] == "N"
        cost = levels["error"].max() if force else _costs(levels).max()
        shown = page.number(cost) + (" N" if force and pd.notna(cost) else "")
        severities = ", ".join(f"{severity:g}" for severity in levels["severity"])
        outcomes = list(dict.fromkeys(levels["outcome"]))
        ends = outcomes[0] if len(outcomes) == 1 else " → ".join(levels["outcome"])
        rows.append([name, f"{severities} {levels['severity_unit'].iloc[0]}", ends, shown])
    return table(["fault", "severity", "ends", "error"], rows)
