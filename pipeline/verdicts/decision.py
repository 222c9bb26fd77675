"""Verdicts on claims from the claims and the numbers of a run."""

from collections import namedtuple
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from pipeline.statistics.takes import NORMAL_QUANTILE
from pipeline.verdicts.claims import COMPARED, CONSTRUCTION, ENDS, NONE, ORDERS, PAPER, Claim
from pipeline.verdicts.rules import RULES, decide_cases
from pipeline.verdicts.run import ArmNames, IndexedEvidence, Reference, Run, index_evidence
from pipeline.verdicts.wording import interval, number

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
SYNTHETIC_PASSES = "synthetic: rule passes"
SYNTHETIC_FAILS = "synthetic: rule fails"
NO_EVIDENCE = "no evidence in this dataset"
FORCED = "forced by construction"
NO_RECORDING = "decided without a recording"
WITHOUT_RECORDING = "no recording"  # heading of the column of claims that need no recording

LEAST_RANGE = 0.01  # share of the greatest commanded range below which a joint is at rest

Recordings = Literal["none", "synthetic", "real", "paper"]


class Case(namedtuple("Case", ["case", *COMPARED, "published", "distance", "holds"])):
    """Numbers of one case of a claim in a run, None where missing or infinite; ``distance`` is
    (published − value) in standard errors, ``holds`` is None if the rule does not decide the case.
    """


class Verdict(NamedTuple):
    """Verdict on a claim in a run, with the claim's cases."""

    claim: Claim
    verdict: str
    cases: tuple[Case, ...]


class Decided(NamedTuple):
    """Verdicts of one dataset; ``recordings`` "none" has the claims that need no recording."""

    dataset: str
    recordings: Recordings
    verdicts: Sequence[Verdict]

    @property
    def words(self) -> list[str]:
        """Verdicts on the paper's claims."""
        return [each.verdict for each in self.verdicts if each.claim.source == PAPER]

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of the paper's claims that hold and that fail."""
        return self.words.count(REPRODUCED), self.words.count(NOT_REPRODUCED)


def decide_each(
    claims: Sequence[Claim], runs: Sequence[Run], papers_own: Sequence[str]
) -> list[Decided]:
    """Return the verdicts of every run, then the verdicts that need no recording."""
    columns = []
    for run in runs:
        whose = "synthetic" if run.synthetic else "real"
        columns.append((run.dataset, "paper" if run.dataset in papers_own else whose, run))
    decided = [Decided(n, w, decide(claims, run.evidence, w, run.arm)) for n, w, run in columns]
    # of the first run that has the numbers
    without = zip(*(decide(claims, run.evidence, "none", run.arm) for run in runs), strict=True)
    chosen = [next((v for v in own if v.verdict != NO_EVIDENCE), own[0]) for own in without]
    return [*decided, Decided(WITHOUT_RECORDING, "none", chosen)]


def decide(
    claims: Sequence[Claim], evidence: pd.DataFrame, recordings: Recordings, arm: ArmNames
) -> list[Verdict]:
    """Return a verdict on every claim from the table ``evidence`` of a run on ``recordings`` of
    ``arm``. A claim on numbered joints has no evidence on an arm without numbered joints.
    """
    rows = index_evidence(evidence)
    arm = arm._replace(joints=moving_joints(evidence, arm.joints))
    return [_decide_claim(claim, rows, recordings, arm) for claim in claims]


