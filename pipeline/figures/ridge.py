"""The ridge of the Gaussian matrix model, and what the data tell of its parameters.

(a) Least objective for each bound u less the least of all: in rad⁴ for the estimate by moments, for
the paper's estimator in its own unit (rad and rad² mixed), for the likelihood in nats. (b) The
scale α that goes with each bound, and the level α·sqrt(u² − ⟨‖J⁻¹‖²⟩) of the noise, ⟨⟩ the mean
over the motion weighted by the squared speed, both over their values at the best bound. Orange
dots: the best of the bounds tried. Where α falls and the level hardly moves, it is the level alone
that the data determine. Where the best bound is the last one tried, û is unbounded.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"ridges": "data/score"}
NEEDS = "fitted Gaussian matrix model"
SHAPES = (
    ("alpha", r"$\alpha$", "--"),
    ("level", r"$\alpha\sqrt{u^2-\langle\Vert J^{-1}\Vert^2\rangle}$", "-"),
)


def draw(ridges: pd.DataFrame, models: list[str]) -> Figure:
    """Table ``ridges``: a row of panels for each Gaussian matrix model among ``models``."""
    named = [model for model in models if model in set(ridges["model"])]
    size = {"rows": len(named), "columns": 2, "sharex": True}
    figure, grid = style.panels(style.TWO_COLUMNS, 0.4 + 1.8 * len(named), **size)
    dot = {"color": style.VERMILLION, "marker": "o", "markersize": 3, "linestyle": "none"}
    for (excess, shape), (model, line) in zip(grid, style.model_lines(named).items(), strict=True):
        ridge = ridges[ridges["model"] == model].set_index("u")
        best = ridge.loc[ridge["excess"].idxmin()]
        excess.plot(ridge["excess"], color=line["color"])
        excess.plot(best.name, best["excess"], **dot, clip_on=False)
        label = f"{line['label']}\nexcess objective (unit: caption)"
        excess.set(ylabel=label, ylim=(0, None))
        for name, label, dashes in SHAPES:
            look = {"color": line["color"], "linestyle": dashes, "label": label}
            shape.plot(ridge[name] / best[name], **look)
        shape.plot(best.name, 1.0, **dot, label="best of the bounds tried")
        shape.set(ylabel="over its value at the best (1)", ylim=(0, None))
    grid[0, 1].legend(loc="upper right")
    for axes, name in zip(grid[0], "ab", strict=True):
        style.letter(axes, name, y=1.1)  # above the exponent of (a)
    for axes in grid[-1]:
        axes.set_xlabel(r"bound $u$ (1/m and 1 mixed)")
    return figure
