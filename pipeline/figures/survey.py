"""Where the conclusions hold, and where they turn.

One row per claim, one column per level of a factor: above for the motion, below for the wrench. Blue disc: the claim's rule holds in every
case of the claim in all conditions of the column (its seeds, and what else is varied in them); orange cross: in none of them; diamond: in
some, the bluer the more; dash: there is no evidence. Shaded, with a large symbol: otherwise than in the base condition. Numbers are factors
on the youBot laboratory's disturbances, on its instruments' noise and on the bounds of the cable systems. Claims with an asterisk are about
real robots, or the paper's own: synthetic conditions show how the rule behaves, and decide nothing.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from pipeline.figures.style import BLACK, BLUE, GREY, LIGHT_GREY, TWO_COLUMNS, VERMILLION, panels

SHARES = LinearSegmentedColormap.from_list("shares", [VERMILLION, "white", BLUE])
MARKERS = {"all": "o", "some": "D", "none": "X", "no evidence": "_"}
SMALL, LARGE = 2.4, 4.6  # pt
CELL = 0.145  # in


def draw(counts: pd.DataFrame) -> Figure:
    """Counts of verdicts by study, factor, level and claim, in the order in which they are to be shown, the base condition first."""
    studies = dict(list(counts.groupby("study", sort=False)))
    heights = [rows["claim"].nunique() for rows in studies.values()]
    figure, grid = panels(TWO_COLUMNS, 1.1 * len(studies) + 0.5 + CELL * sum(heights), rows=len(studies), height_ratios=heights)
    for axes, rows in zip(grid[:, 0], studies.values(), strict=True):
        _panel(axes, rows)
    entries = [_symbol(word, share, label=text) for word, share, text in (
        ("all", 1.0, "holds"), ("some", 0.5, "holds in some conditions"), ("none", 0.0, "fails"), ("no evidence", 0.0, "no evidence"),
    )]  # fmt: skip
    entries.append(Patch(color=LIGHT_GREY, label="otherwise than in the base condition"))
    figure.legend(handles=entries, loc="outside lower center", ncols=5)
    return figure


def word_of(holds: int, fails: int) -> str:
    """In which of the conditions with evidence the claim holds."""
    if holds + fails == 0:
        return "no evidence"
    return "some" if holds and fails else "all" if holds else "none"


def _symbol(word: str, share: float, size: float = LARGE, label: str | None = None) -> Line2D:
    style = {"marker": MARKERS[word], "color": GREY if word == "no evidence" else SHARES(share), "markersize": size, "label": label}
    if word == "some":
        style |= {"markeredgecolor": BLACK, "markersize": size * 0.9}
    return Line2D([0], [0], linestyle="none", markeredgewidth=0.5, **style)


def _panel(axes: Axes, rows: pd.DataFrame) -> None:
    claims, columns = (rows[names].drop_duplicates() for names in (["claim", "about"], ["factor", "level"]))
    cells = rows.set_index(["factor", "level", "claim"])[["holds", "fails"]]
    base: dict[str, str] = {}
    for x, column in enumerate(columns.itertuples(index=False)):
        for y, claim in enumerate(claims["claim"]):
            holds, fails = cells.loc[(*column, claim)].tolist() if (*column, claim) in cells.index else (0, 0)
            word = word_of(holds, fails)
            if base.setdefault(claim, word) != word:
                axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, color=LIGHT_GREY, linewidth=0))
            symbol = _symbol(word, holds / max(1, holds + fails), LARGE if x == 0 or base[claim] != word else SMALL)
            symbol.set_data([x], [y])
            axes.add_line(symbol)
    starts = np.flatnonzero((columns["factor"] != columns["factor"].shift()).to_numpy())
    for start in starts[1:]:
        axes.axvline(start - 0.5, color=GREY, linewidth=0.4)
    axes.set_xticks(range(len(columns)), columns["level"], rotation=90, fontsize=7)
    names = [name.replace("-", " ") + "*" * (about != "method") for name, about in claims.itertuples(index=False)]
    axes.set_yticks(range(len(claims)), names, fontsize=7)
    axes.set(xlim=(-0.6, len(columns) - 0.4), ylim=(len(claims) - 0.4, -0.6))
    axes.tick_params(length=0)
    factors = axes.secondary_xaxis("top")
    middles = (starts + np.append(starts[1:], len(columns)) - 1) / 2
    factors.set_xticks(middles, columns["factor"].iloc[starts].str.replace("_", " "), rotation=45, ha="left", fontsize=7)
    factors.tick_params(length=0)
    for spine in (*axes.spines.values(), *factors.spines.values()):
        spine.set_visible(False)
