"""The picture of a take that was judged."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pipeline.figures.style import (
    BLACK,
    LIGHT_GREY,
    TWO_COLUMNS,
    VERMILLION,
    beside,
    joint_lines,
    panels,
)
from pipeline.statistics.takes import percentile_interval
from pipeline.tools.assess.judge import SPANS, Verdict
from pipeline.tools.assess.moment_filter import Innovations
from pipeline.tools.assess.words import shows

GREATEST = 8.0  # standard deviations at which the colours end


def draw(take: str, verdict: Verdict, found: Innovations, number: int) -> Figure:
    """Of each joint what take ``number`` does beyond the filter's prediction, its ±2σ and the
    middle 95 % of the others; below, how far each joint's evidence is off theirs in each part of
    the motion.
    """
    joints = list(verdict.names[1:])
    across = beside(len(joints))
    lines = -(-len(joints) // across)
    height = 0.85 + 1.5 * lines + 0.55 + 0.2 * len(joints)
    figure, grid = panels(
        TWO_COLUMNS,
        height,
        lines + 1,
        across,
        height_ratios=[*[1.5] * lines, 0.55 + 0.2 * len(joints)],
    )
    t = np.linspace(0, verdict.ends[-1], found.error.shape[1] + 1)[1:]
    low, high = percentile_interval(found.error[verdict.others])
    for axes in grid[:lines].flat[len(joints) :]:
        axes.remove()
    for j, (look, axes) in enumerate(
        zip(joint_lines(joints).values(), grid[:lines].flat, strict=False)
    ):
        band = axes.fill_between(t, low[:, j], high[:, j], color=LIGHT_GREY, linewidth=0)
        for sign in (1, -1):
            (bound,) = axes.plot(t, sign * 2 * found.std[number, :, j], color=BLACK, linewidth=0.6)
        (error,) = axes.plot(t, found.error[number, :, j], color=VERMILLION, linewidth=0.8)
        axes.set_title(look["label"])
        axes.set_xlim(0, t[-1])
        axes.set_xlabel("time (s)")
    for first in grid[:lines, 0]:
        first.set_ylabel("innovation (rad)")
    for empty in grid[lines]:
        empty.remove()
    below = figure.add_subplot(grid[0, 0].get_gridspec()[lines, :])
    shown = below.pcolormesh(
        verdict.ends,
        np.arange(len(joints) + 1),
        verdict.span_t,
        cmap="RdBu",
        vmin=-GREATEST,
        vmax=GREATEST,
        edgecolors="white",
        linewidth=0.5,
    )
    below.set_yticks(np.arange(len(joints)) + 0.5, [joint.replace("_", " ") for joint in joints])
    below.invert_yaxis()
    below.set_xlabel(f"time (s), in {SPANS} parts")
    below.set_title("log evidence beside theirs, in their standard deviations")
    figure.colorbar(shown, ax=below, extend="both", aspect=8)
    head = "behaves as" if verdict.behaves else "does NOT behave as"
    head = head if shows(verdict) else "beside"
    figure.suptitle(f"{take} {head} the {int(verdict.others.sum())} other takes", fontsize=9)
    figure.legend(
        [error, bound, band],
        [take, "±2σ by the model", "95 % of the other takes"],
        loc="outside lower center",
        ncols=3,
    )
    return figure
