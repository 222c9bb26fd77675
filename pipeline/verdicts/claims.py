"""Claims of the paper and of the project in ``claims.yaml``."""

from collections.abc import Sequence
from dataclasses import field
from difflib import get_close_matches
from itertools import product
from typing import Literal

from pipeline.core.errors import ConfigError
from pipeline.core.validation import options
from pipeline.evidence.table import known_values
from pipeline.verdicts.rules import RULES
from pipeline.verdicts.run import Number, Reference, parse_entries

CONSTRUCTION, LEVEL = "construction", "level"  # values of Claim.by
NONE = "none"  # value of Claim.recording for a claim that needs no recording
PAPER, PROJECT = "paper", "project"
COMPARED = ("value", "than", "difference", "low", "high", "threshold", "power", "control")
REFERENCES = ("value", "than", "difference", "threshold", "power", "control")
STATED = (*REFERENCES, "published", "limit", "tolerance", "margin", "standard_error")
EVERY = "every"  # value of ``each`` for all joints of a dataset's arm
ENDS = {"low", "high"}  # of the difference, else of the value
ORDERS = ("less", "greater")  # rules that need an interval of the difference


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
    - ``difference``: the difference of an order, whose interval decides; ``margin``: the least
      relevant difference, in its unit;
    - ``control``: the same number of a control without the claimed effect: where it passes too, the
      rule has no power;
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
    margin: Number | None = None
    than: Reference | None = None
    difference: Reference | None = None
    threshold: Reference | None = None
    power: Reference | None = None
    control: Reference | None = None
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
            needs |= {"difference", "margin"}
        needs -= ENDS
        for key in sorted(
            {"limit", "margin", "tolerance", "threshold", "power"} - needs - yardstick
        ):
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
        return self.about == "specimen" or any(ref.numbers_joints for ref in self.references())

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
        numbers["margin"] = self.margin
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


def require_known(claims: Sequence[Claim]) -> Sequence[Claim]:
    """Return ``claims``; raises ConfigError with claim and key for a model, an estimator, an entry
    or steps that no row of the evidence can have: it would be a claim without evidence.
    """
    known = known_values()
    for claim in claims:
        for reference, (key, values) in product(claim.references(), known.items()):
            stated = getattr(reference, key)
            if stated and "{" not in stated and stated not in values:
                near = get_close_matches(stated, values, n=1) or [", ".join(values)]
                message = f"no evidence can have the {key} {stated!r}; did you mean {near[0]}?"
                raise ConfigError(message, claim=claim.id, key=key)
    return claims
