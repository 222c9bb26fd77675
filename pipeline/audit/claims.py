"""Claims of the paper, and what a run says about each: a function of the claims and the run's numbers alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Literal

import numpy as np
import pandas as pd

from pipeline.audit.evidence import Evidence, Reference
from pipeline.audit.rules import RULES, Readings
from pipeline.audit.strict import build, is_number, texts
from pipeline.errors import ConfigError

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
SYNTHETIC_CANNOT = "cannot be decided with synthetic data"
NO_EVIDENCE = "no evidence in this dataset"

# whose behaviour a claim is about, and so which recordings decide it: any; those of a real robot; those of the paper's own robot
ABOUT = ("method", "robots", "specimen")
Recordings = Literal["synthetic", "real", "paper"]
COMPARED = ("value", "than", "low", "high")


@dataclass(frozen=True)
class Claim:
    """One claim: its place, what it says, what decides it and by which rule, chosen with its tolerance beforehand.

    ``each`` maps names to lists of values; the claim has one case per combination, and its references hold the names as placeholders.
    ``published`` is one number for all cases or one for each. ``standard_error`` holds one reference or several, which add in squares.
    Raises ConfigError with the key.
    """

    id: str
    where: str
    statement: str
    about: str
    quantity: str
    rule: str
    reason: str
    stage: str
    value: Reference
    unit: str = ""
    each: dict = field(default_factory=dict)
    published: float | list | None = None
    tolerance: float | None = None
    limit: float | None = None
    than: Reference | None = None
    low: Reference | None = None
    high: Reference | None = None
    standard_error: list | None = None

    def __post_init__(self) -> None:
        texts(self, "id", "where", "statement", "about", "quantity", "rule", "reason", "stage", "unit")
        if self.about not in ABOUT:
            raise ConfigError(f"must be one of {', '.join(ABOUT)}, found {self.about!r}", key="about")
        if self.rule not in RULES:
            raise ConfigError(f"no rule {self.rule!r}; there are {', '.join(RULES)}", key="rule")
        if not isinstance(self.each, dict) or not all(isinstance(values, list) and values for values in self.each.values()):
            raise ConfigError("must map names to lists of values", key="each")
        for key in ("tolerance", "limit"):
            if getattr(self, key) is not None and not is_number(getattr(self, key)):
                raise ConfigError(f"must be a number, found {getattr(self, key)!r}", key=key)
        published = self.published if isinstance(self.published, list) else [self.published]
        if self.published is not None and not (all(map(is_number, published)) and len(published) in (1, len(self.cases))):
            raise ConfigError(f"must be one number, or one for each of the {len(self.cases)} cases", key="published")
        self._require_what_the_rule_needs()

    def _require_what_the_rule_needs(self) -> None:
        needs = set(RULES[self.rule].needs)
        if "yardstick" in needs:
            needs.remove("yardstick")
            if (self.published is None) == (self.limit is None):
                raise ConfigError(f"the rule {self.rule} needs a published value or a limit of ours, and not both", key="limit")
        elif self.limit is not None and "limit" not in needs:
            raise ConfigError(f"the rule {self.rule} has no limit", key="limit")
        if self.tolerance is not None and "tolerance" not in needs:
            raise ConfigError(f"the rule {self.rule} has no tolerance", key="tolerance")
        for key in sorted(needs):
            if getattr(self, key) is None:
                raise ConfigError(f"the rule {self.rule} needs the key {key!r}", key=key)

    @property
    def cases(self) -> list[dict]:
        """Every combination of the values of ``each``, in the order of the lists."""
        return [dict(zip(self.each, values, strict=True)) for values in product(*self.each.values())]

    @property
    def test(self) -> str:
        """The rule in words, with its numbers."""
        yardstick = "the published value" if self.limit is None else f"{self.limit:g}"
        return RULES[self.rule].words.format(tolerance=self.tolerance, limit=self.limit, yardstick=yardstick)

    @property
    def references(self) -> list[Reference]:
        """Every reference of every case."""
        named = [getattr(self, key) for key in COMPARED if getattr(self, key) is not None] + (self.standard_error or [])
        return [reference.of_case(case) for case in self.cases for reference in named]


@dataclass(frozen=True)
class Case:
    """One case of a claim as a run has it; what the claim does not have, or is no finite number, is None.

    ``distance`` is the published value minus ours in standard errors; ``holds`` whether the rule holds, on whatever recordings.
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
class Stated:
    """What ``reports/claims.yaml`` holds: names of datasets that are the paper's own recordings, and entries of claims."""

    recordings_of_the_paper: list
    claims: list


