"""One page of everything a run found, in one file that needs no other."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from pipeline.audit.claims import NO_EVIDENCE, NOT_REPRODUCED, REPRODUCED, SYNTHETIC_CANNOT, Verdict
from pipeline.audit.comparison import Comparison
from pipeline.audit.errata import Corrected
from pipeline.audit.results import number
from pipeline.audit.verdicts import GROUPS, WHOSE, Decided, case_text, distance_rows, measured, published, side_by_side
from pipeline.report.graph import HEIGHT, WIDTH, Drawing, Stage
from pipeline.report.illustrations import Download, Illustration
from pipeline.report.player import library
from pipeline.report.provenance import Costs, Output
from pipeline.report.sensitive import Changes

TEMPLATES = Path(__file__).parent / "templates"
# sign and name of the style of each verdict
MARKS = {REPRODUCED: ("✓", "yes"), NOT_REPRODUCED: ("✗", "no"), SYNTHETIC_CANNOT: ("?", "open"), NO_EVIDENCE: ("–", "none")}
SHOWN = 60  # rows of a table that are on the page to be read


@dataclass(frozen=True)
class Table:
    """A small table of the reports: its download, and its first rows as texts."""

    download: Download
    header: list[str]
    rows: list[list[str]]


@dataclass(frozen=True)
class Content:
    """All that the page shows."""

    dataset: str
    scale: str
    decided: Sequence[Decided]
    comparisons: Sequence[Comparison]
    player: Mapping | None
    illustrations: Sequence[Illustration]
    changes: Changes | None
    errata: Sequence[Corrected]
    stages: Sequence[Stage]
    drawing: Drawing
    tables: Sequence[Table]
    options: Mapping[str, object]
    outputs: Sequence[Output]
    recordings: Sequence[Output]
    libraries: Mapping[str, str]
    requirements: str
    costs: Costs


def readable(download: Download, rows: pd.DataFrame) -> Table:
    """``rows``, of which the first are shown, with their download."""
    texts = rows.head(SHOWN).map(lambda cell: number(cell) if isinstance(cell, int | float) and not isinstance(cell, bool) else str(cell))
    return Table(download, [str(name).replace("_", " ") for name in rows.columns], texts.to_numpy().tolist())


def render(content: Content) -> str:
    """The page as HTML."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES, encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"brief": brief, "number": number, "case_text": case_text, "measured": measured, "published": published}
    groups = [(about, *texts, side_by_side(content.decided, about)) for about, texts in GROUPS.items()]
    return environment.get_template("index.html").render(
        content=content,
        groups=groups,
        marks=MARKS,
        whose=WHOSE,
        distances=distance_rows(content.decided),
        box=(WIDTH, HEIGHT),
        # our own files and the library's stand in the page as they are
        style=Markup(_template("style.css")),
        script=Markup(_template("player.js")),
        library=Markup(library()) if content.player else "",
        played=_inside_script(content.player),
    )


def brief(verdict: Verdict) -> str:
    """The numbers of a claim in a few words: its value, or in how many cases its test holds; none where they say nothing about it."""
    known = [case for case in verdict.cases if case.holds is not None]
    if not known or verdict.verdict == NO_EVIDENCE:
        return ""
    if len(verdict.cases) == 1:
        return case_text(known[0])
    return f"holds in {sum(bool(case.holds) for case in known)} of {len(known)} cases"


def _template(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def _inside_script(values: object) -> Markup:
    """JSON that cannot end the element it stands in."""
    return Markup(json.dumps(values, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c"))
