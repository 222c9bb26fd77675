"""Pages beside the report: every claim in every dataset, and the recordings of one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from pipeline.verdicts.decision import FORCED, Decided
from pipeline.verdicts.report_page import MARKS, TEXT, counted
from pipeline.verdicts.run import Run
from pipeline.verdicts.wording import TEXTS, number, page, table

WHOSE = {
    "none": "computations without a recording",
    "synthetic": "synthetic recordings",
    "real": "recordings of a real robot, not the paper's",
    "paper": "the paper's own recordings",
}
# counts of what was not solved, lost, clipped or left out
LOST = re.compile(r"lost|clipped|without|outside|_on_the_bound|end_of_its_interval")


def datasets_page(decided: Sequence[Decided]) -> str:
    """Return ``reports/datasets.md``: the verdict on every claim from every dataset as a sign."""
    decided = sorted(decided, key=lambda whose: (whose.recordings == "none", whose.dataset))
    claims = zip(*(whose.verdicts for whose in decided), strict=True)
    rows = [[row[0].claim.id, *(MARKS[each.verdict] for each in row)] for row in claims]
    tally = [
        [n, WHOSE[recordings], counted(own), sum(each.verdict == FORCED for each in own)]
        for n, recordings, own in decided
    ]
    head = ["# Every claim in every dataset", TEXTS["datasets"]]
    head.append(table(["dataset", "recordings", "hold / fail", "by construction"], tally))
    return page([*head, table(["claim", *(w.dataset for w in decided)], rows), TEXT["key"]])


def recordings_page(run: Run) -> str:
    """Return ``recordings.md``: recordings kept and left out, and nonzero totals of losses."""
    sections, rows = {}, []
    if "kept" in run.tables:
        kept = run.tables["kept"].astype(object).fillna("").astype(str).to_numpy()
        header = ["step", "recording", "found", "kept", "left out"]
        sections["Kept and left out"] = table(header, kept)
    if "recording_quality" in run.tables:
        lossy = run.tables["recording_quality"].query("total > 0").set_index("quantity")
        rows += [[name, _counts(own["total"])] for name, own in lossy.groupby("instrument")]
    for stem, values in run.metrics.items():
        lost = {n: v for n, v in values.items() if v and LOST.search(n) and float(v).is_integer()}
        if lost and stem != "recordings":
            rows.append([stem.replace("_", " of ", 1), _counts(lost)])
    if rows:
        sections["Lost and repaired"] = f"{TEXTS['recordings']}\n\n{table(['', 'counted'], rows)}"
    return page([f"# Recordings of dataset {run.dataset}"], sections)


def _counts(totals: Mapping[str, float]) -> str:
    return ", ".join(f"{n.replace('_', ' ')} {number(total)}" for n, total in totals.items())
