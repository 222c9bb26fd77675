"""Claims whose verdict changes, by what is decided otherwise.

A row is a claim, a column a decision that the paper leaves open (left) or a factor of the
laboratory (right). First column of either part: verdict in the base case (disc: holds; cross:
fails; diamond: both, over the seeds; dash: no evidence). Filled square: at least one level has
another verdict; open square: no level has; nothing: the claim has no evidence there. Orange squares
in the column of random numbers mark claims that chance alone changes. An asterisk marks claims
about robots or about the paper's specimen, which synthetic recordings do not decide.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.figures.style import BLACK, BLUE, GREY, LIGHT_GREY, TWO_COLUMNS, VERMILLION, panels
from pipeline.studies.robustness.decisions import CHANCE
from pipeline.studies.robustness.stage import changes

NAMES = {"lasting": "duration of deviations", "kappa": "concentration of cables"}
NAMES |= {"tension_std": "tension std of cables", "floor": r"floor of $B^{-1}$"}
NAMES |= {"weights": r"weights $\alpha_2/\alpha_1$"}
CELL = 0.135  # in
BASES = {
    "holds": {"marker": "o", "color": BLUE},
    "fails": {"marker": "X", "color": BLACK},
    "both": {"marker": "D", "color": GREY},
    "no evidence": {"marker": "_", "color": GREY},
}
SQUARE = {"marker": "s", "ls": "none", "ms": 4.2, "mew": 0.5}
SAME, OTHER = {"mfc": "none", "mec": LIGHT_GREY}, {"mfc": BLUE, "mec": BLUE}
LUCK = {"mfc": VERMILLION, "mec": VERMILLION}


def draw(robustness: pd.DataFrame) -> Figure:
    """Claims downwards, decisions and factors across."""
    changed = changes(robustness)
    changed["part"] = changed["grid"].where(changed["grid"] == "decisions", "laboratory")
    claims = changed.drop_duplicates("claim").set_index("claim")["about"]
    parts = dict(list(changed.groupby("part", sort=False)))
    columns = {part: ["base case", *dict.fromkeys(rows["factor"])] for part, rows in parts.items()}
    figure, grid = panels(
        TWO_COLUMNS,
        1.9 + CELL * len(claims),
        columns=len(parts),
        sharey=True,
        width_ratios=[len(names) for names in columns.values()],
    )
    place = {claim: y for y, claim in enumerate(claims.index)}
    for axes, (part, rows) in zip(grid[0], parts.items(), strict=True):
        names = columns[part]
        for row in rows.drop_duplicates("claim").itertuples():
            axes.plot([0], [place[row.claim]], ls="none", ms=4.2, **BASES[row.base])
        for row in rows.itertuples():
            look = (LUCK if row.factor == CHANCE else OTHER) if row.changed else SAME
            axes.plot([names.index(row.factor)], [place[row.claim]], **SQUARE, **look)
        labels = [NAMES.get(name, name.replace("_", " ")) for name in names]
        axes.set_xticks(range(len(names)), labels, rotation=90)
        axes.set(xlim=(-0.7, len(names) - 0.3), ylim=(len(claims) - 0.4, -0.6), title=part)
        axes.tick_params(length=0)
        for spine in axes.spines.values():
            spine.set_visible(False)
    labels = [name.replace("-", " ") + " *" * (about != "method") for name, about in claims.items()]
    grid[0, 0].set_yticks(range(len(claims)), labels, fontsize=7)
    entries = [Line2D([], [], ls="none", label=name, **look) for name, look in BASES.items()]
    squares = {"same verdict": SAME, "another verdict": OTHER, "changed by chance": LUCK}
    entries += [Line2D([], [], label=name, **SQUARE, **look) for name, look in squares.items()]
    figure.legend(handles=entries, loc="outside lower center", ncols=7, columnspacing=1.0)
    return figure
