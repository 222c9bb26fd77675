"""Verdicts on claims: a function of the claims and a run's numbers alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
import pandas as pd

from pipeline.statistics.takes import NORMAL_QUANTILE
from pipeline.verdicts.claims import COMPARED, CONSTRUCTION, NONE, Claim
from pipeline.verdicts.reference import ArmNames, Evidence, Reference, joint_names
from pipeline.verdicts.rules import RULES, Readings
from pipeline.verdicts.run import Run

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
SYNTHETIC_CANNOT = "cannot be decided with synthetic data"
NO_EVIDENCE = "no evidence in this dataset"
FORCED = "forced by construction"
NO_RECORDING = "decided without a recording"
COMMAND = "dvc repro score"  # writes all evidence into the dataset's reports
KINDS = (REPRODUCED, NOT_REPRODUCED, SYNTHETIC_CANNOT, NO_EVIDENCE, FORCED)
WITHOUT_RECORDING = "no recording"  # name of the column of claims that need none

Recordings = Literal["none", "synthetic", "real", "paper"]


@dataclass(frozen=True)
class Case:
    """One case of a claim in a run; a value that is missing or not finite is None.

    ``distance`` is the published value minus ours in standard errors; ``holds`` whether the rule
    holds, on whatever recordings, and None where it does not decide.
    """

    case: str
    value: float | None
    than: float | None
    low: float | None
    high: float | None
    threshold: float | None
    power: float | None
    published: float | None
    distance: float | None
    holds: bool | None


@dataclass(frozen=True)
class Verdict:
    """Verdict on a claim in a run."""

    claim: Claim
    verdict: str
    cases: tuple[Case, ...]


@dataclass(frozen=True)
class Decided:
    """Verdicts on all claims from the recordings of one dataset, or, where ``recordings`` is none,
    on the claims that need no recording.
    """

    dataset: str
    recordings: Recordings
    verdicts: Sequence[Verdict]

    @property
    def summary(self) -> str:
        """Number of claims by verdict, in words."""
        count = Counter(verdict.verdict for verdict in self.verdicts)
        return ", ".join(f"{count[kind]} {kind}" for kind in KINDS if count[kind])


def decide_each(
    claims: Sequence[Claim], runs: Sequence[Run], papers_own: Sequence[str]
) -> list[Decided]:
    """Verdicts from every run's numbers, in the order of the ``runs``, and last those on the claims
    that need no recording, from the first run.

    ``papers_own`` names the datasets that are the paper's own recordings.
    """

    def decided(run: Run) -> Decided:
        recordings = "synthetic" if run.synthetic else "real"
        recordings = "paper" if run.dataset in papers_own else recordings
        return Decided(run.dataset, recordings, decide(claims, run.evidence, recordings, run.arm))

    first = runs[0]
    without = decide(claims, first.evidence, "none", first.arm)
    return [*map(decided, runs), Decided(WITHOUT_RECORDING, "none", without)]


def decide(
    claims: Sequence[Claim], evidence: Evidence, recordings: Recordings, arm: ArmNames
) -> list[Verdict]:
    """A verdict on every claim from the numbers of a run on ``recordings``: none, synthetic, of a
    real robot, or the paper's own, of an ``arm``.

    Where joints have no numbers there is no evidence on claims that number them.
    """
    return [_decide(claim, evidence, recordings, arm) for claim in claims]


def _decide(claim: Claim, evidence: Evidence, recordings: Recordings, arm: ArmNames) -> Verdict:
    if claim.numbers_joints and not arm.numbered:
        evidence = {}
    rule, each = RULES[claim.rule], claim.cases(arm.joints)
    readings = _read(claim, each, evidence, arm)
    keys = {"value"} | (rule.needs & {*COMPARED, "standard_error"})
    there = ~np.any(np.isnan([getattr(readings, key) for key in keys]), axis=0)
    # a rule that compares cases with each other says nothing where one is missing
    known = there & (there.all() or claim.rule != "decreasing")
    void = claim.unless is not None and _above(claim, evidence, arm)
    decides, holds = known & rule.decides(readings) & (not void), rule.holds(readings)
    columns = (
        readings.value,
        readings.than,
        *_interval(readings),
        readings.threshold,
        readings.power,
        readings.published,
        readings.distance,
    )
    names = [
        ", ".join(
            joint_names(value, arm) if isinstance(value, str) else f"{name} {value}"
            for name, value in case.items()
        )
        for case in each
    ]
    cases = tuple(
        Case(name, *map(_or_none, row), bool(held) if decided else None)
        for name, held, decided, *row in zip(names, holds, decides, *columns, strict=True)
    )
    return Verdict(claim, _verdict(claim, recordings, void, known, decides, holds), cases)


def _above(claim: Claim, evidence: Evidence, arm: ArmNames) -> bool:
    value = claim.unless.reference.look_up(evidence, arm)
    return value is not None and value > claim.unless.limit


def _verdict(
    claim: Claim,
    recordings: Recordings,
    void: bool,
    known: np.ndarray,
    decides: np.ndarray,
    holds: np.ndarray,
) -> str:
    if (claim.recording == NONE) != (recordings == "none") and recordings != "paper":
        return NO_RECORDING
    # on an arm without joints nothing holds, though no case fails
    if void or not len(known) or not known.all():
        return NO_EVIDENCE
    if claim.by == CONSTRUCTION:
        return FORCED
    if claim.about == "specimen" and recordings == "real":
        return NO_EVIDENCE
    if claim.about != "method" and recordings == "synthetic":
        return SYNTHETIC_CANNOT
    if np.any(decides & ~holds):
        return NOT_REPRODUCED  # one case refutes a claim on all
    return REPRODUCED if decides.all() else NO_EVIDENCE


def _read(claim: Claim, each: list[dict], evidence: Evidence, arm: ArmNames) -> Readings:
    def numbers(reference: Reference | None) -> np.ndarray:
        values = [
            None if reference is None else reference.in_case(case).look_up(evidence, arm)
            for case in each
        ]
        return np.array(values, dtype=float)

    errors = [numbers(part) for part in claim.standard_errors or [None]]
    published = np.broadcast_to(np.array(claim.published, dtype=float), len(each))
    return Readings(
        **{key: numbers(getattr(claim, key)) for key in COMPARED},
        standard_error=np.sqrt(np.sum(np.square(errors), axis=0)),
        published=published,
        tolerance=np.nan if claim.tolerance is None else claim.tolerance,
        limit=np.nan if claim.limit is None else claim.limit,
    )


def _interval(readings: Readings) -> tuple[np.ndarray, np.ndarray]:
    """The interval given, or NORMAL_QUANTILE standard errors on either side of the value."""
    half = NORMAL_QUANTILE * readings.standard_error
    low = np.where(np.isnan(readings.low), readings.value - half, readings.low)
    return low, np.where(np.isnan(readings.high), readings.value + half, readings.high)


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def verdict_table(verdicts: Sequence[Verdict]) -> pd.DataFrame:
    """One row per case: id, verdict and the fields of ``Case``; for comparing runs."""
    rows = [
        {"id": verdict.claim.id, "verdict": verdict.verdict} | asdict(case)
        for verdict in verdicts
        for case in verdict.cases
    ]
    return pd.DataFrame(rows)


STATED = ("id", "where", "source", "statement", "about", "by", "because", "recording")


def verdict_data(decided: Sequence[Decided]) -> list[dict]:
    """Each claim with its verdicts by dataset as plain data that JSON can hold; a dataset that does
    not decide it is missing.
    """
    return [
        {name: getattr(row[0].claim, name) for name in (*STATED, "quantity", "unit")}
        | {
            "test": row[0].claim.test,
            "reason": row[0].claim.reason,
            "command": COMMAND,
            "evidence": [reference.address for reference in row[0].claim.references()],
            "datasets": {
                whose.dataset: {
                    "verdict": verdict.verdict,
                    "cases": [asdict(case) for case in verdict.cases],
                }
                for whose, verdict in zip(decided, row, strict=True)
                if verdict.verdict != NO_RECORDING
            },
        }
        for row in zip(*(whose.verdicts for whose in decided), strict=True)
    ]
