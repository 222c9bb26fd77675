"""A grid of claims downwards and cases across, as the figures of several studies show it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from pipeline.figures.style import GREY, LIGHT_GREY

SMALL, LARGE = 2.4, 4.8  # pt
Column = tuple[str, str]  # what is varied, and how

# of a column and a claim: the symbol in a size (pt), and whether it differs from the first column
Cell = Callable[[Column, str], tuple[Callable[[float], Line2D], bool]]


def draw_grid(
    axes: Axes, columns: Sequence[Column], claims: Sequence[tuple[str, str]], cell: Cell
) -> None:
    """Draw the ``cell`` of every column and claim; ``claims`` are ids, and whose behaviour they are
    about: an asterisk marks those that are not about the method.

    What differs from the first column is shaded, with a large symbol.
    """
    for x, column in enumerate(columns):
        for y, (claim, _) in enumerate(claims):
            symbol, differs = cell(column, claim)
            if differs:
                axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, color=LIGHT_GREY, linewidth=0))
            line = symbol(LARGE if differs or x == 0 else SMALL)
            line.set_data([x], [y])
            axes.add_line(line)
    varied = np.array([name for name, _ in columns])
    starts = np.flatnonzero(np.append(True, varied[1:] != varied[:-1]))
    for start in starts[1:]:
        axes.axvline(start - 0.5, color=GREY, linewidth=0.4)
    axes.set_xticks(range(len(columns)), [level for _, level in columns], rotation=90, fontsize=7)
    names = [name.replace("-", " ") + "*" * (about != "method") for name, about in claims]
    axes.set_yticks(range(len(claims)), names, fontsize=7)
    axes.set(xlim=(-0.6, len(columns) - 0.4), ylim=(len(claims) - 0.4, -0.6))
    axes.tick_params(length=0)
    above = axes.secondary_xaxis("top")
    middles = (starts + np.append(starts[1:], len(columns)) - 1) / 2
    names = [varied[start].replace("_", " ") for start in starts]
    above.set_xticks(middles, names, rotation=45, ha="left", fontsize=7)
    above.tick_params(length=0)
    for spine in (*axes.spines.values(), *above.spines.values()):
        spine.set_visible(False)
