"""What the claims' rules say of the evidence of a case, whatever recordings it is of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.cases.evidence import Evidence
from pipeline.core.typed_yaml import read_yaml
from pipeline.verdicts.claims import Claim, parse_claims
from pipeline.verdicts.decision import decide, verdict_table
from pipeline.verdicts.reference import ArmNames

PAPER = Path("reports/claims.yaml")
HOLDS, FAILS, UNKNOWN = WORDS = ("holds", "fails", "no evidence")
COLUMNS = ["claim", "about", "case", "value", "than", "low", "high", "holds", "verdict"]


def read_claims(*conclusions: Path) -> tuple[Claim, ...]:
    """The paper's claims, and after them those of the files ``conclusions``."""
    return tuple(
        claim
        for file in (PAPER, *conclusions)
        for claim in parse_claims(read_yaml(file).get("claims"))
    )


def decided(claims: Sequence[Claim], evidence: Evidence, arm: ArmNames) -> pd.DataFrame:
    """A row for every case of ``claims``: the values that its rule compares, whether the rule
    ``holds``, and the ``verdict``: whether it does in every case on which there is evidence.

    ``arm`` is that of the recordings.
    """
    rows = verdict_table(decide(claims, evidence, "paper", arm)).rename(columns={"id": "claim"})
    rows["holds"] = rows["holds"].map({True: HOLDS, False: FAILS}).fillna(UNKNOWN)
    order = {FAILS: 0, HOLDS: 1, UNKNOWN: 2}
    worst = rows["holds"].map(order).groupby(rows["claim"]).transform("min")
    rows["verdict"] = worst.map({place: word for word, place in order.items()})
    rows["about"] = rows["claim"].map({claim.id: claim.about for claim in claims})
    return rows[COLUMNS].astype(dict.fromkeys(["value", "than", "low", "high"], float))
