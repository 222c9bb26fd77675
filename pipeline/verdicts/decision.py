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
    INTERVAL,
    NONE,
    ORDERS,
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

# verdicts under a reading, a decision or a condition of the laboratory
HOLDS = "holds"
FAILS = "fails"
UNKNOWN = "no evidence"
SPEED_LAW = "holds, as does the speed law"

REPRODUCED = HOLDS
NOT_REPRODUCED = FAILS
NO_EVIDENCE = UNKNOWN
# the claim holds for a law without a Jacobian too: no evidence for the matrix models
WITH_SPEED_LAW = "holds, and so does a law of the speed alone"
SYNTHETIC_PASSES = "holds in synthetic recordings"
SYNTHETIC_FAILS = "fails in synthetic recordings"
SYNTHETIC_WITH_SPEED_LAW = (
    "holds in synthetic recordings, and so does a law of the speed alone"
)
FORCED = "forced by construction"
NO_RECORDING = "decided without a recording"
# heading of the column of claims that need no recording
WITHOUT_RECORDING = "no recording"

READ = {REPRODUCED: HOLDS, NOT_REPRODUCED: FAILS, WITH_SPEED_LAW: SPEED_LAW}
COLUMNS = ["claim", "about", "case", "value", "than", "low", "high", "holds", "verdict"]

# share of the greatest commanded range below which a joint is at rest
LEAST_RANGE = 0.01

Recordings = Literal["none", "synthetic", "real", "paper"]

NUMBERS = (*COMPARED, "published", "distance", "speed_law")  # fields of a case


class Case(namedtuple("Case", ["case", *NUMBERS, "holds", "speed_law_holds"])):
    """Numbers of one case of a claim in a run, None where missing or infinite; ``distance`` is
    (published − value) in standard errors, ``holds`` is None if the rule does not decide the case.
    ``speed_law`` and ``speed_law_holds`` are the value and the result of the same rule for the
    speed law, None for a claim without this control.
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


def decide_each(
    claims: Sequence[Claim],
    runs: Sequence[Run],
    papers_own: Sequence[str],
) -> list[Decided]:
    """Return the verdicts of every run, then the verdicts that need no recording."""
    decided = []
    for run in runs:
        recordings = kind_of_recordings(run, papers_own)
        verdicts = decide(claims, run.evidence, recordings, run.arm)
        decided.append(Decided(run.dataset, recordings, verdicts))
    independent = verdicts_without_recording(claims, runs)
    return [*decided, Decided(WITHOUT_RECORDING, "none", independent)]


def kind_of_recordings(run: Run, papers_own: Sequence[str]) -> Recordings:
    """Return whether the recordings of ``run`` are the paper's, synthetic or of another robot."""
    if run.dataset in papers_own:
        return "paper"
    return "synthetic" if run.synthetic else "real"


def verdicts_without_recording(
    claims: Sequence[Claim],
    runs: Sequence[Run],
) -> list[Verdict]:
    """Return for each claim the verdict of the first of ``runs`` that has its numbers."""
    by_run = [decide(claims, run.evidence, "none", run.arm) for run in runs]
    chosen = []
    for verdicts in zip(*by_run, strict=True):  # on one claim, in all runs
        evident = [verdict for verdict in verdicts if verdict.verdict != NO_EVIDENCE]
        chosen.append(evident[0] if evident else verdicts[0])
    return chosen


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
    rows = evidence[evidence["quantity"] == "commanded_range"]
    ranges = rows.set_index("joint")["value"]
    still = ranges.index[ranges < LEAST_RANGE * ranges.max()]
    return tuple(joint for joint in joints if joint not in still)


