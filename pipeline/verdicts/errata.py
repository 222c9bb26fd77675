"""Contradictions and gaps of the paper, each with the fact, what is done here, and its tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from math import sqrt
from typing import Literal

from pydantic import Field

from pipeline.core.errors import ConfigError
from pipeline.core.validation import options
from pipeline.verdicts.decision import NO_RECORDING, Decided
from pipeline.verdicts.run import Reference, Run, TestName, parsed_entries
from pipeline.verdicts.wording import TEXTS, number, page

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
        """Return the number, or None if the run has none; ConfigError for no such claim or case."""
        for claim, verdict, cases in decided[0].verdicts + decided[-1].verdicts:
            found = [case for case in cases if case.case == self.case]
            if claim.id == self.claim and verdict != NO_RECORDING and found:
                break
        else:
            raise ConfigError(f"no claim {self.claim!r} with the case {self.case!r}", key="values")
        value = getattr(found[0], self.number)
        return sqrt(self.steps * value) if self.steps and value is not None else value


@options(frozen=True)
class Erratum:
    """One entry: ``place`` in the paper and what the ``paper`` says there, the ``fact``, what is
    ``done`` here, the ``tests`` that show it.

    ``{name}`` in the prose is the number of that name in ``values``.
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
        try:
            self.prose(dict.fromkeys(self.values, ""))
        except (KeyError, IndexError, ValueError):
            message = "a placeholder in the prose that is not among the values"
            raise ConfigError(message, key="values") from None

    def prose(self, numbers: dict[str, str]) -> list[str]:
        """Return what the paper says, the fact and what is done, with ``numbers`` by name."""
        texts = (self.paper, self.fact, self.done)
        return [" ".join(text.format(**numbers).split()) for text in texts]


def parse_errata(entries: object) -> list[Erratum]:
    """Return the entries of a YAML list. Raises ConfigError with the entry and the key."""
    return parsed_entries(Erratum, entries, "erratum")


def errata_page(errata: Sequence[Erratum], run: Run, decided: Sequence[Decided]) -> str:
    """Return ``errata.md`` with the numbers of ``run``, the first that is ``decided``."""
    sections = [TEXTS["errata"]]
    for place, erratum in enumerate(errata, 1):
        numbers = {}
        for name, source in erratum.values.items():
            own = isinstance(source, Reference)
            value = source.look_up(*((run.evidence, run.arm) if own else (decided,)))
            numbers[name] = MISSING if value is None else number(value)
        paper, fact, done = erratum.prose(numbers)
        sections += [
            f'<a id="{erratum.id}"></a>\n\n## {place}. {erratum.title}',
            f"**The paper** ({erratum.place}): {paper}",
            f"**In fact**: {fact}",
            f"**Here**: {done}",
            "\n".join(f"- `{test}`" for test in erratum.tests),
        ]
    return page(sections)
