"""Verdicts on claims from the claims and the numbers of a run."""

from collections import namedtuple
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from pipeline.evidence.table import depends_on
from pipeline.statistics.takes import NORMAL_QUANTILE
from pipeline.verdicts.claims import (
    COMPARED,
    CONSTRUCTION,
    ENDS,
    NONE,
    ORDERS,
    PAPER,
    Claim,
)
from pipeline.verdicts.rules import RULES, Cases, decide_cases
from pipeline.verdicts.run import (
    ArmNames,
    IndexedEvidence,
    Reference,
    Run,
    index_evidence,
)
from pipeline.verdicts.wording import interval, number

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
SYNTHETIC_PASSES = "synthetic: rule passes"
SYNTHETIC_FAILS = "synthetic: rule fails"
NO_EVIDENCE = "no evidence in this dataset"
FORCED = "forced by construction"
NO_RECORDING = "decided without a recording"
WITHOUT_RECORDING = (
    "no recording"  # heading of the column of claims that need no recording
)

HOLDS, FAILS, UNKNOWN = ("holds", "fails", "no evidence")  # verdicts under a reading
READ = {REPRODUCED: HOLDS, NOT_REPRODUCED: FAILS}
COLUMNS = ["claim", "about", "case", "value", "than", "low", "high", "holds", "verdict"]

LEAST_RANGE = (
    0.01  # share of the greatest commanded range below which a joint is at rest
)

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
        columns.append(
            (run.dataset, "paper" if run.dataset in papers_own else whose, run)
        )
    decided = [
        Decided(n, w, decide(claims, run.evidence, w, run.arm)) for n, w, run in columns
    ]
    # of the first run that has the numbers
    without = zip(
        *(decide(claims, run.evidence, "none", run.arm) for run in runs), strict=True
    )
    chosen = [
        next((v for v in own if v.verdict != NO_EVIDENCE), own[0]) for own in without
    ]
    return [*decided, Decided(WITHOUT_RECORDING, "none", chosen)]


