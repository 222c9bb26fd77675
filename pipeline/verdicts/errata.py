"""Contradictions and gaps of the paper, each with the fact, what is done here, and the test that
shows it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import Literal

from pydantic import Field

from pipeline.core.errors import ConfigError
from pipeline.core.validation import options
from pipeline.verdicts.decision import NO_RECORDING, Decided
from pipeline.verdicts.reference import Reference, TestName, parsed_entries
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import number

MISSING = "(not in this dataset)"


@options(frozen=True)
class ClaimNumber:
    """A number of a claim: the ``published`` one, ours (``value``) or their ``distance`` in
    standard errors, in one of its cases; of a variance a step the standard deviation of the sum of
    so many independent ``steps``.
    """

    claim: str
    number: Literal["published", "value", "distance"]
    case: str = ""
    steps: int = 0

    def look_up(self, decided: Sequence[Decided]) -> float | None:
        """The number, or None where the run has none. Raises ConfigError for a claim or case that
        does not exist.
        """
        cases = {
            case.case: case
            for verdict in (decided[0].verdicts + decided[-1].verdicts)
            if verdict.claim.id == self.claim and verdict.verdict != NO_RECORDING
            for case in verdict.cases
        }
        if self.case not in cases:
            raise ConfigError(f"no claim {self.claim!r} with the case {self.case!r}", key="values")
        value = getattr(cases[self.case], self.number)
        return sqrt(self.steps * value) if self.steps and value is not None else value


@options(frozen=True)
class Erratum:
    """One entry: ``place`` in the paper and what the ``paper`` says there, the ``fact``, what is
    ``done`` here, the ``tests`` that show it.

    ``{name}`` in the prose stands for the number of that name in ``values``.
    """

    id: str
    title: str
    place: str
    paper: str
    fact: str
    done: str
    tests: list[TestName] = Field(min_length=1)
    values: dict[str, ClaimNumber | Reference] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _filled(self, dict.fromkeys(self.values, ""))


def parse_errata(entries: object) -> list[Erratum]:
    """The entries of a YAML list. Raises ConfigError with the entry and the key."""
    return parsed_entries(Erratum, entries, "erratum")


def _filled(erratum: Erratum, numbers: Mapping[str, str]) -> dict[str, str]:
    try:
        return {
            part: getattr(erratum, part).format(**numbers) for part in ("paper", "fact", "done")
        }
    except (KeyError, IndexError, ValueError):
        raise ConfigError(
            "a placeholder in the prose that is not among the values", key="values"
        ) from None


@dataclass(frozen=True)
class Corrected:
    """An entry with the numbers of a run and of the claims in its prose."""

    erratum: Erratum
    paper: str
    fact: str
    done: str


def correct(errata: Sequence[Erratum], run: Run, decided: Sequence[Decided]) -> list[Corrected]:
    """Every entry with the numbers of ``run``, the first that is ``decided``."""

    def corrected(erratum: Erratum) -> Corrected:
        prose = _filled(
            erratum,
            {name: _number(source, run, decided) for name, source in erratum.values.items()},
        )
        return Corrected(erratum, **{part: " ".join(text.split()) for part, text in prose.items()})

    return [corrected(erratum) for erratum in errata]


def errata_page(entries: Sequence[Corrected]) -> str:
    """``errata.md``."""
    sections = [
        "# Errata: where the paper contradicts itself, is wrong, or leaves open what decides a "
        "result",
        "Written by the stage `report` from `pipeline/verdicts/errata.yaml`. Numbers of the run "
        "come from [metrics](metrics) and "
        "[tables](tables), published ones from `reports/claims.yaml`. Each entry names the tests "
        "that show it.",
    ]
    for place, entry in enumerate(entries, 1):
        sections += [
            f'<a id="{entry.erratum.id}"></a>\n\n## {place}. {entry.erratum.title}',
            f"**The paper** ({entry.erratum.place}): {entry.paper}",
            f"**In fact**: {entry.fact}",
            f"**Here**: {entry.done}",
            "\n".join(f"- `{test}`" for test in entry.erratum.tests),
        ]
    return "\n\n".join(sections) + "\n"


def _number(source: ClaimNumber | Reference, run: Run, decided: Sequence[Decided]) -> str:
    if isinstance(source, ClaimNumber):
        value = source.look_up(decided)
    else:
        value = source.look_up(run.evidence, run.arm)
    return MISSING if value is None else number(value)
