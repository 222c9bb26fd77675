"""The page of the study: how many of the decisions that the paper leaves open a claim hangs on."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from pipeline.studies import page
from pipeline.verdicts.wording import table

CHANCE = "chance"  # the setting under which nothing is decided otherwise
ASKED = """The paper does not state everything that its results were computed with: estimators,
weights, decompositions, clocks, resampling. Each of these decisions is taken otherwise, one at a
time, on the same recordings, and every claim is decided again by its rule. A claim that comes out
otherwise hangs on a decision that no reader of the paper knows."""


def sections(verdicts: pd.DataFrame, statements: Mapping[str, str]) -> list[str]:
    """The page's sections from the table ``sensitivity``; ``statements`` of the claims by id."""
    link = page.write_csv(verdicts, "sensitivity", "sensitivity")
    return [
        ASKED,
        "## Answer",
        _answer(verdicts),
        page.figure("sensitivity", "sensitivity"),
        "## Which decisions change which claim",
        f"Every value that a rule looked at is in {link}.",
        _changes(verdicts, statements),
    ]


def _changed(verdicts: pd.DataFrame) -> pd.DataFrame:
    return verdicts[verdicts["changed"]]


def _answer(verdicts: pd.DataFrame) -> str:
    claims, varied = verdicts["claim"].nunique(), verdicts[verdicts["setting"] != ""]
    decisions = len(varied[["setting", "variation"]].drop_duplicates())
    changed = _changed(verdicts)
    lucky = set(changed.loc[changed["setting"] == CHANCE, "claim"])
    hanging = changed[changed["setting"] != CHANCE]["claim"].nunique()
    text = (
        f"Of {claims} claims on which these recordings have evidence, "
        f"{claims - changed['claim'].nunique()} come out alike under all {decisions} variations, "
        f"and {hanging} hang on a decision that the paper leaves open."
    )
    if lucky:
        text += f" Other random numbers or other takes change {page.listed(sorted(lucky))} too."
    per_setting = changed[changed["setting"] != CHANCE].groupby("setting")["claim"].nunique()
    if len(per_setting):
        most = per_setting.idxmax()
        text += f" The decision that changes most is “{most}”: {per_setting.max()} claims."
    return text


def _changes(verdicts: pd.DataFrame, statements: Mapping[str, str]) -> str:
    base = verdicts[verdicts["setting"] == ""].drop_duplicates("claim")
    base = base.set_index("claim")["verdict"]
    rows = []
    for claim, changes in _changed(verdicts).groupby("claim", sort=False):
        settings = [
            f"{setting} ({', '.join(dict.fromkeys(each['variation']))})"
            for setting, each in changes.groupby("setting", sort=False)
        ]
        rows.append([f"{claim}: {statements[claim]}", base[claim], "; ".join(settings)])
    if not rows:
        return "No decision changes a claim."
    return table(["claim", "base case", "comes out otherwise with"], rows)
