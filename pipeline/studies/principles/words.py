"""The page of the study: the laboratory's principles, each with its number."""

from __future__ import annotations

import pandas as pd

from pipeline.studies import page
from pipeline.verdicts.wording import table

TITLE = "What the synthetic laboratory was made by"
RECORDED = "The dataset is recorded: there is no laboratory."


def sections(principles: pd.DataFrame | None) -> list[str]:
    """The page's sections, from the table ``principles``."""
    if principles is None:
        return [RECORDED]
    return [
        "The laboratory stands for a robot whose recordings nobody has. Its arm follows its "
        "command with a servo, its tool sways as its drives pass a disturbance on, and its "
        "last joint has play. Path and sizes were set in this order: the path, from the "
        "robot's limits, the published bound on the inverse Jacobian and the published "
        "covariance of the additive noise; the sizes of sway and play, from that covariance; "
        "how long a deviation lasts, from what the motors can drive. The Wishart model had "
        "not been fitted to this laboratory then; the Gaussian one had, once, before the sway "
        "was slowed by an eighth for the torques' sake and its size raised as much. Earlier "
        "laboratories of this project were tuned with all fitted parameters in view.",
        f"## {_kept(principles)}",
        table(
            ["principle", "quantity", "unit", "limit or published", "laboratory", "kept"],
            [_cells(row) for row in principles.itertuples(index=False)],
        ),
        page.figure("principles", "principles"),
        "## What stays free",
        "The share of rest, which is a factor of every mean over the steps; how long a "
        "deviation lasts, which decides what a filter can gain; and the power of the speed "
        "that sway and play grow with, which decides whether their spread follows the motion "
        "at all. None of the three is published, and the survey varies them. The sway goes to "
        "the joints through the inverse Jacobian, so it is shaped like a matrix model's "
        "noise: what follows from that is a property of the laboratory and not of the method.",
    ]


def _kept(principles: pd.DataFrame) -> str:
    """How many of the rows that are held against something are kept."""
    held = principles.dropna(subset="limit")
    return f"{int(held['kept'].sum())} of {len(held)} numbers are within their limits"


def _cells(row) -> list[str]:
    bounded = pd.notna(row.limit)
    kept = ("yes" if row.kept else "**no**") if bounded else "free"
    limit = page.number(row.limit) if bounded else "–"
    return [row.principle, row.quantity, row.unit, limit, page.number(row.value), kept]
