"""Which claims hang on what the paper leaves open.

One row per claim, one column per variation: the base case first, then one decision at a time taken
otherwise. Blue disc: the claim's rule holds in every case of the claim; orange cross: it fails in
one at least; dash: there is no evidence. Shaded, with a large symbol: a case of the claim came out
otherwise than in the base case. Weights: factors on the ratio of the two weights in the convex
problem; floor: of the inverse perturbation matrix; given: the first factor diag(l, l, 1), l the
mean length of a link; noise in scores: factors on the measurement noise that is added to every
model; threshold: share of the particles below which they are resampled. Under chance nothing
changes but the random numbers or the test takes: what changes there too is not told apart from
luck. Claims with an asterisk are about real robots, or the paper's own: synthetic recordings show
how the rule behaves, and decide nothing.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pipeline.figures.style import BLUE, GREY, LIGHT_GREY, TWO_COLUMNS, VERMILLION, panels
from pipeline.studies.claim_grid import LARGE, Column, draw_grid

TABLES = {"sensitivity": "data/studies/sensitivity"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"

SYMBOLS = {
    "holds": {"marker": "o", "color": BLUE},
    "fails": {"marker": "X", "color": VERMILLION},
    "no evidence": {"marker": "_", "color": GREY},
}
CELL = 0.15  # in


def draw(sensitivity: pd.DataFrame) -> Figure:
    """Table ``sensitivity``: claims downwards and variations across, both in the order of the
    table.
    """
    claims, columns = (
        list(sensitivity[names].drop_duplicates().itertuples(index=False, name=None))
        for names in (["claim", "about"], ["setting", "variation"])
    )
    cells = sensitivity.groupby(["setting", "variation", "claim"], sort=False).agg(
        verdict=("verdict", "first"), changed=("changed", "any")
    )
    figure, ((axes,),) = panels(TWO_COLUMNS, 1.5 + CELL * len(claims))

    def cell(column: Column, claim: str) -> tuple[partial, bool]:
        row = cells.loc[(*column, claim)]
        return partial(_symbol, row["verdict"]), bool(row["changed"])

    draw_grid(axes, columns, claims, cell)
    axes.set_xticks(range(len(columns)), [v if s else "base case" for s, v in columns])
    entries = [_symbol(name, LARGE) for name in SYMBOLS]
    entries.append(Patch(color=LIGHT_GREY, label="otherwise than in the base case"))
    figure.legend(handles=entries, loc="outside lower center", ncols=4)
    return figure


def _symbol(verdict: str, size: float) -> Line2D:
    style = {"linestyle": "none", "markersize": size, "markeredgewidth": 0.6, "label": verdict}
    return Line2D([0], [0], **style, **SYMBOLS[verdict])
