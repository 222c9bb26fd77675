"""Claims of the paper and of the project in ``claims.yaml``, and the rules of verdicts.

A rule is a function of a table with a row for each case; a number that the claim lacks is NaN.
``value`` is the run's number, ``than`` the number compared with. ``low`` and ``high`` bound the
value, or for an order the difference ``value − than``. ``threshold`` and ``power`` belong to a test
of the run. The claim states ``published``, ``tolerance`` and ``limit``. ``yardstick`` is the
published value or the limit; ``distance`` is (published − value)/``standard_error``.
"""

from collections.abc import Callable, Sequence
from dataclasses import field
from itertools import product
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import options
from pipeline.statistics.curves import POWER
from pipeline.verdicts.run import Number, Reference, parse_entries

CONSTRUCTION, LEVEL = "construction", "level"  # values of Claim.by
NONE = "none"  # value of Claim.recording for a claim that needs no recording
PAPER, PROJECT = "paper", "project"
COMPARED = ("value", "than", "low", "high", "threshold", "power")
REFERENCES = ("value", "than", "difference", "threshold", "power")
STATED = (*REFERENCES, "published", "limit", "tolerance", "standard_error")
EVERY = "every"  # value of ``each`` for all joints of a dataset's arm
ENDS = {"low", "high"}  # of the difference, else of the value
ORDERS = ("less", "greater")  # rules that need an interval of the difference
Judge = Callable[[pd.DataFrame], pd.Series]

HOLDS: dict[str, Judge] = {
    "within_relative": lambda r: (r.value - r.published).abs() <= r.tolerance * r.published.abs(),
    "within_absolute": lambda r: (r.value - r.published).abs() <= r.tolerance,
    "below": lambda r: r.value < r.yardstick,
    "above": lambda r: r.value > r.yardstick,
    "varies": lambda r: r.value > r.limit,
    "follows": lambda r: r.value >= r.threshold,
    "less": lambda r: r.high < 0,
    "greater": lambda r: r.low > 0,
    "decreasing": lambda r: pd.Series(np.diff(r.value, prepend=np.inf) < 0, r.index),
    "equivalent": lambda r: np.maximum(-r.low, r.high) < r.tolerance * r.than.abs(),
    "interval_contains": lambda r: (
        (r.low - r.tolerance <= r.published) & (r.published <= r.high + r.tolerance)
    ),
    "standard_errors": lambda r: r.distance.abs() < r.limit,
}
DECIDES: dict[str, Judge] = dict.fromkeys(HOLDS, lambda r: r.value.notna()) | {
    **dict.fromkeys(ORDERS, lambda r: (r.low > 0) | (r.high < 0)),
    "varies": lambda r: (r.value <= r.limit) | (r.value > r.threshold),
    "follows": lambda r: r.power >= POWER,
}


class Rule(NamedTuple):
    """A rule in ``words``, the keys of a claim that it ``needs``, and two masks of cases: the rule
    ``holds``, and the rule ``decides`` (an interval that contains zero decides no order).
    """

    words: str
    needs: set[str]
    holds: Judge
    decides: Judge


RULES = {
    name: Rule(rule["words"], {*rule["needs"]}, HOLDS[name], DECIDES[name])
    for name, rule in read_yaml(Path(__file__).with_name("rules.yaml")).items()
}


@options(frozen=True)
class Unless:
    """A measured ``value`` and its ``limit``: a dataset above the limit gives no evidence."""

    value: Reference
    limit: Number
    reason: str


