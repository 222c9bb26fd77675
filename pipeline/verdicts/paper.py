"""Items of the paper (equations, definitions, theorems, algorithms, figures) and its errata.

The code of an item is every public function, class or method whose docstring cites the item.
Equations and figures are cited by label in parentheses, as (NormStd) or (cost)–(const2), other
items by kind and number, as Theorem 3.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from math import sqrt
from pathlib import Path
from typing import Literal, NamedTuple

import pandas as pd
from pydantic import Field

from pipeline.core.errors import ConfigError
from pipeline.core.validation import options
from pipeline.verdicts.decision import NO_RECORDING, Decided
from pipeline.verdicts.encoders import encoder_noise, std_texts
from pipeline.verdicts.run import (
    ArmNames,
    Reference,
    Run,
    TestName,
    filled,
    index_evidence,
    parse_entries,
)
from pipeline.verdicts.wording import number, render, worded

LABELLED = {"equation": "Eq.", "figure": "Fig."}
NUMBERED = {"definition": "Definition", "theorem": "Theorem", "algorithm": "Algorithm"}
LABEL = r"\(([A-Za-z][\w-]*)\)"
CITED = re.compile(rf"((?:Eqs?|Figs?)\. )?{LABEL}(?:–{LABEL})?")
CITED_BY_NUMBER = re.compile(rf"\b(?:{'|'.join(NUMBERED.values())}) \d+")
MISSING = "(not in this dataset)"
# M of the paper's motion, and its steps in a second
STEPS = 320
RATE = 100
# on the root of a variance of a step
FACTORS = {
    "std": 1,
    "speed": RATE,
    "walk": sqrt(STEPS),
}


@options(frozen=True)
class Item:
    """One item: ``place``, content (``says``), ``tests`` or the reason why it is ``without_code``.

    ``label`` is the paper's label; a label with a hyphen is ours, for an equation without a label.
    ``number`` counts the items of a kind as the paper does. Raises ConfigError with the key.
    """

    kind: Literal["equation", "figure", "definition", "theorem", "algorithm"]
    place: str
    says: str
    label: str = ""
    tests: list[TestName] = field(default_factory=list)
    without_code: str = ""
    number: int = 0

    def __post_init__(self) -> None:
        if bool(self.label) != (self.kind in LABELLED):
            raise ConfigError(
                "an equation or figure needs a label, other items none",
                key="label",
            )
        if bool(self.tests) == bool(self.without_code):
            message = "an item needs either tests or without_code, not both"
            raise ConfigError(message, key="tests")

    @property
    def cited_as(self) -> str:
        """Words that cite the item in a docstring, without the parentheses of a label."""
        return self.label or f"{NUMBERED[self.kind]} {self.number}"

    @property
    def title(self) -> str:
        """Name of the item on the page."""
        labelled = LABELLED.get(self.kind)
        return (
            f"{labelled} {self.number} ({self.label})" if self.label else self.cited_as
        )

    @property
    def short(self) -> str:
        """Kind and number in the paper, as Fig. 7."""
        return f"{LABELLED.get(self.kind, NUMBERED.get(self.kind))} {self.number}"


class Source(NamedTuple):
    """A function, class or method, and its ``file``."""

    name: str
    file: Path


def parse_items(entries: object) -> list[Item]:
    """Return the items of a YAML list, numbered by kind; raises ConfigError with item and key."""
    counted = Counter()
    items = []
    for item in parse_entries(Item, entries, "item", "label"):
        counted[item.kind] += 1
        items.append(replace(item, number=counted[item.kind]))
    return items


def cited_items(docstring: str, items: Sequence[Item], **place: object) -> set[str]:
    """Return :attr:`Item.cited_as` of the items that ``docstring`` cites; raises ConfigError with
    the ``place`` if the paper lacks a cited number, or a label after "Eq." or "Fig.".
    """
    known = [item.cited_as for item in items]
    names = set(CITED_BY_NUMBER.findall(docstring))
    for prefix, first, last in CITED.findall(docstring):
        last = last or first
        if first in known and last in known:
            names |= set(known[known.index(first) : known.index(last) + 1])
        elif prefix:
            names |= {first, last}
    for name in sorted(names - set(known)):
        message = f"a docstring cites {name}, which the paper does not have"
        raise ConfigError(message, **place, key=name)
    return names


def citations(
    package: Path,
    items: Sequence[Item],
    without: Sequence[str] = (),
) -> dict[str, list[Source]]:
    """Return the sources in ``package`` that cite each item, except in the folders ``without``."""
    sources: dict[str, list[Source]] = {item.cited_as: [] for item in items}
    for file in sorted(package.rglob("*.py")):
        if file.relative_to(package).parts[0] in without:
            continue
        module = ".".join(file.relative_to(package.parent).with_suffix("").parts)
        for name, docstring in _documented(
            ast.parse(file.read_text(encoding="utf-8")),
            module,
        ):
            for item in cited_items(docstring, items, file=file, name=name):
                sources[item].append(Source(name, file))
    return sources


def _documented(
    tree: ast.Module | ast.ClassDef,
    owner: str,
) -> Iterator[tuple[str, str]]:
    """Yield dotted name and docstring of every public function, class and method."""
    for node in tree.body:
        if isinstance(
            node,
            ast.FunctionDef | ast.ClassDef,
        ) and not node.name.startswith("_"):
            yield (name := f"{owner}.{node.name}"), ast.get_docstring(node) or ""
            if isinstance(node, ast.ClassDef):
                yield from _documented(node, name)


def equations_page(
    items: Sequence[Item],
    sources: Mapping[str, Sequence[Source]],
) -> str:
    """Return ``reports/equations.md``, each item with the ``sources`` of :func:`citations`."""
    rows = []
    for item in items:
        code = [
            f"[`{source.name}`](../{source.file.as_posix()})"
            for source in sources[item.cited_as]
        ]
        tests = []
        for test in item.tests:
            file, _, name = test.partition("::")
            tests.append(f"[`{name}`](../{file})")
        places = "<br>".join(code) or f"no code: {item.without_code}"
        rows.append((item.title, item.place, item.says, places, "<br>".join(tests)))
    return render("equations.md", rows=rows)


@options(frozen=True)
class Erratum:
    """One erratum: ``place`` and content of the ``paper``, the ``fact``, the remedy ``done`` here,
    and ``tests``. The prose is a Jinja template with the numbers of :func:`errata_page`.
    """

    id: str
    title: str
    place: str
    paper: str
    fact: str
    done: str
    tests: list[TestName] = Field(min_length=1)


def parse_errata(entries: object) -> list[Erratum]:
    """Return the errata of a YAML list; raises ConfigError with the erratum and the key."""
    return parse_entries(Erratum, entries, "erratum")


def errata_page(
    errata: Sequence[Erratum],
    run: Run,
    decided: Sequence[Decided],
    runs: Sequence[Run] = (),
    details: Mapping[str, str] | None = None,
) -> str:
    """Return ``errata.md`` with the numbers of ``run``, the first of the ``decided`` datasets, and
    of the other ``runs`` (:func:`errata_numbers`), and with the ``details`` by id of the erratum;
    raises ConfigError with the erratum for prose that is not a template of these numbers.
    """
    numbers = errata_numbers(run, decided) | numbers_of_runs(runs, run.arm)
    texts = []
    for erratum in errata:
        stated = (erratum.paper, erratum.fact, erratum.done)
        try:
            texts.append((erratum, *(worded(text, **numbers) for text in stated)))
        except (TypeError, ConfigError) as error:
            message = (
                f"the prose has a number that does not exist ({error}); correct it"
            )
            raise ConfigError(message, erratum=erratum.id) from None
    return render("errata.md", errata=texts, details=details or {})


def errata_numbers(run: Run, decided: Sequence[Decided]) -> dict[str, object]:
    """Return what the prose of the errata may name of ``run``, as functions and texts.

    Metrics of a file by key, rows of ``evidence``, the noise ``level`` of the published α and u,
    the number of ``repeats`` of the study of the wrench, and of a case of a claim the published
    number, ours or their distance. From a published variance of a step follow its std, the speed of
    RATE such steps in a second, and walk, the std of a sum of STEPS independent steps.
    """
    rows = index_evidence(run.evidence)
    names = run.arm.numbered
    cases = {}
    for claim, verdict, of_claim in (*decided[0].verdicts, *decided[-1].verdicts):
        if verdict != NO_RECORDING:
            cases |= {f"{claim.id} {case.case}".strip(): case for case in of_claim}
    published = {key: case.published for key, case in cases.items()}
    levels = noise_levels(run.metrics.get("fit_gaussian", {}), published)
    study = run.tables.get("wrench_study", pd.DataFrame(columns=["repeats"]))

    def metric(file: str, key: str) -> str:
        return _shown(run.metrics.get(file, {}).get(filled(key, names)))

    def evidence(*keys: str, **named: str) -> str:
        return _shown(Reference(*keys, **named).look_up(rows, names))

    def claim(case: str, name: str = "published") -> str:
        if name in FACTORS and published.get(case) is not None:
            return _shown(FACTORS[name] * sqrt(published[case]))
        return _shown(getattr(cases.get(case), name, None))

    return {
        "metric": metric,
        "evidence": evidence,
        "level": lambda name: _shown(levels.get(name)),
        "repeats": _shown(next(iter(study["repeats"]), None)),
        "claim": claim,
    }


def numbers_of_runs(runs: Sequence[Run], arm: ArmNames) -> dict[str, object]:
    """Return what the prose of the errata may name of several ``runs``: a metric of the recordings
    under each of the ``causes`` of the paper's arm, and ``encoders``, the standard deviations in
    mrad of a step by the encoders of a real arm with the joints of ``arm``; "" without such runs.
    """

    def causes(key: str) -> str:
        texts = []
        for run in runs:
            value = run.metrics.get("recordings", {}).get(filled(key, run.arm.numbered))
            if run.cause and value is not None:
                texts.append(f"{number(value, 3)} ({run.cause})")
        return ", ".join(texts)

    joints = arm.joints if arm.numbered else ()
    encoders = std_texts(encoder_noise(runs, joints), joints)
    return {"causes": causes, "encoders": encoders}


def _shown(value: float | None) -> str:
    return MISSING if value is None else number(value)


def noise_levels(
    fitted: Mapping[str, float],
    published: Mapping[str, float],
) -> dict[str, float]:
    """Return the noise level L = α√(u² − ⟨‖J⁺‖²⟩) of the published α and u over the poses of a fit
    (``published``), the fitted L over it (``ratio``), and the scale ``alpha`` and the product
    ``alpha_u`` that give the fitted L at the published u. Empty for a u below the norm.
    """
    level = fitted.get("noise_level")
    norm = fitted.get("rms_norm_of_the_inverse_jacobian")
    alpha, u = (published.get(name) for name in ("alpha", "u"))
    if None in (level, norm, alpha, u) or u <= norm:
        return {}
    reach = sqrt(u**2 - norm**2)
    numbers = {"published": alpha * reach, "ratio": level / (alpha * reach)}
    return numbers | {"alpha": level / reach, "alpha_u": level * u / reach}
