"""Contradictions and gaps of the paper, each with the fact, what is done here, and the test that
shows it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import sqrt

from pipeline.core.errors import ConfigError
from pipeline.verdicts.decision import Verdict
from pipeline.verdicts.reference import Reference
from pipeline.verdicts.run import Run
from pipeline.verdicts.strict import build
from pipeline.verdicts.wording import number

MISSING = "(not in this dataset)"


@dataclass(frozen=True)
class ClaimNumber:
    """A number of a claim: the ``published`` one, ours (``value``) or their ``distance`` in
    standard errors, in one of its cases; of a variance a step the standard deviation of the sum of
    so many independent ``steps``.
    """

    claim: str
    number: str
    case: str = ""
    steps: int = 0

    def __post_init__(self) -> None:
        if self.number not in ("published", "value", "distance"):
            raise ConfigError(
                f"must be published, value or distance, found {self.number!r}", key="number"
            )

    def look_up(self, verdicts: Sequence[Verdict]) -> float | None:
        """The number, or None where the run has none. Raises ConfigError for a claim or case that
        does not exist.
        """
        cases = {
            case.case: case
            for verdict in verdicts
            if verdict.claim.id == self.claim
            for case in verdict.cases
        }
        if self.case not in cases:
            raise ConfigError(f"no claim {self.claim!r} with the case {self.case!r}", key="values")
        value = getattr(cases[self.case], self.number)
        return sqrt(self.steps * value) if self.steps and value is not None else value


@dataclass(frozen=True)
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
    tests: list
    values: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.tests or not all(isinstance(test, str) and "::" in test for test in self.tests):
            raise ConfigError("must list at least one test as FILE::NAME", key="tests")


def parse_errata(entries: object) -> list[Erratum]:
    """The entries of a YAML list. Raises ConfigError with the entry and the key."""
    if not isinstance(entries, list):
        raise ConfigError("errata must be a list", key="errata")
    return [_parse(entry, number) for number, entry in enumerate(entries, 1)]


def _parse(entry: object, place: int) -> Erratum:
    name = entry.get("id", f"number {place}") if isinstance(entry, dict) else f"number {place}"
    erratum = build(Erratum, entry, erratum=name)
    sources = {
        key: build(
            ClaimNumber if isinstance(source, dict) and "claim" in source else Reference,
            source,
            erratum=name,
            key=key,
        )
        for key, source in erratum.values.items()
    }
    erratum = build(Erratum, entry | {"values": sources}, erratum=name)
    _filled(erratum, dict.fromkeys(sources, ""))
    return erratum


def _filled(erratum: Erratum, numbers: Mapping[str, str]) -> dict[str, str]:
    try:
        return {
            part: getattr(erratum, part).format(**numbers) for part in ("paper", "fact", "done")
        }
    except (KeyError, IndexError, ValueError):
        raise ConfigError(
            "a placeholder in the prose that is not among the values",
            erratum=erratum.id,
            key="values",
        ) from None


@dataclass(frozen=True)
class Corrected:
    """An entry with the numbers of a run and of the claims in its prose."""

    erratum: Erratum
    paper: str
    fact: str
    done: str


def correct(errata: Sequence[Erratum], run: Run, verdicts: Sequence[Verdict]) -> list[Corrected]:
    """Every entry with the numbers of ``run`` and of its ``verdicts``."""

    def corrected(erratum: Erratum) -> Corrected:
        prose = _filled(
            erratum,
            {name: _number(source, run, verdicts) for name, source in erratum.values.items()},
        )
        return Corrected(erratum, **{part: " ".join(text.split()) for part, text in prose.items()})

    return [corrected(erratum) for erratum in errata]


def errata_page(entries: Sequence[Corrected]) -> str:
    """``reports/errata.md``."""
    sections = [
        "# Errata: where the paper contradicts itself, is wrong, or leaves open what decides a "
        "result",
        "Written by the stage `report` from `pipeline/verdicts/errata.yaml`. Numbers of the run "
        "come from `reports/metrics` and "
        "`reports/tables`, published ones from `reports/claims.yaml`. Each entry names the tests "
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


def _number(source: ClaimNumber | Reference, run: Run, verdicts: Sequence[Verdict]) -> str:
    if isinstance(source, ClaimNumber):
        value = source.look_up(verdicts)
    else:
        value = source.look_up(run.evidence, run.arm)
    return MISSING if value is None else number(value)
