"""What changes among the claims when one decision that the paper leaves open is taken otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd


@dataclass(frozen=True)
class Change:
    """Cases of a claim whose test held or not ``before``, in the base case, and does or does not ``after``."""

    claim: str
    cases: str
    before: str
    after: str


@dataclass(frozen=True)
class Changes:
    """Decision, variation and what it changes; the variations that change nothing, by decision; how many claims were tested."""

    rows: list[tuple[str, str, list[Change]]]
    unchanged: dict[str, list[str]]
    claims: int


def changes(table: pd.DataFrame) -> Changes:
    """From the rows that the sensitivity study wrote, the base case without a name first."""
    texts = {name: table[name].astype(object).where(table[name].notna(), "").astype(str) for name in ("setting", "variation", "case")}
    named = table.assign(**texts)
    base = named.loc[named["setting"] == "", ["claim", "case", "holds"]].rename(columns={"holds": "before"})
    varied = named[named["setting"] != ""].merge(base, on=["claim", "case"], how="left")
    rows, unchanged = [], {}
    for (setting, variation), of in varied.groupby(["setting", "variation"], sort=False):
        changed = of[of["changed"]]
        if changed.empty:
            unchanged.setdefault(setting, []).append(variation)
            continue
        groups = changed.groupby(["claim", "before", "holds"], sort=False)["case"]
        told = [Change(claim, "; ".join(filter(None, cases)), before, after) for (claim, before, after), cases in groups]
        rows.append((setting, variation, told))
    return Changes(rows, unchanged, named["claim"].nunique())