@options(frozen=True)
class Claim:
    """One claim with its evidence, rule and tolerance; raises ConfigError with the key.

    - ``about``: the recordings that decide the claim: any, a real robot's, or the paper's own;
    - ``each``: lists of values by name, or ``joint: every``; each combination is a case, whose
      values replace the names in references;
    - ``published``: one number for all cases or one per case; ``parameter``: its name in the paper;
    - ``difference``: the difference of an order, whose interval decides;
    - ``standard_error``: one reference, or several that add in squares;
    - ``by``: the construction of the models forces the claim (no verdict), or their total variance
      decides the claim; ``because`` has the reason;
    - ``why``: reasons for a failure of the claim, by name of the dataset.
    """

    id: str
    statement: str
    about: Literal["method", "robots", "specimen"]
    quantity: str
    rule: Literal[*RULES]
    reason: str
    value: Reference
    where: str = ""
    source: Literal[PAPER, PROJECT] = PAPER
    recording: Literal["", NONE] = ""
    by: Literal["", CONSTRUCTION, LEVEL] = ""
    because: str = ""
    unit: str = ""
    each: dict[str, list | Literal["every"]] = field(default_factory=dict)
    published: Number | list[Number] | None = None
    parameter: str = ""
    tolerance: Number | None = None
    limit: Number | None = None
    than: Reference | None = None
    difference: Reference | None = None
    threshold: Reference | None = None
    power: Reference | None = None
    standard_error: list[Reference] | Reference | None = None
    unless: Unless | None = None
    why: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, values in self.each.items():
            if not (values and isinstance(values, list)) and (name, values) != ("joint", EVERY):
                message = f"must map names to lists of values, or joint to {EVERY}"
                raise ConfigError(message, key="each")
        cases = 1 if EVERY in self.each.values() else len(self.cases())
        if isinstance(self.published, list) and len(self.published) not in (1, cases):
            message = f"must be one number, or one for each of the {cases} cases"
            raise ConfigError(message, key="published")
        needs, rule = set(RULES[self.rule].needs), f"the rule {self.rule}"
        stated = {key for key in STATED if getattr(self, key) is not None}
        yardstick = {"published", "limit"} if "yardstick" in needs else set()
        if yardstick and len(stated & yardstick) != 1:
            message = f"{rule} needs either a published value or a limit, not both"
            raise ConfigError(message, key="limit")
        if self.rule in ORDERS and self.by != CONSTRUCTION:
            needs |= {"difference"}
        needs -= ENDS
        for key in sorted({"limit", "tolerance", "threshold", "power"} - needs - yardstick):
            if key in stated:
                raise ConfigError(f"{rule} does not use this key; remove it", key=key)
        if missing := sorted(needs - stated - {"yardstick"}):
            raise ConfigError(f"{rule} needs this key; add it", key=missing[0])
        self.references()

    def cases(self, joints: Sequence[str] = ("{joint}",)) -> list[dict]:
        """Return every combination of the values of ``each`` for an arm with these ``joints``."""
        values = [joints if listed == EVERY else listed for listed in self.each.values()]
        return [dict(zip(self.each, each, strict=True)) for each in product(*values)]

    @property
    def numbers_joints(self) -> bool:
        """True if the claim numbers joints or is about the paper's own arm."""
        return self.about == "specimen" or any(ref.joint_numbers for ref in self.references())

    @property
    def standard_errors(self) -> list[Reference]:
        """References whose values add in squares."""
        stated = self.standard_error or []
        return stated if isinstance(stated, list) else [stated]

    @property
    def test(self) -> str:
        """Words of the rule with the claim's numbers."""
        yardstick = "the published value" if self.limit is None else f"{self.limit:g}"
        numbers = {"tolerance": self.tolerance, "limit": self.limit, "yardstick": yardstick}
        return RULES[self.rule].words.format(**numbers)

    def references(self, joints: Sequence[str] = ("{joint}",)) -> list[Reference]:
        """Return every reference of every case for an arm with these ``joints``."""
        named = [getattr(self, key) for key in REFERENCES if getattr(self, key) is not None]
        named += [*self.standard_errors, *([self.unless.value] if self.unless else [])]
        return [reference.in_case(case) for case in self.cases(joints) for reference in named]


@options(frozen=True)
class ClaimsFile:
    """Content of ``claims.yaml``: names of the paper's own datasets, entries of claims."""

    recordings_of_the_paper: list[str]
    claims: list


def parse_claims(entries: object) -> list[Claim]:
    """Return the claims of a YAML list; raises ConfigError with the claim and the key."""
    return parse_entries(Claim, entries, "claim")
