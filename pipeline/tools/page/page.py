"""The pages of results: everything that a run yields, the studies, and as a script what the player
shows.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from pipeline.tools.page.graph import HEIGHT, WIDTH, Drawing
from pipeline.tools.page.illustrations import Illustration, Table
from pipeline.tools.page.player import Player
from pipeline.tools.page.provenance import Costs
from pipeline.tools.page.stages import Stage, StageRun
from pipeline.tools.page.study_pages import StudyPage
from pipeline.verdicts.decision import (
    NO_EVIDENCE,
    NOT_REPRODUCED,
    REPRODUCED,
    SYNTHETIC_CANNOT,
    Decided,
    Verdict,
)
from pipeline.verdicts.errata import Corrected
from pipeline.verdicts.wording import (
    ARM_OF_THE_PAPER,
    GROUPS,
    WHOSE,
    case_text,
    distance_rows,
    measured,
    number,
    published,
    side_by_side,
)

TEMPLATES = Path(__file__).parent / "templates"
# sign and name of the style of each verdict
MARKS = {
    REPRODUCED: ("✓", "yes"),
    NOT_REPRODUCED: ("✗", "no"),
    SYNTHETIC_CANNOT: ("?", "open"),
    NO_EVIDENCE: ("–", "none"),
}


@dataclass(frozen=True)
class Content:
    """All that the page shows.

    ``outputs`` and ``recordings`` are the runs of the pipelines and of the recordings' own, whose
    hashes are listed; ``requirements`` is the hash of the lock of the libraries.
    """

    dataset: str
    scale: str
    decided: Sequence[Decided]
    player: Player | None
    illustrations: Sequence[Illustration]
    studies: Sequence[StudyPage]
    errata: Sequence[Corrected]
    stages: Sequence[Stage]
    drawing: Drawing
    tables: Sequence[Table]
    options: Mapping[str, object]
    outputs: Sequence[StageRun]
    recordings: Sequence[StageRun]
    libraries: Mapping[str, str]
    requirements: str
    costs: Costs


def render(content: Content) -> str:
    """The page as HTML."""
    groups = [
        (about, *texts, side_by_side(content.decided, about)) for about, texts in GROUPS.items()
    ]
    return _filled(
        "index.html",
        content=content,
        groups=groups,
        marks=MARKS,
        whose=WHOSE,
        of_planar_arms=ARM_OF_THE_PAPER,
        distances=distance_rows(content.decided),
        box=(WIDTH, HEIGHT),
    )


def render_studies(studies: Sequence[StudyPage]) -> str:
    """The page of the ``studies`` as HTML."""
    return _filled("studies.html", studies=studies)


def _filled(template: str, **values: object) -> str:
    """The ``template`` with ``values``, and in it our own style and script as they are."""
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES, encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "beside": beside,
        "brief": brief,
        "number": number,
        "case_text": case_text,
        "measured": measured,
        "published": published,
    }
    style, script = (
        Markup((TEMPLATES / name).read_text(encoding="utf-8")) for name in ("style.css", "page.js")
    )
    return environment.get_template(template).render(style=style, script=script, **values)


def player_script(player: Player | None) -> str:
    """The script beside the page that holds what its player shows: the frames, and of each plot by
    its id the outlines of its shapes; null where nothing is played.
    """
    played = None
    if player:
        plots = {"play-joints": player.angles}
        plots |= {f"play-error-{model}": plot for model, plot in player.errors.items()}
        plots |= {f"play-spread-{model}": plot for model, plot in player.spreads.items()}
        paths = {
            name: [s.path for p in plot.panels for s in p.shapes] for name, plot in plots.items()
        }
        played = {"frames": player.frames, "paths": paths}
    text = json.dumps(played, separators=(",", ":"), ensure_ascii=False)
    return f"window.played = {text};\n"


def beside(file: Path) -> str:
    """The address of a file of the project from the page, which lies in the reports."""
    path = file.as_posix()
    return path.removeprefix("reports/") if path.startswith("reports/") else f"../{path}"


def brief(verdict: Verdict) -> str:
    """The numbers of a claim in a few words: its value, or in how many cases its test holds; none
    where they say nothing about it.
    """
    known = [case for case in verdict.cases if case.holds is not None]
    if not known or verdict.verdict == NO_EVIDENCE:
        return ""
    if len(verdict.cases) == 1:
        return case_text(known[0])
    return f"holds in {sum(bool(case.holds) for case in known)} of {len(known)} cases"
