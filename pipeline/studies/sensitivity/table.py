"""The verdicts on the claims in the base case against those where one decision is taken
otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from pipeline.cases.verdict import UNKNOWN


def sensitivity_table(decided: Mapping[tuple[str, str], pd.DataFrame]) -> pd.DataFrame:
    """The table ``sensitivity`` from what :func:`pipeline.cases.verdict.decided` gives, by
    (setting, variation), the base case first.

    ``changed`` says whether ``holds`` is not what it is in the base case. Claims without evidence
    in any variation are left out.
    """
    table = pd.concat(decided, names=["setting", "variation"]).reset_index(["setting", "variation"])
    table = table.drop(columns=["low", "high"])
    known = table.groupby("claim")["verdict"].transform(lambda words: (words != UNKNOWN).any())
    table = table[known.astype(bool)].reset_index(drop=True)
    first = table[["setting", "variation"]].iloc[:1]
    base = table.merge(first)[["claim", "case", "holds"]]
    before = table[["claim", "case"]].merge(base, on=["claim", "case"], how="left")["holds"]
    return table.assign(changed=(table["holds"] != before).to_numpy())
