"""A hexapod on one motion: noise of its pose.

(a) The robot at the start of the motion, grey, and at its end: base below, platform above, six legs
between. (b), (c) Standard deviation of the platform's position and rotation after one step, along
the motion; all models give the legs the same noise, root mean square over the motion. (d) Exact
density of the step that the legs make along the commanded one, at the end of the motion, over its
greatest value. To look at: noise of the legs grows into noise of the pose where the legs are about
to lose the platform, but for QR of J, which puts the noise into the task.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    MODELS,
    TWO_COLUMNS,
    letter,
    panels,
)

TABLES = {
    name: "data/studies/hexapod" for name in ("hexapod_legs", "hexapod_motion", "hexapod_density")
}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"

LINES = {
    "additive": MODELS["additive"] | {"label": "additive"},
    "gaussian": MODELS["gaussian"] | {"label": "Gaussian"},
    "qr_transposed": {
        "label": r"Wishart, QR of $J^{\mathsf{T}}$",
        "color": BLUE,
        "linestyle": "--",
    },
    "qr": {"label": "Wishart, QR of $J$", "color": GREEN, "linestyle": (0, (6, 1.5, 1, 1.5))},
}
# the point of view: a turn about the vertical, then a tilt, rad
TURN, TILT = 0.5, 0.45


def draw(
    hexapod_legs: pd.DataFrame, hexapod_motion: pd.DataFrame, hexapod_density: pd.DataFrame
) -> Figure:
    """The three tables of the same names."""
    figure, grid = panels(TWO_COLUMNS, 4.6, rows=2, columns=2)
    for axes, name in zip(grid.flat, "abcd", strict=True):
        letter(axes, name)
    robot, position, rotation, density = grid.flat
    for end, color, width in (("start", GREY, 0.9), ("end", BLACK, 1.3)):
        _robot(robot, hexapod_legs[hexapod_legs["end"] == end], color, width)
    robot.set(aspect="equal")
    robot.set_axis_off()
    for model, line in LINES.items():
        rows = hexapod_motion[hexapod_motion["model"] == model]
        position.plot(rows["place"], 1e3 * rows["position"], **line)
        rotation.plot(rows["place"], 1e3 * rows["rotation"], **line)
        rows = hexapod_density[hexapod_density["model"] == model]
        density.plot(rows["share"], rows["density"], **line)
    position.set(xlabel="share of the motion", ylabel="sd of the position (mm)", ylim=(0, None))
    rotation.set(xlabel="share of the motion", ylabel="sd of the rotation (mrad)", ylim=(0, None))
    density.set(xlabel="step over the commanded step", ylabel="density over its greatest")
    density.set_ylim(0, None)
    figure.legend(*position.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _robot(axes: Axes, legs: pd.DataFrame, color: str, width: float) -> None:
    """One pose of the robot, seen from :data:`TURN` and :data:`TILT`."""
    base, platform = (_seen(legs[[f"{end}{axis}" for axis in "xyz"]].to_numpy()) for end in "bp")
    for start, tip in zip(base, platform, strict=True):
        axes.plot(*np.column_stack([start, tip]), color=color, linewidth=width)
    for ring in (base, platform):
        axes.fill(*ring.T, facecolor="none", edgecolor=color, linewidth=1.6 * width)


def _seen(points: np.ndarray) -> np.ndarray:
    """(N, 2) the picture of ``points`` (N, 3), without perspective."""
    x, y, z = points.T
    across = np.cos(TURN) * x - np.sin(TURN) * y
    away = np.sin(TURN) * x + np.cos(TURN) * y
    return np.column_stack([across, np.cos(TILT) * z + np.sin(TILT) * away])
