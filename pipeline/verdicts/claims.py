"""Claims of the paper and of the project in ``claims.yaml``."""

from collections.abc import Sequence
from dataclasses import field, replace
from difflib import get_close_matches
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from pipeline.core.errors import ConfigError
from pipeline.core.filters import SPEED
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import options
from pipeline.evidence.table import KEYS, known_values
from pipeline.verdicts.published import PUBLISHED, published_results
from pipeline.verdicts.rules import RULES
from pipeline.verdicts.run import ArmNames, Number, Reference, filled, parse_entries

CLAIMS = Path("pipeline/verdicts/claims.yaml")
# values of Claim.by
CONSTRUCTION = "construction"
LEVEL = "level"
NONE = "none"  # value of Claim.recording for a claim that needs no recording
PAPER = "paper"
PROJECT = "project"
COMPARED = (
    "value",
    "than",
    "difference",
    "low",
    "high",
    "threshold",
    "power",
    "speed_power",
    "control",
)
REFERENCES = tuple(key for key in COMPARED if key not in ("low", "high"))
STATED = (*REFERENCES, "published", "limit", "tolerance", "margin", "standard_error")
OPTIONAL = {*STATED} - {"value", "published", "control"}  # keys of some rules alone
YARDSTICK = "yardstick"  # need of a rule: ``published`` or ``limit``
EVERY = "every"  # value of ``each`` for all joints of a dataset's arm
Distance = Annotated[float, Field(strict=True, ge=0)]
ENDS = {"low", "high"}  # of the difference, else of the value
INTERVAL = (*ENDS, "standard_error", "degrees")  # columns of a row with an interval
CONTROLLED = ("value", "difference", "threshold", "power")  # references of a model
ORDERS = ("less", "greater", "close")  # rules that need an interval of the difference


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
    - ``difference``: the row of ``value`` whose rival is the model or joint of ``than``; its
      interval decides an order; ``margin``: the least relevant difference, in its unit;
    - ``control``: the same number of a control without the claimed effect: where it passes too, the
      rule has no power;
    - ``control_model``: a model without the claimed property, whose numbers the same rule decides
      in place of the model's; where it passes too, the claim holds for it as well;
    - ``speed_power``: the power of the rule against recordings that the control model made;
    - ``standard_error``: references whose values add in squares;
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
    each: dict[str, Annotated[list, Field(min_length=1)] | Literal["every"]] = field(
        default_factory=dict,
    )
    published: Number | list[Number] | None = None
    parameter: str = ""
    tolerance: Distance | None = None
    limit: Number | None = None
    margin: Distance | None = None
    than: Reference | None = None
    difference: Reference | None = None
    threshold: Reference | None = None
    power: Reference | None = None
    speed_power: Reference | None = None
    control_model: Literal["", SPEED] = ""
    control: Reference | None = None
    standard_error: list[Reference] = field(default_factory=list)
    unless: Unless | None = None
    why: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if {name for name, values in self.each.items() if values == EVERY} - {"joint"}:
            raise ConfigError(
                f"{EVERY} is possible for joint alone; list the values",
                key="each",
            )
        cases = 1 if EVERY in self.each.values() else len(self.cases())
        if isinstance(self.published, list) and len(self.published) not in (1, cases):
            message = f"must be one number, or one for each of the {cases} cases"
            raise ConfigError(message, key="published")
        needs = RULES[self.rule].needs - ENDS
        if self.rule in ORDERS and self.by != CONSTRUCTION:
            needs |= {"difference", "margin"}
        stated = {key for key in STATED if getattr(self, key) not in (None, [])}
        if YARDSTICK in needs:
            needs = needs - {YARDSTICK} | {"published", "limit"} & stated
            if len({"published", "limit"} & stated) != 1:
                message = "needs either a published value or a limit, not both"
                raise ConfigError(f"the rule {self.rule} {message}", key="limit")
        for key in sorted(stated & OPTIONAL - needs - RULES[self.rule].options):
            message = f"the rule {self.rule} does not use this key; remove it"
            raise ConfigError(message, key=key)
        for key in sorted(needs - stated):
            message = f"the rule {self.rule} needs this key; add it"
            raise ConfigError(message, key=key)
        if self.difference is not None and self.rule in ORDERS:
            rivals = {self.than.model, self.than.joint}
            of_value = replace(self.difference, rival="") == self.value
            if not of_value or self.difference.rival not in rivals:
                message = "must have the keys of value, and the model or joint of than as rival"
                raise ConfigError(message, key="difference")
        if bool(self.where) != (self.source == PAPER):
            message = (
                "the paper's claim needs the place in the paper, the project's has none"
            )
            raise ConfigError(message, key="where")
        placeholders = [*self.each, "joint 1", "joint 2", "joint 3"]
        values = dict.fromkeys(placeholders, "")
        for reference, key in product(self.references, KEYS):
            text = filled(getattr(reference, key), values)
            if "{" in text:
                message = f"unknown placeholder; the claim has {', '.join(self.each) or 'none'}"
                raise ConfigError(message, key=text)

    def cases(self, arm: ArmNames = ArmNames(("{joint}",), ())) -> list[dict]:  # noqa: B008
        """Return every combination of the values of ``each`` for an ``arm``."""
        values_by_name = []
        for listed in self.each.values():
            values = arm.joints
            if listed != EVERY:
                values = [
                    filled(value, arm.numbered) if isinstance(value, str) else value
                    for value in listed
                ]
            values_by_name.append(values)
        combinations = product(*values_by_name)
        return [dict(zip(self.each, values, strict=True)) for values in combinations]

    @property
    def of_control(self) -> "Claim":
        """The claim about the control model in place of its own."""
        models = {}
        for key in CONTROLLED:
            reference = getattr(self, key)
            if reference is not None and reference.model == self.value.model:
                models[key] = replace(reference, model=self.control_model)
        return replace(self, **models)

    @property
    def numbers_joints(self) -> bool:
        """True if the claim numbers joints or is about the paper's own arm."""
        return self.about == "specimen" or "{joint " in f"{self.each} {self.references}"

    @property
    def references(self) -> list[Reference]:
        """Every reference, with placeholders for the values of a case."""
        named = [getattr(self, key) for key in REFERENCES]
        references = [reference for reference in named if reference is not None]
        references += self.standard_error
        if self.unless:
            references.append(self.unless.value)
        return references