def decide(
    claims: Sequence[Claim],
    evidence: pd.DataFrame,
    recordings: Recordings,
    arm: ArmNames,
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
    ranges = evidence[evidence["quantity"] == "commanded_range"].set_index("joint")[
        "value"
    ]
    still = {*ranges.index[ranges < LEAST_RANGE * ranges.max()]}
    return tuple(joint for joint in joints if joint not in still)


def _decide_claim(
    claim: Claim, evidence: IndexedEvidence, recordings: Recordings, arm: ArmNames
) -> Verdict:
    rule, cases, names = RULES[claim.rule], claim.cases(arm), arm.numbered
    if claim.numbers_joints and not names:
        evidence = {}
    r = _numbers(claim, [case | names for case in cases], evidence)
    keys = {"value"} | (rule.needs & {*COMPARED, "standard_error"})
    known = ~np.isnan([getattr(r, key) for key in keys]).any(axis=0)
    # the rule ``decreasing`` compares the cases with each other and needs all cases
    known &= known.all() or claim.rule != "decreasing"
    if (unless := claim.unless) is not None:
        share = unless.value.look_up(evidence, names)
        # a guard without a number is no evidence
        known &= share is not None and share <= unless.limit
    holds = decide_cases(rule, r, known) if known.any() else [None] * len(known)
    # the interval of the rule ``standard_errors`` is the rule's own
    quantile = claim.limit if claim.rule == "standard_errors" else NORMAL_QUANTILE
    ends = [
        r.value - quantile * r.standard_error,
        r.value + quantile * r.standard_error,
    ]
    low, high = (
        np.where(np.isnan(x), y, x) for x, y in zip((r.low, r.high), ends, strict=True)
    )
    r = r._replace(low=low, high=high)
    rows = np.transpose([getattr(r, name) for name in Case._fields[1:-1]])
    decided = tuple(
        Case(
            ", ".join(v if isinstance(v, str) else f"{k} {v}" for k, v in case.items()),
            *(float(x) if np.isfinite(x) else None for x in row),
            held,
        )
        for case, row, held in zip(cases, rows, holds, strict=True)
    )
    evident = len(known) > 0 and known.all()
    return Verdict(claim, _verdict_word(claim, recordings, evident, holds), decided)


def _verdict_word(
    claim: Claim, recordings: Recordings, evident: bool, holds: Sequence[bool | None]
) -> str:
    """Return the verdict; one case that fails, corrected over all cases, refutes the claim."""
    if (claim.recording == NONE) != (recordings == "none") and recordings != "paper":
        return NO_RECORDING
    if evident and claim.by == CONSTRUCTION:
        return FORCED
    foreign = claim.about == "specimen" and recordings == "real"
    if not evident or foreign or (False not in holds and None in holds):
        return NO_EVIDENCE
    if claim.about != "method" and recordings == "synthetic":
        return SYNTHETIC_FAILS if False in holds else SYNTHETIC_PASSES
    return NOT_REPRODUCED if False in holds else REPRODUCED


def _numbers(claim: Claim, cases: list[dict], evidence: IndexedEvidence) -> Cases:
    """Return the numbers of the ``cases`` for the rule of ``claim``."""

    def numbers(reference: Reference | None) -> np.ndarray:
        values = [reference and reference.look_up(evidence, case) for case in cases]
        return np.array(values, dtype=float)

    ends = claim.difference or claim.value
    plain = ends.column == "value"  # an end of an interval has no interval
    parts = {
        n: replace(ends, column=n) if plain else None for n in (*ENDS, "standard_error")
    }
    named = {key: getattr(claim, key, parts.get(key)) for key in COMPARED}
    r = Cases(**{key: numbers(reference) for key, reference in named.items()})
    errors = [
        numbers(part) for part in claim.standard_error or [parts["standard_error"]]
    ]
    error = np.sqrt(np.sum(np.square(errors), axis=0))
    stated = {
        key: np.broadcast_to(np.array(getattr(claim, key), dtype=float), len(cases))
        for key in ("published", "tolerance", "limit", "margin")
    }
    r = r._replace(standard_error=error, **stated)
    if (
        claim.difference is None and claim.rule in ORDERS
    ):  # of other rules, ``than`` is theirs
        r = r._replace(difference=r.value - r.than)
    if claim.rule == "equivalent":
        r = r._replace(difference=r.value)
    yardstick = np.where(np.isnan(r.published), r.limit, r.published)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (r.published - r.value) / r.standard_error
    return r._replace(yardstick=yardstick, distance=distance)


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


def claim_verdicts(
    claims: Sequence[Claim], evidence: pd.DataFrame, arm: ArmNames
) -> pd.DataFrame:
    """Tabulate every case of ``claims``: values that the rule compares, ``holds`` of the case, and
    the ``verdict`` on the claim by :func:`decide`. A claim that the construction forces has none.
    """
    rows, words = [], {None: UNKNOWN, True: HOLDS, False: FAILS}
    for claim, verdict, cases in decide(claims, evidence, "paper", arm):
        place = {
            "claim": claim.id,
            "about": claim.about,
            "verdict": READ.get(verdict, UNKNOWN),
        }
        rows += [
            case._asdict() | place | {"holds": words[case.holds]} for case in cases
        ]
    rows = pd.DataFrame(rows, columns=COLUMNS)
    return rows.astype(dict.fromkeys(["value", "than", "low", "high"], float))


def reading_verdicts(claims: Sequence[Claim], run: Run) -> pd.DataFrame:
    """Return a row for each reading of ``run``, its own first, and each claim with a verdict under
    any reading. Another reading replaces the evidence that depends on the Wishart model.
    """
    refused = run.tables["reading_refusals"].astype(object).fillna("")
    refused = refused.set_index("reading")["refused"]
    table, stays = (
        run.tables["readings"],
        run.evidence[~depends_on(run.evidence, "wishart")],
    )
    decided = {}
    for name in refused.index:
        rows = table.loc[table["reading"] == name, [*stays]]
        evidence = (
            pd.concat([stays, rows], ignore_index=True) if decided else run.evidence
        )
        decided[name] = decide(claims, evidence, "paper", run.arm)
    rows = []
    for verdicts in zip(*decided.values(), strict=True):
        words = [READ.get(each.verdict, UNKNOWN) for each in verdicts]
        for name, each, holds in zip(decided, verdicts, words, strict=True):
            value = "; ".join(
                case_text(case) for case in each.cases if case.holds is not None
            )
            reason = refused[name] if holds == UNKNOWN else ""
            if {*words} != {UNKNOWN}:
                rows.append((each.claim.id, name, holds, value, reason))
    return pd.DataFrame(rows, columns=["claim", "reading", "holds", "value", "refused"])
