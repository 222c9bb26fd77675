"""Picture of the takes of a dataset: path of the tip, joint angles, and takes that are left out."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.core.columns import column, members
from pipeline.figures import style

# colours of left-out takes with a line of the legend each
LEFT_OUT = (style.VERMILLION, style.GREEN, style.PURPLE, style.ORANGE, style.BLACK)
NAMED = len(LEFT_OUT)
STAYING = {"color": style.SKY, "linewidth": 0.4, "rasterized": True, "zorder": 1}
FURTHER = {"color": style.GREY, "linewidth": 0.8, "linestyle": ":", "zorder": 2}


def takes(take_paths: pd.DataFrame) -> Figure:
    """Draw the path of the tip in one view or two, if it is known, and a panel for each joint."""
    joints = members(take_paths, "q")
    views = tip_views(members(take_paths, "x"))
    count = len(views) + len(joints)
    across = style.panels_across(count)
    lines = -(-count // across)
    looks = looks_of_takes(take_paths)
    height = 0.5 + 0.12 * min(len(looks), NAMED + 1) + 1.75 * lines
    figure, grid = style.panels(style.TWO_COLUMNS, height, lines, across)

    for axes, (right, up) in zip(grid.flat, views, strict=False):
        draw_takes(axes, take_paths, column("x", right), column("x", up), looks)
        axes.set(xlabel=f"{right} (m)", ylabel=f"{up} (m)", title="tip")
        axes.set_aspect("equal", adjustable="datalim")
    for axes, joint in zip(grid.flat[len(views) :], joints, strict=False):
        draw_takes(axes, take_paths, "t", column("q", joint), looks)
        axes.set(xlabel="time (s)", ylabel="angle (rad)")
        axes.set_title(style.joint_label(joint))
    for empty in grid.flat[count:]:
        empty.remove()
    style.legend(figure, ncols=1)
    return figure


def tip_views(task: tuple[str, ...]) -> list[tuple[str, str]]:
    """Return the pairs of lengths of the ``task`` that views show, right and up: x over z in a
    plane; y and z over x in space.
    """
    lengths = [row for row in ("x", "y", "z") if row in task]
    return [(lengths[0], up) for up in lengths[1:]]


def looks_of_takes(take_paths: pd.DataFrame) -> dict[str, dict]:
    """Return by left-out take the look of its line: colour and reason for the first NAMED."""
    left_out = take_paths[take_paths["left_out"]].drop_duplicates("take")
    further = len(left_out) - NAMED
    looks = {}
    for place, row in enumerate(left_out.itertuples()):
        if place < NAMED:
            label = style.plain_label(f"left out: {row.take} ({row.reason})")
            look = {"color": LEFT_OUT[place], "linewidth": 0.9, "zorder": 3}
        else:
            label = f"{further} more, left out"
            look = FURTHER
        looks[row.take] = look | {"label": label}
    return looks


def draw_takes(
    axes: Axes,
    take_paths: pd.DataFrame,
    right: str,
    up: str,
    looks: dict[str, dict],
) -> None:
    """Draw the columns ``up`` over ``right`` of every take in its look, else as STAYING."""
    staying = STAYING | {"label": "takes that stay"}
    for take, rows in take_paths.groupby("take", sort=False):
        axes.plot(rows[right], rows[up], **looks.get(take, staying))