@options(frozen=True)
class ClaimsFile:
    """Content of ``claims.yaml``: names of the paper's own datasets, entries of claims."""

    recordings_of_the_paper: list[str]
    claims: list


def parse_claims(entries: object) -> list[Claim]:
    """Return the claims of a YAML list; raises ConfigError with the claim and the key. The text
    ``published.yaml`` as the published value stands for the claim's entry of this file.
    """
    if not isinstance(entries, list):
        return parse_entries(Claim, entries, "claim")
    results = published_results()
    filled_entries = []
    for entry in entries:
        if isinstance(entry, dict) and entry.get("published") == PUBLISHED.name:
            name = str(entry.get("id"))
            if name not in results:
                message = f"{PUBLISHED.name} has no entry {name!r}; add it, or state the number"
                raise ConfigError(message, claim=name, key="published")
            values = results[name]
            if isinstance(values, dict):
                values = [*values.values()]
            entry = entry | {"published": values}
        filled_entries.append(entry)
    return parse_entries(Claim, filled_entries, "claim")


def require_known(claims: Sequence[Claim]) -> Sequence[Claim]:
    """Return ``claims``; raises ConfigError with claim and key for a model, an estimator, an entry
    or steps that no row of the evidence can have: it would be a claim without evidence.
    """
    possible = known_values().items()
    for claim in claims:
        stated = product(claim.cases(), claim.references, possible)
        for case, reference, (key, values) in stated:
            value = filled(getattr(reference, key), case)
            if not value or "{" in value or value in values:
                continue
            near = get_close_matches(value, values, n=1) or [", ".join(values)]
            message = (
                f"no evidence can have the {key} {value!r}; did you mean {near[0]}?"
            )
            raise ConfigError(message, claim=claim.id, key=key)
    return claims


def read_claims(*conclusions: Path) -> tuple[Claim, ...]:
    """Return the paper's claims, then the claims of the files ``conclusions``."""
    claims = []
    for file in (CLAIMS, *conclusions):
        entries = read_yaml(file).get("claims")
        claims += require_known(parse_claims(entries))
    return tuple(claims)
