"""Which claims hang on what the paper leaves open.

One row per claim, one column per variation: the base case first, then one decision at a time taken otherwise. Blue disc: the claim's
rule holds in every case of the claim; orange cross: it fails in one at least; dash: there is no evidence. Shaded, with a large symbol:
a case of the claim came out otherwise than in the base case. Weights: factors on the ratio of the two weights in the convex problem;
floor: of the inverse perturbation matrix; given: the first factor diag(l, l, 1), l the mean length of a link; noise in scores: factors
on the measurement noise that is added to every model; threshold: share of the particles below which they are resampled. Under chance
nothing changes but the random numbers or the test takes: what changes there too is not told apart from luck. Claims with an asterisk
are about real robots, or the paper's own: synthetic recordings show how the rule behaves, and decide nothing.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from pipeline.figures.style import BLUE, GREY, LIGHT_GREY, TWO_COLUMNS, VERMILLION, panels

SYMBOLS = {
    "holds": {"marker": "o", "color": BLUE},
    "fails": {"marker": "X", "color": VERMILLION},
    "no evidence": {"marker": "_", "color": GREY},
}
SMALL, LARGE = 2.4, 5.0  # pt
CELL = 0.15  # in


def draw(sensitivity: pd.DataFrame) -> Figure:
    """Table ``sensitivity``: claims downwards and variations across, both in the order of the table."""
    claims, columns = (sensitivity[names].drop_duplicates() for names in (["claim", "about"], ["setting", "variation"]))
    figure, ((axes,),) = panels(TWO_COLUMNS, 1.5 + CELL * len(claims))
    cells = sensitivity.groupby(["setting", "variation", "claim"], sort=False).agg(verdict=("verdict", "first"), changed=("changed", "any"))
    for x, column in enumerate(columns.itertuples(index=False)):
        for y, claim in enumerate(claims["claim"]):
            cell = cells.loc[(*column, claim)]
            if cell["changed"]:
                axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, color=LIGHT_GREY, linewidth=0))
            size = LARGE if cell["changed"] or x == 0 else SMALL
            axes.plot(x, y, linestyle="none", markersize=size, markeredgewidth=0.6, **SYMBOLS[cell["verdict"]])
    starts = np.flatnonzero((columns["setting"] != columns["setting"].shift()).to_numpy())
    for start in starts[1:]:
        axes.axvline(start - 0.5, color=GREY, linewidth=0.4)
    names = [value if setting else "base case" for setting, value in columns.itertuples(index=False)]
    axes.set_xticks(range(len(columns)), names, rotation=90, fontsize=7)
    axes.set_yticks(
        range(len(claims)),
        [name.replace("-", " ") + "*" * (about != "method") for name, about in claims.itertuples(index=False)],
        fontsize=7,
    )
    axes.set(xlim=(-0.6, len(columns) - 0.4), ylim=(len(claims) - 0.4, -0.6))
    axes.tick_params(length=0)
    settings = axes.secondary_xaxis("top")
    middles = (starts + np.append(starts[1:], len(columns)) - 1) / 2
    settings.set_xticks(middles, columns["setting"].iloc[starts], rotation=45, ha="left", fontsize=7)
    settings.tick_params(length=0)
    for spine in (*axes.spines.values(), *settings.spines.values()):
        spine.set_visible(False)
    entries = [
        Line2D([], [], linestyle="none", markersize=LARGE, markeredgewidth=0.6, label=name, **style) for name, style in SYMBOLS.items()
    ]
    entries.append(Patch(color=LIGHT_GREY, label="otherwise than in the base case"))
    figure.legend(handles=entries, loc="outside lower center", ncols=4)
    return figure
