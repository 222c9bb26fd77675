"""Claims of the paper as ``reports/claims.yaml`` states them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

from pipeline.core.errors import ConfigError
from pipeline.verdicts.reference import Reference
from pipeline.verdicts.rules import RULES
from pipeline.verdicts.strict import build, is_number

# whose behaviour a claim is about, and so which recordings decide it: any; those of a real robot;
# those of the paper's own robot
ABOUT = ("method", "robots", "specimen")
COMPARED = ("value", "than", "low", "high")
EVERY = "every"  # joint of a dataset's arm


@dataclass(frozen=True)
class Claim:
    """One claim: its place, what it says, what decides it and by which rule and
    tolerance.

    ``each`` maps names to lists of values, or the name ``joint`` to ``every``; the claim has one
    case per combination, and its references hold the names as placeholders. ``published`` is one
    number for all cases or one for each, and ``parameter`` what the paper calls it.
    ``standard_error`` holds one reference or several, which add in squares. ``why`` says of a
    dataset, by its name, why the claim fails there; ``foregone`` why it can hardly fail anywhere.
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
    parameter: str = ""
    tolerance: float | None = None
    limit: float | None = None
    than: Reference | None = None
    low: Reference | None = None
    high: Reference | None = None
    standard_error: list | None = None
    why: dict = field(default_factory=dict)
    foregone: str = ""

    def __post_init__(self) -> None:
        if self.about not in ABOUT:
            raise ConfigError(
                f"must be one of {', '.join(ABOUT)}, found {self.about!r}", key="about"
            )
        if self.rule not in RULES:
            raise ConfigError(f"no rule {self.rule!r}; there are {', '.join(RULES)}", key="rule")
        if not all(
            (values and isinstance(values, list)) or (name, values) == ("joint", EVERY)
            for name, values in self.each.items()
        ):
            raise ConfigError(f"must map names to lists of values, or joint to {EVERY}", key="each")
        if not all(isinstance(reason, str) for reason in self.why.values()):
            raise ConfigError("must map names of datasets to texts", key="why")
        published = self.published if isinstance(self.published, list) else [self.published]
        cases = 1 if EVERY in self.each.values() else len(self.cases())
        if self.published is not None and not (
            all(map(is_number, published)) and len(published) in (1, cases)
        ):
            raise ConfigError(
                f"must be one number, or one for each of the {cases} cases", key="published"
            )
        if self.parameter and (self.published is None or EVERY in self.each.values()):
            raise ConfigError(
                "only what has a published value, and the same cases on every arm, is a parameter",
                key="parameter",
            )
        self._require_what_the_rule_needs()

    def _require_what_the_rule_needs(self) -> None:
        needs = set(RULES[self.rule].needs)
        if "yardstick" in needs:
            needs.remove("yardstick")
            if (self.published is None) == (self.limit is None):
                raise ConfigError(
                    f"the rule {self.rule} needs a published value or a limit of ours, and not "
                    "both",
                    key="limit",
                )
        elif self.limit is not None and "limit" not in needs:
            raise ConfigError(f"the rule {self.rule} has no limit", key="limit")
        if self.tolerance is not None and "tolerance" not in needs:
            raise ConfigError(f"the rule {self.rule} has no tolerance", key="tolerance")
        for key in sorted(needs):
            if getattr(self, key) is None:
                raise ConfigError(f"the rule {self.rule} needs the key {key!r}", key=key)

    def cases(self, joints: Sequence[str] = ("{joint}",)) -> list[dict]:
        """Every combination of the values of ``each``, in the order of the lists, on an arm with
        these ``joints``.
        """
        values = [joints if listed == EVERY else listed for listed in self.each.values()]
        return [dict(zip(self.each, each, strict=True)) for each in product(*values)]

    @property
    def numbers_joints(self) -> bool:
        """Whether it singles joints out by their numbers, and so is about an arm like the paper's
        alone; as are numbers of the paper's own specimen.
        """
        return self.about == "specimen" or any(ref.numbers_joints for ref in self.references())

    @property
    def test(self) -> str:
        """The rule in words, with its numbers."""
        yardstick = "the published value" if self.limit is None else f"{self.limit:g}"
        return RULES[self.rule].words.format(
            tolerance=self.tolerance, limit=self.limit, yardstick=yardstick
        )

    def references(self, joints: Sequence[str] = ("{joint}",)) -> list[Reference]:
        """Every reference of every case on an arm with these ``joints``."""
        named = [getattr(self, key) for key in COMPARED if getattr(self, key) is not None] + (
            self.standard_error or []
        )
        return [reference.in_case(case) for case in self.cases(joints) for reference in named]


@dataclass(frozen=True)
class Stated:
    """What ``reports/claims.yaml`` holds: names of datasets that are the paper's own recordings,
    and entries of claims.
    """

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
    references = {
        key: build(Reference, entry[key], claim=name, key=key) for key in COMPARED if key in entry
    }
    if "standard_error" in entry:
        errors = entry["standard_error"]
        references["standard_error"] = [
            build(Reference, part, claim=name, key="standard_error")
            for part in (errors if isinstance(errors, list) else [errors])
        ]
    claim = build(Claim, entry | references, claim=name)
    try:
        claim.references()
    except ConfigError as error:
        raise ConfigError(error.message, claim=name, **error.evidence) from None
    return claim
