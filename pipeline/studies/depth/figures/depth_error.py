"""The error of the depth camera's joint angles against the deviation of the arm.

Both are about their means over the takes at a frame, over the frames near a sample of the motion
capture, in bins of as many frames each; bars are standard errors. The segment of the tool ends at
the commanded end-effector, as the paper has it (disc, full line), or where the points say (square,
dashed). To look at: a line that falls says that what is called measurement noise takes back the
deviation that the camera is there to see.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import BLUE, GREY, TWO_COLUMNS, VERMILLION, panels
from pipeline.perception.depth_state import NEAR_A_SAMPLE

TABLES = {"error_bins": "data/studies/depth", "error_slopes": "data/studies/depth"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
NEEDS = "depth camera"
LOOKS = {
    "commanded": {"color": VERMILLION, "marker": "o", "linestyle": "-"},
    "fitted": {"color": BLUE, "marker": "s", "linestyle": "--"},
}


def draw(error_bins: pd.DataFrame, error_slopes: pd.DataFrame) -> Figure:
    """One panel a joint of tables ``error_bins`` and ``error_slopes``, in mrad."""
    joints = list(dict.fromkeys(error_slopes["joint"]))
    figure, (row,) = panels(TWO_COLUMNS, 2.3, columns=len(joints))
    near = error_slopes[error_slopes["frames"] == NEAR_A_SAMPLE].set_index(["end", "joint"])
    for axes, joint in zip(row, joints, strict=True):
        axes.axhline(0, color=GREY, linewidth=0.5, zorder=0)
        for end, look in LOOKS.items():
            own = error_bins[(error_bins["end"] == end) & (error_bins["joint"] == joint)]
            style = {"color": look["color"], "markersize": 3, "linewidth": 0.8}
            d = 1e3 * own["deviation"]
            axes.errorbar(
                d,
                1e3 * own["error"],
                yerr=1e3 * own["standard_error"],
                fmt=look["marker"],
                label=f"{end} end",
                **style,
            )
            slope = near.loc[(end, joint), "slope"]
            axes.plot(d, slope * d, linestyle=look["linestyle"], color=look["color"])
        axes.set(title=joint.replace("_", " "), xlabel="deviation (mrad)")
    row[0].set_ylabel("error (mrad)")
    figure.legend(*row[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure
