"""Figures of the depth camera, the filter and the quality of the recordings (Sec. 4.1.3)."""

from textwrap import wrap

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from pipeline.core.columns import column, columns, members
from pipeline.core.filters import MEMORY, NONE, closed
from pipeline.figures import style

ERROR = "_standard_error"  # end of the name of a measure that is an error of another measure
NODES = ("O1", "O2", "O3", "EE")
LABEL_DISTANCE = 13  # pt from the node, on the outer side of the bend
# unit of a measure: unit of its strip, and factor between them
UNITS = {
    "share": ("%", 100),
    "m": ("mm", 1000),
    "s": ("ms", 1000),
    "s/s": ("ms/s", 1000),
}
UNITS |= {"rad": ("mrad", 1000), "count": ("frames", 1), "frames": ("frames", 1)}
KEPT = {"marker": ".", "ms": 3, "color": style.BLUE, "ls": "none", "label": "take"}
LEFT_OUT = {
    "marker": "x",
    "ms": 4,
    "color": style.VERMILLION,
    "ls": "none",
    "label": "left out",
}
# looks of the lines of a strip
LIMIT = {"color": style.BLACK, "lw": 0.8, "ls": (0, (4, 3))}
LIMIT |= {"label": "limit", "zorder": 1}
BETWEEN = {"color": style.LIGHT_GREY, "lw": 0.8}
BETWEEN |= {"label": "training | test", "zorder": 0}
BARS = {"fmt": "none", "ecolor": style.GREY, "elinewidth": 0.5}
BARS |= {"label": "± 2 standard errors"}


def articulation(cloud: pd.DataFrame, skeleton: pd.DataFrame) -> Figure:
    """Draw Fig. (KinOptFig): one panel per view, both on the same scale."""
    width, depth = np.ptp(cloud[["x", "z"]].to_numpy(), axis=0)
    height = 1.6 + 2 * (style.ONE_COLUMN - 0.6) * depth / width
    figure, grid = style.panels(
        style.ONE_COLUMN,
        height,
        rows=2,
        sharex=True,
        sharey=True,
    )
    dots = {
        "color": style.SKY,
        "markersize": 1.8,
        "markeredgewidth": 0,
        "rasterized": True,
    }
    rings = {"color": style.VERMILLION, "markersize": 3.5, "markerfacecolor": "white"}
    for axes, view in zip(grid[:, 0], ("initial", "extended"), strict=True):
        points = cloud.loc[cloud["view"] == view, ["x", "z"]].to_numpy()
        nodes = skeleton.loc[skeleton["view"] == view, ["x", "z"]].to_numpy()
        axes.plot(*points.T, ".", label="point cloud", **dots)
        axes.plot(*nodes.T, "o-", label="fitted segments", **rings)
        outer = _outer_sides(nodes)
        for text, node, side in zip(NODES, nodes, outer, strict=True):
            place = {"xytext": LABEL_DISTANCE * side, "textcoords": "offset points"}
            axes.annotate(text, node, **place, ha="center", va="center")
        axes.set(ylabel="z (m)", aspect="equal")
        axes.margins(0.12, 0.2)
    style.letters(grid[:, 0])
    grid[-1, 0].set_xlabel("x (m)")
    style.legend(figure, ncols=2).legend_handles[0].set_markersize(4)
    return figure


def _outer_sides(nodes: np.ndarray) -> np.ndarray:
    """Return unit vectors (4, 2) at the ``nodes`` (4, 2) away from their neighbours, up at a
    straight joint.
    """
    before = np.roll(nodes, 1, axis=0)
    after = np.roll(nodes, -1, axis=0)
    before[0] = nodes[1]
    after[-1] = nodes[-2]
    outer = 2 * nodes - before - after
    outer[~outer.any(axis=1)] = (0.0, 1.0)
    return outer / np.linalg.norm(outer, axis=1, keepdims=True)


def kinect_noise(kinect_noise: pd.DataFrame) -> Figure:
    """Draw Fig. (MeanStdKinNoise): the estimate from all test takes."""
    rows = kinect_noise[kinect_noise["take"] == "none"].set_index("t")
    figure, (row,) = style.panels(style.ONE_COLUMN, 2.1, columns=2, sharex=True)
    for joint, line in style.joint_lines(members(kinect_noise, "b")).items():
        row[0].plot(rows[column("b", joint)], **line)
        row[1].plot(np.sqrt(rows[column("r", joint, joint)]), **line)
    row[0].axhline(0, color=style.GREY, linewidth=0.5, zorder=0)
    for axes, label in zip(
        row,
        ("mean (rad)", "standard deviation (rad)"),
        strict=True,
    ):
        axes.set(xlabel="time (s)", ylabel=label)
        axes.xaxis.set_major_locator(MultipleLocator(1))
    style.letters(row)
    row[1].set_ylim(bottom=0)
    figure.get_layout_engine().set(wspace=0.1)
    style.legend(figure, ncols=3)
    return figure


def filter_errors(
    filter_error: pd.DataFrame,
    models: list[str],
    joints: list[str],
) -> Figure:
    """Draw Fig. (PartFiltRes): rows of panels in the order of ``models``, all on one scale."""
    figure, grid = style.model_panels(models, joints, "error (rad)")
    shown = filter_error["take"].iloc[0]
    mean = filter_error[filter_error["model"] == NONE].groupby("t")
    grey = {
        "color": style.LIGHT_GREY,
        "linewidth": 0.25,
        "rasterized": True,
        "zorder": 1,
    }
    blue = {"color": style.BLUE, "lw": 0.8, "label": f"error of {shown}"}
    orange = {"color": style.VERMILLION, "lw": 0.8, "label": f"±1σ bound of {shown}"}
    black = {"color": style.BLACK, "lw": 0.5, "label": "rms error of the training mean"}
    for row, model in zip(grid, models, strict=True):
        rows = filter_error[filter_error["model"] == model]
        take = rows[rows["take"] == shown].set_index("t")
        further = rows[rows["take"] != shown]
        for joint, axes in zip(joints, row, strict=True):
            error = column("e", joint)
            std = take[column("s", joint)]
            rms = np.sqrt(mean[error].agg(lambda errors: np.mean(errors**2)))
            axes.plot(take[error], **blue)
            for sign in (1, -1):
                axes.plot(sign * std, **orange)
                axes.plot(sign * rms, **black)
            errors = further.pivot(index="t", columns="take", values=error)
            lines = axes.plot(errors.index, errors.to_numpy(), **grey)
            if lines:
                lines[0].set_label("errors of the other takes")
    grid[0, 0].set_xlim(0, filter_error["t"].max())
    style.legend(figure)
    return figure


def filter_closed_loop(
    filter_error: pd.DataFrame,
    models: list[str],
    joints: list[str],
) -> Figure:
    """Draw rows of panels in the order of ``models``, the panels of a joint on one scale."""
    figure, grid = style.model_panels(models, joints, "rms error (rad)")
    squares = filter_error[columns("e", joints)] ** 2
    rms = np.sqrt(squares.groupby([filter_error["model"], filter_error["t"]]).mean())
    for row, model in zip(grid, models, strict=True):
        looks = {
            NONE: {"label": "training mean", "color": style.GREY, "lw": 1.6},
            model: {"label": "open loop", "color": style.BLUE, "lw": 0.8},
            closed(model): {
                "label": "closed loop",
                "color": style.GREEN,
                "lw": 0.8,
                "ls": "--",
            },
            MEMORY: {"label": "linear filter", "color": style.BLACK, "lw": 0.8},
        }
        for joint, axes in zip(joints, row, strict=True):
            for name, look in looks.items():
                if name in rms.index:
                    axes.plot(rms.loc[name, column("e", joint)], **look)
    grid[0, 0].set(xlim=(0, filter_error["t"].max()), ylim=(0, None))
    style.legend(figure)
    return figure


def recording_quality(takes: pd.DataFrame) -> Figure:
    """Draw a strip for each measure that the dataset has."""
    listed = takes.drop_duplicates("take").reset_index(drop=True)
    place = pd.Series(np.arange(1, len(listed) + 1), listed["take"])
    by_measure = {}
    for measure, rows in takes.groupby("measure"):
        by_measure[measure] = rows.set_index("take")
    # a standard error without a limit is drawn with its measure alone
    strips = takes[takes["limit"].notna() | ~takes["measure"].str.endswith(ERROR)]
    measures = list(dict.fromkeys(strips["measure"]))

    height = 0.62 * len(measures) + 0.9
    figure, grid = style.panels(
        style.TWO_COLUMNS,
        height,
        rows=len(measures),
        sharex=True,
    )
    boundaries = np.flatnonzero(listed["part"] != listed["part"].shift())[1:] + 0.5
    for axes, measure in zip(grid[:, 0], measures, strict=True):
        errors = by_measure.get(measure + ERROR)
        _draw_measure(axes, measure, by_measure[measure], errors, place)
        for boundary in boundaries:
            axes.axvline(boundary, **BETWEEN)
    figure.align_ylabels(grid[:, 0])

    numbers = place.groupby(listed["part"].to_numpy(), sort=False).agg(["min", "max"])
    parts = [f"{part} {low} to {high}" for part, (low, high) in numbers.iterrows()]
    grid[-1, 0].set(xlabel="take: " + ", ".join(parts), xlim=(0, len(listed) + 1))
    above = {"xycoords": ("data", "axes fraction"), "rotation": 30, "fontsize": 7}
    for take in listed.loc[listed["left_out"], "take"]:
        grid[0, 0].annotate(take, (place[take], 1.1), **above, color=style.VERMILLION)
    style.legend(figure, ncols=5)
    return figure


def _draw_measure(
    axes: Axes,
    measure: str,
    rows: pd.DataFrame,
    errors: pd.DataFrame | None,
    place: pd.Series,
) -> None:
    """Draw the values of one ``measure`` at the ``place`` of each take, with their standard
    ``errors`` and the limit.
    """
    unit = rows["unit"].iloc[0]
    unit, factor = UNITS.get(unit, (unit, 1))
    values = factor * rows["value"]
    left_out = rows["left_out"]
    for look, marked in ((KEPT, values[~left_out]), (LEFT_OUT, values[left_out])):
        if len(marked):
            axes.plot(place[marked.index], marked, **look, zorder=3)
    if errors is not None:
        error = 2 * factor * errors["value"][rows.index]
        axes.errorbar(place[rows.index], values, yerr=error, **BARS)

    signed = rows["value"].min() < 0
    limit = factor * rows["limit"].iloc[0]
    if not np.isnan(limit):
        for side in (-1, 1) if signed else (1,):
            axes.axhline(side * limit, **LIMIT)
    axes.margins(y=0.12)
    if not signed:  # from zero, with whole marks at either end
        least_top = 1.0 if factor == 1 else 0.0  # counts up to 1 at least
        top = max(axes.get_ylim()[1], least_top)
        axes.set_ylim(-0.08 * top, 1.08 * top)
    label = "\n".join(wrap(f"{measure.replace('_', ' ')} ({unit})", 16))
    axes.set_ylabel(label, rotation=0, ha="right", va="center", fontsize=7)
    axes.locator_params(axis="y", nbins=3)
