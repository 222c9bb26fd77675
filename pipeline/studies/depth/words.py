"""The page of the study: the slopes of the depth camera's error, and the filters, either end."""

from __future__ import annotations

import pandas as pd

from pipeline.perception.depth_state import NEAR_A_SAMPLE
from pipeline.studies import page
from pipeline.verdicts.wording import table

TITLE = "Whether the depth camera's error depends on the state"
NOTHING = "The dataset has no depth camera."
CERTAIN = 2.0  # standard errors from zero
ASKED = """The paper's articulation takes the end-effector, where the segment of the tool ends, from
the trajectory that was commanded. An arm that deviates from it is then fitted with an end where it
is not, and the error of the joint angles holds the deviation. Here the end is fitted from the
points as well (`fitted_end`), and both are compared on the same frames."""
SLOPES = """Slope of the error on the deviation, ± its standard error; 0 where the error does not
depend on the state, −1 where the camera does not see a deviation at all. The first column of either
end is over the frames near a sample of the motion capture. Between samples a line stands for the
deviation, and where deviations do not last as long as a step that alone makes a slope: the column
of all frames has both."""
FILTERED = """The particle filter of the additive model, whose measurement is the pose plus noise
that does not depend on it: rms error, mean standard deviation, share of poses within one."""


def sections(
    error_slopes: pd.DataFrame, error_bins: pd.DataFrame, filters: pd.DataFrame | None = None
) -> list[str]:
    """The page's sections from the study's tables; ``error_bins`` are beside it, as they are."""
    parts = [ASKED, "## Answer", _answer(error_slopes), page.figure("depth", "depth_error")]
    parts += ["## Slopes", SLOPES, _slopes(error_slopes)]
    parts.append(f"What the figure shows is in {page.write_csv(error_bins, 'depth', 'bins')}.")
    if filters is not None and len(filters):
        parts += ["## Filters", FILTERED, _filters(filters)]
    return parts


def _answer(slopes: pd.DataFrame) -> str:
    """One sentence an end on the slopes, and one on what the fitted end costs."""
    texts = []
    near = slopes[slopes["frames"] == NEAR_A_SAMPLE]
    for end, rows in near.groupby("end", sort=False):
        certain = rows[rows["slope"] + CERTAIN * rows["standard_error"] < 0]
        texts.append(
            f"With the {end} end the error falls with the deviation, by more than {CERTAIN:g} "
            f"standard errors, in {len(certain)} of {len(rows)} joints; the steepest slope is "
            f"{page.number(rows['slope'].min())}."
        )
    scatter = near.set_index(["end", "joint"])["scatter"].unstack("end")
    ratio = scatter["fitted"] / scatter["commanded"]
    texts.append(
        "The scatter of the errors with the fitted end is "
        f"{page.listed([page.number(value) for value in ratio])} times that with the commanded one "
        f"in {page.listed(list(ratio.index))}."
    )
    return " ".join(texts)


def _slopes(slopes: pd.DataFrame) -> str:
    rows = []
    for joint, own in slopes.groupby("joint", sort=False):
        for end, both in own.groupby("end", sort=False):
            cells = both.set_index("frames")
            slope = [
                f"{page.number(row.slope)} ± {page.number(row.standard_error)}"
                for row in cells.itertuples()
            ]
            near = cells.loc[NEAR_A_SAMPLE]
            numbers = [page.number(near[key]) for key in ("deviation", "scatter", "error")]
            rows.append([joint, end, *slope, *numbers])
    frames = [f"slope, frames: {name}" for name in dict.fromkeys(slopes["frames"])]
    return table(
        ["joint", "end", *frames, "deviation (rad)", "scatter (rad)", "rms error (rad)"], rows
    )


def _filters(filters: pd.DataFrame) -> str:
    rows = [
        [row.joint, row.end, *map(page.number, (row.error, row.bound, row.coverage))]
        for row in filters.sort_values("joint", kind="stable").itertuples()
    ]
    return table(["joint", "end", "rms error (rad)", "bound (rad)", "coverage"], rows)
