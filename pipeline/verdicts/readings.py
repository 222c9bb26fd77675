"""Verdicts of the claims' rules on the evidence of a case, and under the readings of "LU or QR"."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.core.typed_yaml import read_yaml
from pipeline.evidence.table import depends_on
from pipeline.verdicts.claims import Claim, parse_claims, require_known
from pipeline.verdicts.decision import case_text, decide
from pipeline.verdicts.run import ArmNames, Run

CLAIMS = Path("pipeline/verdicts/claims.yaml")
HOLDS, FAILS, UNKNOWN = ("holds", "fails", "no evidence")
COLUMNS = ["claim", "about", "case", "value", "than", "low", "high", "holds", "verdict"]


def read_claims(*conclusions: Path) -> tuple[Claim, ...]:
    """Return the paper's claims, then the claims of the files ``conclusions``."""
    entries = [read_yaml(file).get("claims") for file in (CLAIMS, *conclusions)]
    return tuple(claim for own in entries for claim in require_known(parse_claims(own)))


def claim_verdicts(claims: Sequence[Claim], evidence: pd.DataFrame, arm: ArmNames) -> pd.DataFrame:
    """Tabulate every case of ``claims``: values that the rule compares, ``holds`` of the case, and
    the ``verdict``. A claim holds if its rule holds in every case with evidence.
    """
    rows = []
    words = {None: UNKNOWN, True: HOLDS, False: FAILS}
    for claim, _, cases in decide(claims, evidence, "paper", arm):
        known = {words[case.holds] for case in cases}
        verdict = next((word for word in (FAILS, HOLDS) if word in known), UNKNOWN)
        place = {"claim": claim.id, "about": claim.about, "verdict": verdict}
        rows += [case._asdict() | place | {"holds": words[case.holds]} for case in cases]
    rows = pd.DataFrame(rows, columns=COLUMNS)
    return rows.astype(dict.fromkeys(["value", "than", "low", "high"], float))


def reading_verdicts(claims: Sequence[Claim], run: Run) -> pd.DataFrame:
    """Return a row for each reading of ``run``, its own first, and each claim with evidence under
    any reading. Another reading replaces the evidence that depends on the Wishart model.

    A claim holds under a reading if its rule holds in every case that has evidence under any
    reading. If one of these cases lacks evidence and no case fails, there is no evidence.
    """
    refused = run.tables["reading_refusals"].astype(object).fillna("")
    refused = refused.set_index("reading")["refused"]
    own, *others = refused.index
    evidence, table = {own: run.evidence}, run.tables["readings"]
    stays = run.evidence[~depends_on(run.evidence, "wishart")]
    for name in others:
        rows = table.loc[table["reading"] == name, [*stays]]
        evidence[name] = pd.concat([stays, rows], ignore_index=True)
    decided = {name: decide(claims, each, "paper", run.arm) for name, each in evidence.items()}
    rows = []
    for number, claim in enumerate(claims):
        cases = {name: verdicts[number].cases for name, verdicts in decided.items()}
        needed = {c.case for own in cases.values() for c in own if c.holds is not None}
        for name, own in cases.items() if needed else ():
            known = [case for case in own if case.holds is not None]
            holds = HOLDS if len(known) == len(needed) else UNKNOWN
            holds = holds if all(case.holds for case in known) else FAILS
            reason = refused[name] if holds == UNKNOWN else ""
            rows.append((claim.id, name, holds, "; ".join(map(case_text, known)), reason))
    return pd.DataFrame(rows, columns=["claim", "reading", "holds", "value", "refused"])
