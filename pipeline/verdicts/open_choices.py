"""Numbers of the errata on what the paper leaves open: readings of "LU or QR", weight and bound."""

import re
from collections.abc import Sequence

import pandas as pd

from pipeline.verdicts.run import Run
from pipeline.verdicts.tally import Group
from pipeline.verdicts.wording import WORDS, number, say, table

FLOORS = "sigma_b_floors"
UNKNOWN = "no evidence"  # value in the table ``readings``


def errata_details(here: Run, groups: Sequence[Group]) -> dict[str, str]:
    """Return texts with tables by id of the erratum that they belong to, "" without numbers."""
    runs = [here, *_other_robots(here, groups)]
    return {"weights-not-given": floors(here), "which-decomposition": readings(runs)}


def _other_robots(here: Run, groups: Sequence[Group]) -> list[Run]:
    """Return the first run of each group without ``here``."""
    return [
        group.runs[0]
        for group in groups
        if group.runs and here.dataset not in group.verdicts
    ]


def readings(runs: Sequence[Run]) -> str:
    """Return by run the claims whose verdict depends on the reading of "LU or QR" (Eq. LUDecom)."""
    rows = []
    notes = []
    for run in runs:
        readings_of = run.tables.get("readings", pd.DataFrame())
        if len(readings_of):
            rows += _changed_by_reading(run, readings_of)
            notes += _lacking_numbers(run, readings_of)
    if not rows:
        return say("default")
    changed = pd.DataFrame(rows).fillna("")
    header = ["claim (the run's own reading in bold)", *changed.columns[1:]]
    parts = [f"{say('default')} {say('again')}", table(header, changed.to_numpy())]
    return "\n\n".join([*parts, "\n".join(notes)]).rstrip()


def _changed_by_reading(run: Run, readings_of: pd.DataFrame) -> list[dict[str, str]]:
    """Return a row of signs for each claim that another reading decides otherwise."""
    verdicts = readings_of.pivot(index="claim", columns="reading", values="holds")
    in_order = readings_of["reading"].unique()
    verdicts = verdicts[in_order]
    of_run = verdicts[in_order[0]]
    decided = verdicts.ne(UNKNOWN)
    differs = verdicts.ne(of_run, axis=0) & decided
    changes = differs.any(axis=1) & of_run.ne(UNKNOWN)
    rows = []
    for claim, words in verdicts[changes].iterrows():
        signs = words.map(WORDS["signs"])
        signs.iloc[0] = f"**{signs.iloc[0]}**"
        rows.append({"claim": claim, "dataset": run.dataset, **signs})
    return rows


def _lacking_numbers(run: Run, readings_of: pd.DataFrame) -> list[str]:
    """Return a note for each reading under which claims lack numbers."""
    refused = readings_of["refused"].astype(object).fillna("")
    undecided = readings_of["holds"].eq(UNKNOWN)
    lacking = readings_of[undecided & refused.ne("")]
    by_reading = lacking.groupby("reading", sort=False)
    notes = []
    for reading, reasons in by_reading["refused"]:
        reason = re.split(r" \[|;", reasons.iloc[0])[0]
        count = f"{len(reasons)} claims lack numbers"
        notes.append(f"- {run.dataset}, {reading}: {count} ({reason}).")
    return notes


def floors(here: Run) -> str:
    """Return σ̂_B of the printed problem over the bound ε and the weight, "" without its table."""
    rows = here.tables.get(FLOORS, pd.DataFrame())
    fitted = here.metrics.get("fit_wishart", {})
    if not len(rows) or "sigma_b_about_the_sample_mean" not in fitted:
        return ""
    if "model" in rows:  # of several Wishart models the first
        rows = rows[rows["model"] == rows["model"].iloc[0]]
    by_floor = rows.pivot(index="ratio", columns="floor", values="sigma_b")
    by_floor = by_floor[sorted(by_floor, reverse=True)]
    header = ["weight α₂/α₁ (rad)"]
    header += [f"ε = {floor:g}" for floor in by_floor]
    cells = []
    for ratio, of_weight in by_floor.iterrows():
        values = [ratio, *of_weight]
        cells.append([number(value, 3) for value in values])
    means = []
    for key, value in fitted.items():
        if key.startswith("fitted_mean_of_b"):
            means.append(number(value, 3))
    sample = number(fitted["sigma_b_about_the_sample_mean"], 2)
    sentences = say("floors", means=means, sample=sample)
    return f"{sentences}\n\n{table(header, cells)}"
