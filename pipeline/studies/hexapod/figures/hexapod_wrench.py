"""The wrench of six legs of uncertain thrust and direction.

(a) Thrusts of the legs that hold a constant load along the motion; a leg pulls where its thrust is
negative. (b), (c) Standard deviation of force and moment on the platform: lines by the exact law of
the legs, dots by the matrix model with one diagonal Σ_S for the whole motion. Moments are divided
by the characteristic length. To look at: where the legs are about to lose the platform their
thrusts grow, and what their directions make of them.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import GREY, JOINTS, TWO_COLUMNS, letter, panels

TABLES = {name: "data/studies/hexapod" for name in ("hexapod_thrust", "hexapod_wrench")}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
DOTS = 15  # of each line of the matrix model


def draw(hexapod_thrust: pd.DataFrame, hexapod_wrench: pd.DataFrame) -> Figure:
    """The two tables of the same names."""
    figure, (row,) = panels(TWO_COLUMNS, 2.6, columns=3)
    thrusts, force, moment = row
    thrusts.axhline(0, color=GREY, linewidth=0.5)
    for (leg, rows), look in zip(hexapod_thrust.groupby("leg"), JOINTS, strict=False):
        thrusts.plot(rows["place"], rows["thrust"], label=str(leg), **look)
    thrusts.set_ylabel("thrust (N)")
    thrusts.legend(title="leg", ncols=2, loc="best", handlelength=2.0, columnspacing=1.0)
    greatest = hexapod_wrench[["exact", "matrix"]].to_numpy().max()
    for axes, letter_of, unit in ((force, "f", "F"), (moment, "m", "M")):
        for axis, look in zip("xyz", JOINTS, strict=False):
            rows = hexapod_wrench[hexapod_wrench["row"] == letter_of + axis]
            axes.plot(rows["place"], rows["exact"], label=f"${unit}_{axis}$", **look)
            some = rows.iloc[:: max(1, len(rows) // DOTS)]
            axes.plot(some["place"], some["matrix"], ".", color=look["color"], markersize=4)
        axes.set_ylim(0, 1.05 * greatest)
        axes.legend(loc="upper left")
    force.set_ylabel("sd of the force (N)")
    moment.set_ylabel("sd of the moment over length (N)")
    for axes, name in zip(row, "abc", strict=True):
        letter(axes, name)
        axes.set_xlabel("share of the motion")
    return figure
