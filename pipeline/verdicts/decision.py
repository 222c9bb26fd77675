"""What a run says about each claim: a function of the claims and the run's numbers alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
import pandas as pd

from pipeline.verdicts.claims import COMPARED, Claim
from pipeline.verdicts.reference import ArmNames, Evidence, Reference, joint_names
from pipeline.verdicts.rules import RULES, Readings
from pipeline.verdicts.run import Run

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
SYNTHETIC_CANNOT = "cannot be decided with synthetic data"
NO_EVIDENCE = "no evidence in this dataset"

Recordings = Literal["synthetic", "real", "paper"]


@dataclass(frozen=True)
class Case:
    """One case of a claim as a run has it; what the claim does not have, or is no finite number, is
    None.

    ``distance`` is the published value minus ours in standard errors; ``holds`` whether the rule
    holds, on whatever recordings.
    """

    case: str
    value: float | None
    than: float | None
    low: float | None
    high: float | None
    published: float | None
    distance: float | None
    holds: bool | None


@dataclass(frozen=True)
class Verdict:
    """What a run says about a claim, and the command that recomputes it."""

    claim: Claim
    verdict: str
    cases: tuple[Case, ...]

    @property
    def command(self) -> str:
        """What recomputes the numbers of the claim."""
        return f"dvc repro {self.claim.stage}"


@dataclass(frozen=True)
class Decided:
    """The verdicts on all claims from the recordings of one dataset."""

    dataset: str
    recordings: Recordings
    verdicts: Sequence[Verdict]

    @property
    def summary(self) -> str:
        """How many claims have which verdict, in words."""
        count = Counter(verdict.verdict for verdict in self.verdicts)
        kinds = (REPRODUCED, NOT_REPRODUCED, SYNTHETIC_CANNOT, NO_EVIDENCE)
        return ", ".join(f"{count[kind]} {kind}" for kind in kinds if count[kind])


def decide_each(
    claims: Sequence[Claim], runs: Sequence[Run], papers_own: Sequence[str]
) -> list[Decided]:
    """Every claim from every run's numbers; ``papers_own`` names the datasets that are the paper's
    own recordings.
    """

    def decided(run: Run) -> Decided:
        recordings = "synthetic" if run.synthetic else "real"
        recordings = "paper" if run.dataset in papers_own else recordings
        verdicts = decide(claims, run.evidence, recordings, run.arm)
        return Decided(run.dataset, recordings, verdicts)

    return [decided(run) for run in runs]


def decide(
    claims: Sequence[Claim], evidence: Evidence, recordings: Recordings, arm: ArmNames
) -> list[Verdict]:
    """A verdict on every claim from the numbers of a run on ``recordings``: synthetic, of a real
    robot, or the paper's own, of an ``arm``.

    Where joints have no numbers there is no evidence on claims that number them.
    """
    return [_decide(claim, evidence, recordings, arm) for claim in claims]


def _decide(claim: Claim, evidence: Evidence, recordings: Recordings, arm: ArmNames) -> Verdict:
    if claim.numbers_joints and not arm.numbered:
        evidence = {}
    each = claim.cases(arm.joints)
    readings = _read(claim, each, evidence, arm)
    holds = RULES[claim.rule].holds(readings)
    needed = [
        getattr(readings, key)
        for key in {"value"} | (RULES[claim.rule].needs & {"than", "low", "high", "standard_error"})
    ]
    there = ~np.any(np.isnan(needed), axis=0)
    # a rule that compares cases with each other says nothing where one is missing
    known = there & (there.all() or claim.rule != "decreasing")
    columns = (
        readings.value,
        readings.than,
        *_interval(readings),
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
        Case(name, *map(_or_none, row), bool(held) if is_known else None)
        for name, held, is_known, *row in zip(names, holds, known, *columns, strict=True)
    )
    return Verdict(claim, _verdict(claim.about, recordings, known, holds), cases)


def _verdict(about: str, recordings: Recordings, known: np.ndarray, holds: np.ndarray) -> str:
    # of no joints nothing holds, though no case of it fails
    if not len(known) or not known.all() or (about == "specimen" and recordings == "real"):
        return NO_EVIDENCE
    if about != "method" and recordings == "synthetic":
        return SYNTHETIC_CANNOT
    return REPRODUCED if holds.all() else NOT_REPRODUCED


def _read(claim: Claim, each: list[dict], evidence: Evidence, arm: ArmNames) -> Readings:
    def numbers(reference: Reference | None) -> np.ndarray:
        values = [
            None if reference is None else reference.in_case(case).look_up(evidence, arm)
            for case in each
        ]
        return np.array(values, dtype=float)

    errors = [numbers(part) for part in claim.standard_error or [None]]
    published = np.broadcast_to(np.array(claim.published, dtype=float), len(each))
    return Readings(
        **{key: numbers(getattr(claim, key)) for key in COMPARED},
        standard_error=np.sqrt(np.sum(np.square(errors), axis=0)),
        published=published,
        tolerance=np.nan if claim.tolerance is None else claim.tolerance,
        limit=np.nan if claim.limit is None else claim.limit,
    )


def _interval(readings: Readings) -> tuple[np.ndarray, np.ndarray]:
    """The interval given, or 1.96 standard errors on either side of the value."""
    half = 1.96 * readings.standard_error
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


def verdict_data(decided: Sequence[Decided]) -> list[dict]:
    """Each claim with its verdicts by dataset as plain data that JSON can hold."""
    return [
        {
            "id": row[0].claim.id,
            "where": row[0].claim.where,
            "statement": row[0].claim.statement,
            "about": row[0].claim.about,
            "quantity": row[0].claim.quantity,
            "unit": row[0].claim.unit,
            "test": row[0].claim.test,
            "reason": row[0].claim.reason,
            "command": row[0].command,
            "evidence": [reference.address for reference in row[0].claim.references()],
            "datasets": {
                whose.dataset: {
                    "verdict": verdict.verdict,
                    "cases": [asdict(case) for case in verdict.cases],
                }
                for whose, verdict in zip(decided, row, strict=True)
            },
        }
        for row in zip(*(whose.verdicts for whose in decided), strict=True)
    ]