def parse_claims(entries: object) -> list[Claim]:
    """The claims of a YAML list. Raises ConfigError with the claim and the key."""
    if not isinstance(entries, list):
        raise ConfigError("claims must be a list", key="claims")
    claims = [_parse(entry, number) for number, entry in enumerate(entries, 1)]
    names = [claim.id for claim in claims]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError("two claims have one id", claim=name, key="id")
    return claims


def _parse(entry: object, number: int) -> Claim:
    name = entry.get("id", f"number {number}") if isinstance(entry, dict) else f"number {number}"
    if not isinstance(entry, dict):
        raise ConfigError("must hold keys and values", claim=name)
    references = {key: build(Reference, entry[key], claim=name, key=key) for key in COMPARED if key in entry}
    if "standard_error" in entry:
        parts = entry["standard_error"] if isinstance(entry["standard_error"], list) else [entry["standard_error"]]
        references["standard_error"] = [build(Reference, part, claim=name, key="standard_error") for part in parts]
    claim = build(Claim, entry | references, claim=name)
    try:
        _ = claim.references
    except ConfigError as error:
        raise ConfigError(error.message, claim=name, **error.evidence) from None
    return claim


def decide(claims: Sequence[Claim], evidence: Evidence, recordings: Recordings) -> list[Verdict]:
    """A verdict on every claim from the numbers of a run on ``recordings``: synthetic, of a real robot, or the paper's own."""
    return [_decide(claim, evidence, recordings) for claim in claims]


def _decide(claim: Claim, evidence: Evidence, recordings: Recordings) -> Verdict:
    readings = _read(claim, evidence)
    holds = RULES[claim.rule].holds(readings)
    needed = [getattr(readings, key) for key in {"value"} | (RULES[claim.rule].needs & {"than", "low", "high", "standard_error"})]
    there = ~np.any(np.isnan(needed), axis=0)
    # a rule that compares cases with each other says nothing where one is missing
    known = there & (there.all() or claim.rule != "decreasing")
    columns = (readings.value, readings.than, *_interval(readings), readings.published, readings.distance)
    names = [", ".join(value if isinstance(value, str) else f"{name} {value}" for name, value in case.items()) for case in claim.cases]
    cases = tuple(
        Case(name, *map(_or_none, row), bool(held) if is_known else None)
        for name, held, is_known, *row in zip(names, holds, known, *columns, strict=True)
    )
    return Verdict(claim, _verdict(claim.about, recordings, known, holds), cases)


def _verdict(about: str, recordings: Recordings, known: np.ndarray, holds: np.ndarray) -> str:
    if not known.all() or (about == "specimen" and recordings == "real"):
        return NO_EVIDENCE
    if about != "method" and recordings == "synthetic":
        return SYNTHETIC_CANNOT
    return REPRODUCED if holds.all() else NOT_REPRODUCED


def _read(claim: Claim, evidence: Evidence) -> Readings:
    def looked_up(reference: Reference | None) -> np.ndarray:
        found = [None if reference is None else reference.of_case(case).look_up(evidence) for case in claim.cases]
        return np.array(found, dtype=float)

    errors = [looked_up(part) for part in claim.standard_error or [None]]
    published = np.broadcast_to(np.array(claim.published, dtype=float), len(claim.cases))
    return Readings(
        **{key: looked_up(getattr(claim, key)) for key in COMPARED},
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
    rows = [{"id": of.claim.id, "verdict": of.verdict} | asdict(case) for of in verdicts for case in of.cases]
    return pd.DataFrame(rows)
