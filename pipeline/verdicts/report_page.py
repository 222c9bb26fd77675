"""The report: what holds of the paper's claims and what does not, its numbers beside ours, its
figures and errata, on one short page.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from pipeline.verdicts.claims import ABOUT, Claim
from pipeline.verdicts.decision import (
    NO_EVIDENCE,
    NOT_REPRODUCED,
    REPRODUCED,
    SYNTHETIC_CANNOT,
    Case,
    Decided,
    Verdict,
)
from pipeline.verdicts.equations import Item, Source
from pipeline.verdicts.errata import Erratum
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import (
    ARM_OF_THE_PAPER,
    GROUPS,
    WHOSE,
    case_text,
    number,
    side_by_side,
    table,
)

MARKS = {REPRODUCED: "✓", NOT_REPRODUCED: "✗", SYNTHETIC_CANNOT: "?", NO_EVIDENCE: "–"}
# what a stage counts because it was not solved, lost, clipped or left out
LOST = re.compile(r"lost|clipped|without|outside|_on_the_bound|end_of_its_interval")
LINKS = """\
- Which model to use for this arm, where and how surely: [model_card.md](model_card.md).
- Claims: [claims.yaml](claims.yaml) states each with its test and the reason for it,
  [claims.json](claims.json) has verdicts with all numbers and the command that recomputes them.
