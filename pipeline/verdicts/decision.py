"""Verdicts on claims: a function of the claims and a run's numbers alone."""

from collections import namedtuple
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from pipeline.statistics.takes import NORMAL_QUANTILE
from pipeline.verdicts.claims import COMPARED, CONSTRUCTION, NONE, Claim
from pipeline.verdicts.rules import RULES
from pipeline.verdicts.run import ArmNames, Evidence, Reference, Run

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
SYNTHETIC_CANNOT = "cannot be decided with synthetic data"
NO_EVIDENCE = "no evidence in this dataset"
FORCED = "forced by construction"
NO_RECORDING = "decided without a recording"
COMMAND = "dvc repro publish"  # writes all evidence into the dataset's reports
WITHOUT_RECORDING = "no recording"  # name of the column of claims that need none
PRINTED = ("id", "where", "source", "statement", "about", "by", "because", "recording")
PRINTED += ("quantity", "unit", "test", "reason")

Recordings = Literal["none", "synthetic", "real", "paper"]


class Case(namedtuple("Case", ["case", *COMPARED, "published", "distance", "holds"])):
    """One case of a claim in a run by its name; a number that is missing or not finite is None.

    ``distance`` is the published value minus ours in standard errors; ``holds`` is None if the
    rule does not decide the case, on whatever recordings.
    """


class Verdict(NamedTuple):
    """Verdict on a claim in a run."""

    claim: Claim
    verdict: str
    cases: tuple[Case, ...]


class Decided(NamedTuple):
    """Verdicts from one dataset's recordings, or on claims that need none (``recordings`` none)."""

    dataset: str
    recordings: Recordings
    verdicts: Sequence[Verdict]


def decide_each(
    claims: Sequence[Claim], runs: Sequence[Run], papers_own: Sequence[str]
) -> list[Decided]:
    """Return verdicts from every run, then without a recording; ``papers_own`` are datasets."""
    columns = []
    for run in runs:
        whose = "synthetic" if run.synthetic else "real"
        columns.append((run.dataset, "paper" if run.dataset in papers_own else whose, run))
    columns.append((WITHOUT_RECORDING, "none", runs[0]))
    return [Decided(n, w, decide(claims, run.evidence, w, run.arm)) for n, w, run in columns]


def decide(
    claims: Sequence[Claim], evidence: Evidence, recordings: Recordings, arm: ArmNames
) -> list[Verdict]:
    """Return a verdict on every claim from the numbers of a run on ``recordings``: none, synthetic,
    of a real robot, or the paper's own, of an ``arm``.

    Where joints have no numbers there is no evidence on claims that number them.
    """
    return [_decide(claim, evidence, recordings, arm) for claim in claims]


def _decide(claim: Claim, evidence: Evidence, recordings: Recordings, arm: ArmNames) -> Verdict:
    if claim.numbers_joints and not arm.numbered:
        evidence = {}
    rule, each = RULES[claim.rule], claim.cases(arm.joints)
    r = _read(claim, each, evidence, arm)
    keys = sorted({"value"} | (rule.needs & {*COMPARED, "standard_error"}))
    there = r[keys].notna().all(axis=1)
    # a rule that compares cases with each other says nothing where one is missing
    known = there & (there.all() or claim.rule != "decreasing")
    void = False
    if (unless := claim.unless) is not None:
        share = Reference(unless.file, unless.key).look_up(evidence, arm)
        void = share is not None and share > unless.limit
    decides, holds = known & rule.decides(r) & (not void), rule.holds(r)
    half = NORMAL_QUANTILE * r.standard_error
    r = r.assign(low=r.low.fillna(r.value - half), high=r.high.fillna(r.value + half))
    numbers = r[list(Case._fields[1:-1])].replace([np.inf, -np.inf], np.nan).astype(object)
    numbers = numbers.where(numbers.notna(), None)
    numbers["holds"] = holds.astype(object).where(decides, None)
    names = [_name(case, arm) for case in each]
    cases = tuple(Case(*row) for row in zip(names, *map(numbers.get, numbers), strict=True))

    def verdict() -> str:
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
        if (decides & ~holds).any():
            return NOT_REPRODUCED  # one case refutes a claim on all
        return REPRODUCED if decides.all() else NO_EVIDENCE

    return Verdict(claim, verdict(), cases)


def _name(case: dict, arm: ArmNames) -> str:
    texts = (arm.named(v) if isinstance(v, str) else f"{k} {v}" for k, v in case.items())
    return ", ".join(texts)


def _read(claim: Claim, each: list[dict], evidence: Evidence, arm: ArmNames) -> pd.DataFrame:
    """Table of a rule (:mod:`pipeline.verdicts.rules`): a row for each case."""

    def numbers(reference: Reference | None) -> np.ndarray:
        values = [reference and reference.in_case(case).look_up(evidence, arm) for case in each]
        return np.array(values, dtype=float)

    errors = [numbers(part) for part in claim.standard_errors or [None]]
    r = pd.DataFrame({key: numbers(getattr(claim, key)) for key in COMPARED})
    r["standard_error"] = np.sqrt(np.sum(np.square(errors), axis=0))
    for key in ("published", "tolerance", "limit"):
        r[key] = np.broadcast_to(np.array(getattr(claim, key), dtype=float), len(each))
    r["yardstick"] = r.published.fillna(r.limit)
    return r.assign(distance=(r.published - r.value) / r.standard_error)


def verdict_data(decided: Sequence[Decided]) -> list[dict]:
    """Return each claim with its verdicts by dataset that decides it, as JSON can hold them."""
    entries = []
    for row in zip(*(whose.verdicts for whose in decided), strict=True):
        claim = row[0].claim
        entry = {name: getattr(claim, name) for name in PRINTED} | {"command": COMMAND}
        entry["evidence"] = [reference.address for reference in claim.references()]
        entry["datasets"] = {
            whose.dataset: {"verdict": v.verdict, "cases": [case._asdict() for case in v.cases]}
            for whose, v in zip(decided, row, strict=True)
            if v.verdict != NO_RECORDING
        }
        entries.append(entry)
    return entries
