"""The verdicts of the claims' rules on the evidence of a case; and the readings of "LU or QR"
(Eq. LUDecom), a case under each decomposition of the Wishart model.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from pipeline.cases.case import Choices
from pipeline.cases.evidence import Evidence
from pipeline.core.columns import PLANE
from pipeline.core.typed_yaml import read_yaml
from pipeline.models.wishart.decomposition import COMPUTED, chosen
from pipeline.verdicts.claims import Claim, parse_claims
from pipeline.verdicts.decision import case_text, decide
from pipeline.verdicts.run import ArmNames

PAPER = Path("reports/claims.yaml")
HOLDS, FAILS, UNKNOWN = ("holds", "fails", "no evidence")
COLUMNS = ["claim", "about", "case", "value", "than", "low", "high", "holds", "verdict"]
NAMES = {"pivoted_lu": "pivoted LU", "qr": "QR of J", "qr_transposed": "QR of Jᵀ (control)"}


def read_claims(*conclusions: Path) -> tuple[Claim, ...]:
    """The paper's claims, then the claims of the files ``conclusions``."""
    return tuple(
        claim
        for file in (PAPER, *conclusions)
        for claim in parse_claims(read_yaml(file).get("claims"))
    )


def decided(claims: Sequence[Claim], evidence: Evidence, arm: ArmNames) -> pd.DataFrame:
    """A row for every case of ``claims``: the values that its rule compares, ``holds`` of the case,
    and the ``verdict`` of the claim, which holds in every case on which there is evidence.
    """
    rows = []
    for claim, _, cases in decide(claims, evidence, "paper", arm):
        words = [
            UNKNOWN if case.holds is None else HOLDS if case.holds else FAILS for case in cases
        ]
        verdict = next((word for word in (FAILS, HOLDS) if word in words), UNKNOWN)
        place = {"claim": claim.id, "about": claim.about, "verdict": verdict}
        rows += [c._asdict() | place | {"holds": w} for c, w in zip(cases, words, strict=True)]
    rows = pd.DataFrame(rows, columns=COLUMNS)
    return rows.astype(dict.fromkeys(["value", "than", "low", "high"], float))


def readings(
    base: Choices, task: Sequence[str] = PLANE, joints: Sequence[str] = PLANE
) -> dict[str, Choices]:
    """The case ``base``, then other decompositions by name; none without a Wishart model."""
    wishart = base.models.get("wishart")
    if wishart is None:
        return {}
    own = chosen(wishart, task, joints).name
    cases = {NAMES.get(own, own): base}
    for name in COMPUTED:
        cases.setdefault(NAMES[name], base.with_wishart(decomposition=name, left=None))
    return cases


def readings_table(
    claims: Sequence[Claim], evidence: Mapping[str, tuple[Evidence, Sequence[str]]], arm: ArmNames
) -> pd.DataFrame:
    """The table ``readings``: a row for each reading and each of the ``claims`` on which there is
    evidence under any.

    A claim holds under a reading where its rule does in every case that any reading has evidence
    on; where one lacks a case and no other fails, there is no evidence. ``evidence`` by reading,
    the run's own first, with its refusals.
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