- The paper, item by item: [equations.md](equations.md) says where each is in code and tests.
- Numbers of this run: [metrics](metrics), [tables](tables); of every dataset: [datasets](datasets).
- What goes beyond the paper, a page each: [studies](studies) (`dvc repro -P`).
- Recordings: [dataset_card.md](dataset_card.md). Speed: [benchmarks.md](benchmarks.md).
- In a browser: [index.html](index.html); the studies: [studies.html](studies.html)."""


def report_page(
    here: Run, decided: Sequence[Decided], first: str, parts: Sequence[tuple[str, str]]
) -> str:
    """``reports/report.md`` of the run ``here``: what a reader has to know ``first``, the tally of
    all datasets, then ``parts``, each a heading and its text; what has no text is left out.
    """
    sections = [
        f"# Results: dataset {here.dataset}, scale {here.scale}",
        "Written by the stage `report`. Every number is read from a file: ours from what stages "
        "wrote, published ones from [claims.yaml](claims.yaml).",
        *filter(None, [first]),
        tally(decided),
    ]
    sections += [f"## {title}\n\n{text}" for title, text in parts if text]
    return "\n\n".join(sections) + "\n"


def tally(decided: Sequence[Decided]) -> str:
    """Claims that hold, fail and stay undecided, by dataset and by what they are about."""
    rows = [
        [
            f"**{whose.dataset}**, {WHOSE[whose.recordings]}",
            *(_counted([v for v in whose.verdicts if v.claim.about == about]) for about in ABOUT),
            _counted(whose.verdicts),
        ]
        for whose in decided
    ]
    kinds = "\n".join(f"- {GROUPS[about][1]}" for about in ABOUT)
    header = ["recordings", *(f"about the {about}" for about in ABOUT), "all"]
    return f"Claims held / failed / undecided:\n\n{table(header, rows)}\n\n{kinds}"


def _counted(verdicts: Sequence[Verdict]) -> str:
    verdict = [each.verdict for each in verdicts]
    held, failed = verdict.count(REPRODUCED), verdict.count(NOT_REPRODUCED)
    return f"{held} / {failed} / {len(verdict) - held - failed}"


def not_reproduced(decided: Sequence[Decided]) -> str:
    """A row for each claim that fails in some dataset: its test, the cases that fail there, and the
    reason where one is written.
    """
    rows = []
    for verdicts in zip(*(whose.verdicts for whose in decided), strict=True):
        claim = verdicts[0].claim
        failing = {
            whose.dataset: ", ".join(_values(case) for case in verdict.cases if case.holds is False)
            for whose, verdict in zip(decided, verdicts, strict=True)
            if verdict.verdict == NOT_REPRODUCED
        }
        if failing:
            reasons = dict.fromkeys(claim.why.get(name, "not known") for name in failing)
            rows.append(
                [
                    f"{claim.statement} ({claim.where})",
                    f"{claim.quantity}: {claim.test}",
                    "<br>".join(f"**{name}** {values}" for name, values in failing.items()),
                    "<br>".join(reasons),
                ]
            )
    return table(["claim", "test", "where it fails", "reason"], rows) if rows else ""


def _values(case: Case) -> str:
    return case_text(case).removesuffix(" ✗")


def published_and_ours(decided: Sequence[Decided]) -> str:
    """A row for each number that the paper publishes: its value beside that of the run and of every
    dataset that has such numbers of its own recordings.
    """
    rows, decided = [], [decided[0], *filter(_has_numbers, decided[1:])]
    for verdicts in zip(*(whose.verdicts for whose in decided), strict=True):
        claim = verdicts[0].claim
        if not claim.parameter:
            continue
        for cases in zip(*(verdict.cases for verdict in verdicts), strict=True):
            if any(case.value is not None for case in cases):
                unit = f" ({claim.unit})" if claim.unit else ""
                name = ", ".join(filter(None, [claim.parameter, cases[0].case]))
                printed = number(cases[0].published)
                place = claim.where.partition(",")[0]
                rows.append([name + unit, place, printed, *map(_value, cases)])
    header = ["", "place", "published", *(whose.dataset for whose in decided)]
    return f"In brackets 95 % intervals.\n\n{table(header, rows)}"


def _has_numbers(whose: Decided) -> bool:
    """Whether something that the paper publishes of its recordings was measured in these."""
    own = [each for each in whose.verdicts if each.claim.parameter and each.claim.about != "method"]
    return any(case.value is not None for each in own for case in each.cases)


def _value(case: Case) -> str:
    return "–" if case.value is None else case_text(replace(case, case="", than=None, holds=None))


def every_claim(decided: Sequence[Decided], readings: str) -> str:
    """A row for each claim with its verdict in every dataset as a sign, and what
    :func:`pipeline.verdicts.readings.readings_part` says of the others.
    """
    rows = [
        [_stated(claim), claim.where, about, *(MARKS[verdict.verdict] for verdict in verdicts)]
        for about in ABOUT
        for claim, verdicts in side_by_side(decided, about)
    ]
    signs = ", ".join(f"{mark} {verdict}" for verdict, mark in MARKS.items())
    header = ["claim", "place", "about the", *(whose.dataset for whose in decided)]
    return f"{signs}.\n\n{table(header, rows)}\n\n{readings}"


def _stated(claim: Claim) -> str:
    """The statement of ``claim``, marked where it can hardly fail and where not every arm is
    evidence.
    """
    mark = f" *Can hardly fail: {claim.foregone}.*" if claim.foregone else ""
    mark += f" *{ARM_OF_THE_PAPER}*" if claim.numbers_joints else ""
    return claim.statement + mark


def kept(run: Run) -> str:
    """What ``run`` found in the recordings, step by step, what it kept, and what it left out."""
    if "kept" not in run.tables:
        return ""
    rows = run.tables["kept"].astype(object).fillna("").astype(str).to_numpy().tolist()
    return table(["step", "recording", "found", "kept", "left out"], rows)


def counts(run: Run) -> str:
    """What was not solved, lost, clipped or repaired in ``run``, where that is not zero."""
    rows = []
    if "recording_quality" in run.tables:
        counted = run.tables["recording_quality"].dropna(subset="total")
        for instrument, quantities in counted[counted["total"] > 0].groupby("instrument"):
            texts = zip(quantities["quantity"], quantities["total"], strict=True)
            rows.append([instrument, ", ".join(_count(name, total) for name, total in texts)])
    for stem, values in run.metrics.items():
        lost = [
            _count(name, value)
            for name, value in values.items()
            if value and LOST.search(name) and float(value).is_integer()
        ]
        if lost and stem != "recordings":
            rows.append([stem.replace("_", " of ", 1), ", ".join(lost)])
    text = (
        "Totals over all takes of what was lost, clipped or repaired; what is not named was zero."
    )
    return f"{text}\n\n{table(['', 'counted'], rows)}" if rows else ""


def _count(name: str, value: float) -> str:
    return f"{name.replace('_', ' ')} {number(value)}"


def figures(
    captions: Mapping[str, Mapping], items: Sequence[Item], sources: Mapping[str, Sequence[Source]]
) -> str:
    """The figures of ``captions`` (``captions.json``): those of the paper in its order, then ours;
    ``sources`` of :func:`pipeline.verdicts.equations.citations` say which is which.
    """
    drawn = {
        source.file.as_posix(): item.title
        for item in items
        if item.kind == "figure"
        for source in sources[item.cited_as]
    }
    order = list(drawn)
    scripts = {name: caption["script"] for name, caption in captions.items()}
    ordered = sorted(
        captions,
        key=lambda name: order.index(scripts[name]) if scripts[name] in drawn else len(order),
    )
    return "\n\n".join(
        f"![{captions[name]['title']}](figures/{name}.png)\n\n"
        f"**{drawn.get(scripts[name], 'Not in the paper')}. {captions[name]['title']}.** "
        f"{short(captions[name]['caption'])} ([{scripts[name]}](../{scripts[name]}))"
        for name in ordered
    )


def short(caption: str) -> str:
    """The first sentence of a caption, and what it says to look at."""
    sentences = re.split(r"(?<=[.!?]) (?=[A-Z(])", caption)
    return " ".join(
        [sentences[0], *(text for text in sentences[1:] if text.startswith("To look at"))]
    )


def errata_titles(errata: Sequence[Erratum]) -> str:
    """The titles of ``errata`` as links to their entries in ``errata.md``."""
    return "\n".join(
        f"{place}. [{erratum.title}](errata.md#{erratum.id})"
        for place, erratum in enumerate(errata, 1)
    )
