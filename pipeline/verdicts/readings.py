"""Verdicts of the claims' rules on the evidence of a case, and under the readings of "LU or QR"."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.core.typed_yaml import read_yaml
from pipeline.evidence.table import depends_on
from pipeline.verdicts.claims import Claim, parse_claims, require_known
from pipeline.verdicts.decision import NOT_REPRODUCED, REPRODUCED, case_text, decide
from pipeline.verdicts.run import ArmNames, Run

CLAIMS = Path("pipeline/verdicts/claims.yaml")
HOLDS, FAILS, UNKNOWN = ("holds", "fails", "no evidence")
VERDICTS = {REPRODUCED: HOLDS, NOT_REPRODUCED: FAILS}
COLUMNS = ["claim", "about", "case", "value", "than", "low", "high", "holds", "verdict"]


def read_claims(*conclusions: Path) -> tuple[Claim, ...]:
    """Return the paper's claims, then the claims of the files ``conclusions``."""
    entries = [read_yaml(file).get("claims") for file in (CLAIMS, *conclusions)]
    return tuple(claim for own in entries for claim in require_known(parse_claims(own)))


def claim_verdicts(claims: Sequence[Claim], evidence: pd.DataFrame, arm: ArmNames) -> pd.DataFrame:
    """Tabulate every case of ``claims``: values that the rule compares, ``holds`` of the case, and
    the ``verdict`` on the claim by :func:`decide`. A claim that the construction forces has none.
    """
    rows, words = [], {None: UNKNOWN, True: HOLDS, False: FAILS}
    for claim, verdict, cases in decide(claims, evidence, "paper", arm):
        place = {"claim": claim.id, "about": claim.about, "verdict": VERDICTS.get(verdict, UNKNOWN)}
        rows += [case._asdict() | place | {"holds": words[case.holds]} for case in cases]
    rows = pd.DataFrame(rows, columns=COLUMNS)
    return rows.astype(dict.fromkeys(["value", "than", "low", "high"], float))


def reading_verdicts(claims: Sequence[Claim], run: Run) -> pd.DataFrame:
    """Return a row for each reading of ``run``, its own first, and each claim with a verdict under
    any reading. Another reading replaces the evidence that depends on the Wishart model.
    """
    refused = run.tables["reading_refusals"].astype(object).fillna("")
    refused = refused.set_index("reading")["refused"]
    table, stays = run.tables["readings"], run.evidence[~depends_on(run.evidence, "wishart")]
    decided = {}
    for name in refused.index:
        rows = table.loc[table["reading"] == name, [*stays]]
        evidence = pd.concat([stays, rows], ignore_index=True) if decided else run.evidence
        decided[name] = decide(claims, evidence, "paper", run.arm)
    rows = []
    for verdicts in zip(*decided.values(), strict=True):
        words = [VERDICTS.get(each.verdict, UNKNOWN) for each in verdicts]
        for name, each, holds in zip(decided, verdicts, words, strict=True):
            value = "; ".join(case_text(case) for case in each.cases if case.holds is not None)
            reason = refused[name] if holds == UNKNOWN else ""
            if {*words} != {UNKNOWN}:
                rows.append((each.claim.id, name, holds, value, reason))
    return pd.DataFrame(rows, columns=["claim", "reading", "holds", "value", "refused"])