def _decide_claim(
    claim: Claim,
    evidence: IndexedEvidence,
    recordings: Recordings,
    arm: ArmNames,
) -> Verdict:
    cases = claim.cases(arm)
    if claim.numbers_joints and not arm.numbered:
        evidence = {}
    names = [case | arm.numbered for case in cases]
    r, complete = _numbers(claim, names, evidence)
    if claim.unless is not None:
        share = claim.unless.value.look_up(evidence, arm.numbered)
        # a guard without a number is no evidence
        complete &= share is not None and share <= claim.unless.limit
    holds = _hold(claim, r, complete)
    speed_law = np.full(len(cases), np.nan)
    speed_law_holds: list[bool | None] = [None] * len(cases)
    if claim.control_model:
        control, of_control = _numbers(claim.of_control, names, evidence)
        speed_law = control.value
        speed_law_holds = _hold(claim, control, complete & of_control)
    named = _with_interval(claim, r)._asdict() | {"speed_law": speed_law}
    decided = []
    for place, case in enumerate(cases):
        texts = {"case": _case_name(case), "holds": holds[place]}
        texts |= {"speed_law_holds": speed_law_holds[place]}
        numbers = {key: _finite(named[key][place]) for key in NUMBERS}
        decided.append(Case(**texts, **numbers))
    evident = len(complete) > 0 and complete.all()
    word = _verdict_word(claim, recordings, evident, holds)
    if True in speed_law_holds and False not in speed_law_holds:
        word = SHARED_WITH_SPEED_LAW.get(word, word)
    return Verdict(claim, word, tuple(decided))


# verdict on a claim → the verdict if the control, the speed law, passes in all cases that its rule
# decides, so that no case tells the claim's model from it
SHARED_WITH_SPEED_LAW = {
    REPRODUCED: WITH_SPEED_LAW,
    SYNTHETIC_PASSES: SYNTHETIC_WITH_SPEED_LAW,
}


def _hold(claim: Claim, r: Cases, complete: np.ndarray) -> list[bool | None]:
    """Return whether each case holds by the claim's rule, None if it is not decided."""
    if not complete.any():
        return [None] * len(complete)
    return decide_cases(RULES[claim.rule], r, complete)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _case_name(case: dict) -> str:
    """Return the values of a case; a value that is no text has its name before it."""
    texts = []
    for name, value in case.items():
        texts.append(value if isinstance(value, str) else f"{name} {value}")
    return ", ".join(texts)


def _with_interval(claim: Claim, r: Cases) -> Cases:
    """Return ``r`` with the interval by the standard error where it has no interval."""
    # the interval of the rule ``standard_errors`` is the rule's own
    quantile = claim.limit if claim.rule == "standard_errors" else NORMAL_QUANTILE
    half = quantile * r.standard_error
    low = r.value - half
    high = r.value + half
    return r._replace(
        low=np.where(np.isnan(r.low), low, r.low),
        high=np.where(np.isnan(r.high), high, r.high),
    )


