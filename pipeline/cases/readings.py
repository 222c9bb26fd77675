"""Verdicts of the claims' rules on the evidence of a case, and the readings of "LU or QR"
(Eq. LUDecom): one case for each decomposition of the Wishart model.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from pipeline.cases.case import Choices
from pipeline.core.columns import PLANE
from pipeline.core.typed_yaml import read_yaml
from pipeline.models.wishart.decomposition import COMPUTED, decomposition_of
from pipeline.verdicts.claims import Claim, parse_claims
from pipeline.verdicts.decision import case_text, decide
from pipeline.verdicts.run import ArmNames, Evidence

PAPER = Path("pipeline/verdicts/claims.yaml")
HOLDS, FAILS, UNKNOWN = ("holds", "fails", "no evidence")
COLUMNS = ["claim", "about", "case", "value", "than", "low", "high", "holds", "verdict"]
NAMES = {"pivoted_lu": "pivoted LU", "qr": "QR of J", "qr_transposed": "QR of Jᵀ (control)"}


def read_claims(*conclusions: Path) -> tuple[Claim, ...]:
    """Return the paper's claims, then the claims of the files ``conclusions``."""
    files = (PAPER, *conclusions)
    return tuple(claim for file in files for claim in parse_claims(read_yaml(file).get("claims")))


def claim_verdicts(claims: Sequence[Claim], evidence: Evidence, arm: ArmNames) -> pd.DataFrame:
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


def readings(
    base: Choices, task: Sequence[str] = PLANE, joints: Sequence[str] = PLANE
) -> dict[str, Choices]:
    """Return ``base`` and the cases of other decompositions by name; {} without a Wishart model."""
    wishart = base.models.get("wishart")
    if wishart is None:
        return {}
    own = decomposition_of(wishart.decomposition, wishart.left, task, joints).name
    cases = {NAMES.get(own, own): base}
    for name in COMPUTED:
        cases.setdefault(NAMES[name], base.with_wishart(decomposition=name, left=None))
    return cases


def readings_table(
    claims: Sequence[Claim], evidence: Mapping[str, tuple[Evidence, Sequence[str]]], arm: ArmNames
) -> pd.DataFrame:
    """Return the table ``readings``: a row for each reading and each claim that has evidence under
    any reading.

    A claim holds under a reading if its rule holds in every case that has evidence under any
    reading. If one of these cases lacks evidence and no case fails, there is no evidence.
    ``evidence`` is evidence and refusals by reading; the run's reading comes first.
    """
    rows = []
    for claim in claims:
        cases = {
            name: decide([claim], own, "paper", arm)[0].cases for name, (own, _) in evidence.items()
        }
        needed = {c.case for own in cases.values() for c in own if c.holds is not None}
        for name, own in cases.items() if needed else ():
            known = [case for case in own if case.holds is not None]
            holds = HOLDS if len(known) == len(needed) else UNKNOWN
            holds = holds if all(case.holds for case in known) else FAILS
            refused = "; ".join(evidence[name][1]) if holds == UNKNOWN else ""
            rows.append((claim.id, name, holds, "; ".join(map(case_text, known)), refused))
    return pd.DataFrame(rows, columns=["claim", "reading", "holds", "value", "refused"])