def moving_joints(evidence: pd.DataFrame, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the ``joints`` that the commanded motion moves, by LEAST_RANGE of the greatest range;
    all joints without evidence on the ranges.
    """
    ranges = evidence[evidence["quantity"] == "commanded_range"].set_index("joint")["value"]
    still = ranges.index[ranges < LEAST_RANGE * ranges.max()] if len(ranges) else ()
    return tuple(joint for joint in joints if joint not in still)


def _decide_claim(
    claim: Claim, evidence: IndexedEvidence, recordings: Recordings, arm: ArmNames
) -> Verdict:
    if claim.numbers_joints and not arm.numbered:
        evidence = {}
    rule, named = RULES[claim.rule], claim.cases(arm.joints)
    r = _rule_table(claim, named, evidence, arm)
    keys = sorted({"value"} | (rule.needs & {*COMPARED, "standard_error"}))
    there = r[keys].notna().all(axis=1)
    # the rule ``decreasing`` compares the cases with each other and needs all cases
    known = there & (there.all() or claim.rule != "decreasing")
    void = False
    if (unless := claim.unless) is not None:
        share = unless.value.look_up(evidence, arm)
        void = share is None or share > unless.limit  # a guard without a number is no evidence
    known = known & (not void)
    holds = decide_cases(rule, r, known) if known.any() else [None] * len(known)
    # the interval of the rule ``standard_errors`` is the rule's own
    quantile = claim.limit if claim.rule == "standard_errors" else NORMAL_QUANTILE
    half = quantile * r.standard_error
    r = r.assign(low=r.low.fillna(r.value - half), high=r.high.fillna(r.value + half))
    plain = [
        [float(x) if np.isfinite(x) else None for x in row]
        for row in r[[*COMPARED, "published", "distance"]].to_numpy(dtype=float)
    ]
    names = [
        ", ".join(arm.named(v) if isinstance(v, str) else f"{k} {v}" for k, v in case.items())
        for case in named
    ]
    rows = zip(names, plain, holds, strict=True)
    cases = tuple(Case(name, *row, held) for name, row, held in rows)
    evident = len(known) > 0 and known.all()
    return Verdict(claim, _verdict_word(claim, recordings, evident, holds), cases)


def _verdict_word(
    claim: Claim, recordings: Recordings, evident: bool, holds: Sequence[bool | None]
) -> str:
    """Return the verdict; one case that fails, corrected over all cases, refutes the claim."""
    if (claim.recording == NONE) != (recordings == "none") and recordings != "paper":
        return NO_RECORDING
    if not evident:
        return NO_EVIDENCE
    if claim.by == CONSTRUCTION:
        return FORCED
    if claim.about == "specimen" and recordings == "real":
        return NO_EVIDENCE
    if False not in holds and None in holds:
        return NO_EVIDENCE
    if claim.about != "method" and recordings == "synthetic":
        return SYNTHETIC_FAILS if False in holds else SYNTHETIC_PASSES
    return NOT_REPRODUCED if False in holds else REPRODUCED


def _rule_table(
    claim: Claim, cases: list[dict], evidence: IndexedEvidence, arm: ArmNames
) -> pd.DataFrame:
    """Return the table of a rule (:mod:`pipeline.verdicts.rules`) with a row for each case."""

    def numbers(reference: Reference | None) -> np.ndarray:
        values = [reference and reference.in_case(case).look_up(evidence, arm) for case in cases]
        return np.array(values, dtype=float)

    errors = [numbers(part) for part in claim.standard_errors or [None]]
    ends = claim.difference or claim.value
    plain = ends.column == "value"  # an end of an interval has no interval
    named = {key: getattr(claim, key, None) for key in COMPARED}
    named |= {end: replace(ends, column=end) if plain else None for end in sorted(ENDS)}
    r = pd.DataFrame({key: numbers(reference) for key, reference in named.items()})
    r["standard_error"] = np.sqrt(np.sum(np.square(errors), axis=0))
    if not claim.standard_errors:
        r["standard_error"] = numbers(replace(ends, column="standard_error") if plain else None)
    if claim.difference is None:  # of other rules, ``than`` is a number of the rule
        r["difference"] = r.value - r.than if claim.rule in ORDERS else np.nan
        r["difference"] = r.value if claim.rule == "equivalent" else r.difference
    for key in ("published", "tolerance", "limit", "margin"):
        r[key] = np.broadcast_to(np.array(getattr(claim, key), dtype=float), len(cases))
    r["yardstick"] = r.published.fillna(r.limit)
    return r.assign(distance=(r.published - r.value) / r.standard_error)


def case_text(case: Case) -> str:
    """Return a case's name, value, interval and value or limit compared with; ✗ if it fails."""
    if case.value is None:
        return f"{case.case} –".strip()
    text = f"{case.case}: {number(case.value)}" if case.case else number(case.value)
    compared = case.difference is not None and case.than is not None
    text += f" against {number(case.than)}" if compared else ""
    if case.low is not None and case.high is not None:
        prefix = "difference " if compared else ""
        text += f" ({prefix}{interval(case.low, case.high)})"
    if case.threshold is not None:
        text += f" (limit {number(case.threshold)})"
    if case.power is not None and case.holds is None:
        return f"{text}, power {number(case.power)}"
    return f"{text} ✗" if case.holds is False else text


def verdict_table(decided: Sequence[Decided]) -> pd.DataFrame:
    """Return a row for each case of a claim in each dataset; one row for a claim without cases."""
    rows = []
    for row in zip(*(whose.verdicts for whose in decided), strict=True):
        for whose, (claim, verdict, cases) in zip(decided, row, strict=True):
            place = {"claim": claim.id, "dataset": whose.dataset, "verdict": verdict}
            if verdict != NO_RECORDING:
                rows += [place | case._asdict() for case in cases] or [place]
    return pd.DataFrame(rows, columns=["claim", "dataset", "verdict", *Case._fields])
