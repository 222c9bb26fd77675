"""Where the conclusions hold, and where they turn.

One row per claim, one column per level of a factor: above for the motion, below for the wrench.
Blue disc: the claim's rule holds in every case of the claim in all conditions of the column (its
seeds, and what else is varied in them); orange cross: in none of them; diamond: in some, the bluer
the more; dash: there is no evidence. Shaded, with a large symbol: otherwise than in the base
condition. Numbers are factors on the youBot laboratory's disturbances and on how long they last,
on its instruments' noise and on the bounds of the cable systems. Claims with an asterisk are about
real robots, or the paper's own: synthetic conditions show how the rule behaves, and decide nothing.
"""

from __future__ import annotations

from functools import partial

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pipeline.figures.style import BLACK, BLUE, GREY, LIGHT_GREY, TWO_COLUMNS, VERMILLION, panels
from pipeline.studies.claim_grid import LARGE, Column, draw_grid

SHARES = LinearSegmentedColormap.from_list("shares", [VERMILLION, "white", BLUE])
MARKERS = {"all": "o", "some": "D", "none": "X", "no evidence": "_"}
CELL = 0.145  # in


def draw(counts: pd.DataFrame) -> Figure:
    """Counts of verdicts by study, factor, level and claim, in the order in which they are to be
    shown, the base condition first.
    """
    studies = dict(list(counts.groupby("study", sort=False)))
    heights = [rows["claim"].nunique() for rows in studies.values()]
    figure, grid = panels(
        TWO_COLUMNS,
        1.1 * len(studies) + 0.5 + CELL * sum(heights),
        rows=len(studies),
        height_ratios=heights,
    )
    for axes, rows in zip(grid[:, 0], studies.values(), strict=True):
        _panel(axes, rows)
    entries = [
        _symbol(word, share, label=text)
        for word, share, text in (
            ("all", 1.0, "holds"),
            ("some", 0.5, "holds in some conditions"),
            ("none", 0.0, "fails"),
            ("no evidence", 0.0, "no evidence"),
        )
    ]
    entries.append(Patch(color=LIGHT_GREY, label="otherwise than in the base condition"))
    figure.legend(handles=entries, loc="outside lower center", ncols=5)
    return figure


def word_of(holds: int, fails: int) -> str:
    """In which of the conditions with evidence the claim holds."""
    if holds + fails == 0:
        return "no evidence"
    return "some" if holds and fails else "all" if holds else "none"


def _symbol(word: str, share: float, size: float = LARGE, label: str | None = None) -> Line2D:
    style = {
        "marker": MARKERS[word],
        "color": GREY if word == "no evidence" else SHARES(share),
        "markersize": size,
        "label": label,
    }
    if word == "some":
        style |= {"markeredgecolor": BLACK, "markersize": size * 0.9}
    return Line2D([0], [0], linestyle="none", markeredgewidth=0.5, **style)


def _panel(axes: Axes, rows: pd.DataFrame) -> None:
    claims, columns = (
        list(rows[names].drop_duplicates().itertuples(index=False, name=None))
        for names in (["claim", "about"], ["factor", "level"])
    )
    counts = rows.set_index(["factor", "level", "claim"])[["holds", "fails"]]
    counted = {key: tuple(row) for key, row in zip(counts.index, counts.to_numpy(), strict=True)}

    def cell(column: Column, claim: str) -> tuple[partial, bool]:
        holds, fails = counted.get((*column, claim), (0, 0))
        word = word_of(holds, fails)
        base = word_of(*counted.get((*columns[0], claim), (0, 0)))
        return partial(_symbol, word, holds / max(1, holds + fails)), word != base

    draw_grid(axes, columns, claims, cell)