def _verdict_word(
    claim: Claim,
    recordings: Recordings,
    evident: bool,
    holds: Sequence[bool | None],
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


def _numbers(
    claim: Claim,
    cases: list[dict],
    evidence: IndexedEvidence,
) -> tuple[Cases, np.ndarray]:
    """Return the numbers of the ``cases`` for the rule of ``claim``, and the mask of the cases that
    have all numbers that the rule needs.
    """

    def looked_up(reference: Reference | None) -> np.ndarray:
        if reference is None:
            return np.full(len(cases), np.nan)
        values = [reference.look_up(evidence, case) for case in cases]
        return np.array(values, dtype=float)

    references = {key: getattr(claim, key, None) for key in COMPARED}
    ends = claim.difference or claim.value
    if ends.column == "value":  # an end of an interval has no interval
        references |= {end: replace(ends, column=end) for end in INTERVAL}
    columns = {key: looked_up(reference) for key, reference in references.items()}
    if claim.standard_error:
        errors = [looked_up(reference) for reference in claim.standard_error]
        columns["standard_error"] = np.sqrt(np.sum(np.square(errors), axis=0))
        columns["degrees"] = np.full(len(cases), np.nan)
    for key in ("published", "tolerance", "limit", "margin"):
        stated = np.array(getattr(claim, key), dtype=float)
        columns[key] = np.broadcast_to(stated, len(cases))
    r = Cases(**columns)
    if claim.difference is None and claim.rule in ORDERS:
        r = r._replace(difference=r.value - r.than)
    if claim.rule == "equivalent":
        r = r._replace(difference=r.value)
    yardstick = np.where(np.isnan(r.published), r.limit, r.published)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (r.published - r.value) / r.standard_error
    needs = {"value"} | (RULES[claim.rule].needs & {*COMPARED, "standard_error"})
    complete = ~np.isnan([getattr(r, key) for key in needs]).any(axis=0)
    if claim.rule == "decreasing":  # it compares the cases with each other
        complete &= complete.all()
    return r._replace(yardstick=yardstick, distance=distance), complete


def case_text(case: Case) -> str:
    """Return a case's name, value, interval and value or limit compared with, the speed law's value
    and the powers that the rule lacks; ✗ if it fails.
    """
    if case.value is None:
        return f"{case.case} –".strip()
    text = f"{case.case}: {number(case.value)}" if case.case else number(case.value)
    has_interval = case.low is not None and case.high is not None
    ends = interval(case.low, case.high) if has_interval else ""
    if case.difference is not None and case.threshold is not None:
        text += f" (ln of fast over slow {number(case.difference)} {ends})"
    elif case.difference is not None and case.than is not None:
        text += f" against {number(case.than)}"
        text += f" (difference {ends})" if ends else ""
    elif ends:
        text += f" ({ends})"
    if case.threshold is not None:
        text += f" (limit {number(case.threshold)})"
    if case.speed_law is not None:
        text += f", speed law {number(case.speed_law)}"
    if case.power is not None and case.holds is None:
        text += f", power {number(case.power)}"
    return f"{text} ✗" if case.holds is False else text


def verdict_table(decided: Sequence[Decided]) -> pd.DataFrame:
    """Return a row for each case of a claim in each dataset; one row for a claim without cases."""
    rows = []
    columns = [column.verdicts for column in decided]
    for of_claim in zip(*columns, strict=True):
        for column, (claim, verdict, cases) in zip(decided, of_claim, strict=True):
            if verdict == NO_RECORDING:
                continue
            place = {"claim": claim.id, "dataset": column.dataset, "verdict": verdict}
            rows += [place | case._asdict() for case in cases] or [place]
    return pd.DataFrame(rows, columns=["claim", "dataset", "verdict", *Case._fields])


def claim_verdicts(
    claims: Sequence[Claim],
    evidence: pd.DataFrame,
    arm: ArmNames,
) -> pd.DataFrame:
    """Tabulate every case of ``claims``: values that the rule compares, ``holds`` of the case, and
    the ``verdict`` on the claim by :func:`decide`. A claim that the construction forces has none.
    """
    rows = []
    words = {None: UNKNOWN, True: HOLDS, False: FAILS}
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
    table = run.tables["readings"]
    unchanged = run.evidence[~depends_on(run.evidence, "wishart")]
    decided = {}
    for name in refused.index:
        evidence = run.evidence
        if decided:
            rows = table.loc[table["reading"] == name, [*unchanged]]
            evidence = pd.concat([unchanged, rows], ignore_index=True)
        decided[name] = decide(claims, evidence, "paper", run.arm)

    rows = []
    for verdicts in zip(*decided.values(), strict=True):
        words = [READ.get(verdict.verdict, UNKNOWN) for verdict in verdicts]
        if {*words} == {UNKNOWN}:
            continue
        for name, verdict, holds in zip(decided, verdicts, words, strict=True):
            cases = [case for case in verdict.cases if case.holds is not None]
            value = "; ".join(map(case_text, cases))
            reason = refused[name] if holds == UNKNOWN else ""
            rows.append((verdict.claim.id, name, holds, value, reason))
    return pd.DataFrame(rows, columns=["claim", "reading", "holds", "value", "refused"])
