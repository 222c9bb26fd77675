"""The ridge of the Gaussian matrix model, and what the data tell of its parameters.

(a) Least objective for each bound u less the least of all: in rad⁴ for the estimate by moments, for
the paper's estimator in its own unit (rad and rad² mixed), for the likelihood in nats. (b) The
scale α that goes with each bound, and the level α·sqrt(u² − ⟨‖J⁻¹‖²⟩) of the noise, ⟨⟩ the mean
over the motion weighted by the squared speed, both over their values at the best bound. Dots: the
best of the bounds tried. Where α falls and the level hardly moves, it is the level alone that the
data determine. Where the best bound is the last one tried, û is unbounded.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import TWO_COLUMNS, VERMILLION, letter, model_lines, panels

TABLES = {"ridges": "data/score"}
NEEDS = "fitted Gaussian matrix model"


def draw(ridges: pd.DataFrame, models: list[str]) -> Figure:
    """Table ``ridges``: a row of panels for each Gaussian matrix model among ``models``."""
    named = [model for model in models if model in set(ridges["model"])]
    figure, grid = panels(
        TWO_COLUMNS, 0.4 + 1.8 * len(named), rows=len(named), columns=2, sharex=True
    )
    for row, (model, line) in zip(grid, model_lines(named).items(), strict=True):
        ridge = ridges[ridges["model"] == model]
        best = ridge.loc[ridge["excess"].idxmin()]
        excess, shape = row
        excess.plot(ridge["u"], ridge["excess"], color=line["color"])
        excess.plot(
            best["u"], best["excess"], color=VERMILLION, marker="o", markersize=3, clip_on=False
        )
        excess.set(ylabel=f"{line['label']}\nexcess objective", ylim=(0, None))
        for name, label, style in (
            ("alpha", r"$\alpha$", "--"),
            ("level", r"$\alpha\sqrt{u^2-\langle\Vert J^{-1}\Vert^2\rangle}$", "-"),
        ):
            shape.plot(
                ridge["u"],
                ridge[name] / best[name],
                color=line["color"],
                linestyle=style,
                label=label,
            )
        shape.plot(best["u"], 1.0, color=VERMILLION, marker="o", markersize=3)
        shape.set(ylabel="over the best", ylim=(0, None))
    grid[0, 1].legend(loc="lower left")
    for axes, name in zip(grid[0], "ab", strict=True):
        letter(axes, name)
    for axes in grid[-1]:
        axes.set_xlabel(r"bound $u$")
    return figure
