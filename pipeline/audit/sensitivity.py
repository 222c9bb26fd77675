"""The verdicts on the claims in the base case against those where one decision is taken otherwise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.audit.claims import Case, Verdict

HOLDS, FAILS, UNKNOWN = "holds", "fails", "no evidence"
COLUMNS = ["setting", "variation", "claim", "about", "case", "value", "than", "holds", "verdict", "changed"]


def sensitivity_table(verdicts: Mapping[tuple[str, str], Sequence[Verdict]]) -> pd.DataFrame:
    """A row for every variation, claim and case; ``verdicts`` by (setting, variation), the base case first.

    ``holds`` says whether the claim's rule holds in the case, ``verdict`` whether it does in every case there is evidence on, whatever
    recordings that is; ``changed`` whether ``holds`` is not what it is in the base case. Claims without evidence in any variation are left
    out.
    """
    rows = [
        {"setting": setting, "variation": variation, "claim": of.claim.id, "about": of.claim.about, "case": case.case}
        | {"value": case.value, "than": case.than, "holds": _word(case), "verdict": _verdict(of)}
        for (setting, variation), of_variation in verdicts.items()
        for of in of_variation
        for case in of.cases
    ]
    table = pd.DataFrame(rows, columns=COLUMNS[:-1]).astype({"value": float, "than": float})
    known = table.groupby("claim")["verdict"].transform(lambda words: (words != UNKNOWN).any())
    table = table[known.astype(bool)].reset_index(drop=True)
    first = table[["setting", "variation"]].iloc[:1]
    base = table.merge(first)[["claim", "case", "holds"]]
    before = table[["claim", "case"]].merge(base, on=["claim", "case"], how="left")["holds"]
    return table.assign(changed=(table["holds"] != before).to_numpy())[COLUMNS]


def _word(case: Case) -> str:
    return UNKNOWN if case.holds is None else HOLDS if case.holds else FAILS


def _verdict(of: Verdict) -> str:
    words = {_word(case) for case in of.cases}
    return FAILS if FAILS in words else HOLDS if HOLDS in words else UNKNOWN
