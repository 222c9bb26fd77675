"""The readings of "LU or QR" (Eq. LUDecom): a case under each decomposition of the Wishart model,
and what the claims' rules say of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from pipeline.arm.chain import TASK
from pipeline.cases.case import Case
from pipeline.cases.evidence import Evidence
from pipeline.cases.verdict import FAILS, HOLDS, UNKNOWN
from pipeline.models.wishart.decomposition import COMPUTED, chosen
from pipeline.verdicts.claims import Claim
from pipeline.verdicts.decision import decide
from pipeline.verdicts.reference import ArmNames
from pipeline.verdicts.wording import case_text

NAMES = {"pivoted_lu": "pivoted LU", "qr": "QR of J", "qr_transposed": "QR of Jᵀ (control)"}


def readings(
    base: Case, task: Sequence[str] = TASK, joints: Sequence[str] = TASK
) -> dict[str, Case]:
    """The case ``base`` of a ``task`` of these rows and these ``joints``, and after it the same
    with every other computed decomposition, by name; none where it has no Wishart model.
    """
    wishart = base.models.get("wishart")
    if wishart is None:
        return {}
    own = chosen(wishart, task, joints).name
    cases = {NAMES.get(own, own): base}
    for name in COMPUTED:
        cases.setdefault(NAMES[name], base.with_wishart(decomposition=name, left=None))
    return cases


def readings_table(
    claims: Sequence[Claim],
    evidence: Mapping[str, tuple[Evidence, Sequence[str]]],
    arm: ArmNames,
) -> pd.DataFrame:
    """The table ``readings``: a row for each reading and each of the ``claims`` on which there is
    evidence under any.

    A claim holds under a reading where its rule does in every case that any reading has evidence
    on; where one lacks a case and no other fails, nothing is said.

    Args:
        claims: of the paper.
        evidence: by reading, the run's own first, with what was refused.
        arm: of the recordings.
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
            value = "; ".join(map(case_text, known))
            rows.append((claim.id, name, holds, value, refused))
    return pd.DataFrame(rows, columns=["claim", "reading", "holds", "value", "refused"])
