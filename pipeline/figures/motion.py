"""Figures of the arm's motion (Sec. 4.1.2): recordings, models and parameters."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.core.columns import column, columns, members
from pipeline.figures import style

QUANTITIES = {
    "one_step": "std of the process noise (rad)",
    "free_running": "std of the joint angle (rad)",
}
OUTLYING = 3  # a line over this many times as high as all others does not set the panels' scale
RIDGE_SHAPES = (
    ("alpha", r"$\alpha$", "--"),
    ("level", r"$\alpha\sqrt{u^2-\langle\Vert J^{-1}\Vert^2\rangle}$", "-"),
)
SOURCES = {
    "recorded": {"linestyle": "-", "label": "training takes"},
    "drawn": {"linestyle": ":", "label": "takes drawn from the model"},
}
LAWS = {
    "joint_step": {"color": style.BLACK, "label": "white steps"},
    "joint_error_normal": {"color": style.BLUE, "ls": "-.", "label": "memory, normal"},
    "joint_error": {
        "color": style.VERMILLION,
        "ls": "--",
        "label": "memory, Student's t",
    },
}


def joint_realizations(joints: pd.DataFrame, process_noise: pd.DataFrame) -> Figure:
    """Draw Fig. (JointRealzFig): one panel per joint, of the training takes in ``joints``."""
    training = joints[joints["part"] == "training"]
    names = members(joints, "q")
    std = process_noise.groupby("t")[columns("w", names)].std()
    span = 0.54 * np.ptp(training[columns("q", names)], axis=0).max()
    across = 1
    width = style.ONE_COLUMN
    if len(names) > style.BESIDE:
        across = 2
        width = style.TWO_COLUMNS
    figure, (row,) = style.joint_panels(len(names), across, (width, 1.2, 0.8))
    # pixels, because paths of a hundred overlapping lines take megabytes
    thin = {"color": style.RECORDED["color"], "linewidth": 0.4, "rasterized": True}
    green = {"color": style.GREEN, "linestyle": "-.", "linewidth": 0.8}
    dashed = {"color": style.BLACK, "linestyle": "--", "linewidth": 0.7}
    for (joint, line), axes in zip(style.joint_lines(names).items(), row, strict=True):
        angles = training.pivot(index="t", columns="take", values=column("q", joint))
        lines = axes.plot(angles.index, angles.to_numpy(), **thin)
        (mean,) = axes.plot(angles.mean(axis=1), **dashed)
        middle = (angles.min().min() + angles.max().max()) / 2
        axes.set(ylabel=f"{line['label']} (rad)", ylim=(middle - span, middle + span))
        axes.set_xlim(0, angles.index[-1])
        right = axes.twinx()
        (noise,) = right.plot(std[column("w", joint)], **green)
        right.set(ylim=(0, 1.6 * std.max().max()))
        right.set_ylabel("noise std (rad)", color=style.GREEN)
        right.spines["right"].set(visible=True, color=style.GREEN)
        right.tick_params(axis="y", colors=style.GREEN)
    labels = ("realisations", "mean", "std of the process noise (right)")
    above = {"loc": "outside upper center", "ncols": 3, "columnspacing": 1.2}
    figure.legend([lines[0], mean, noise], labels, **above)
    return figure


def joint_std(
    deviation: pd.DataFrame,
    models: list[str],
    joints: list[str],
    mode: str,
    recordings: str,
) -> Figure:
    """Draw Fig. (STDq): one panel per joint, all on one scale; ``mode`` of the simulation."""
    across = style.panels_across(len(joints))
    size = (style.TWO_COLUMNS, 1.9, 0.6)
    lines = {"recorded": style.RECORDED | {"label": recordings}}
    lines |= style.model_lines(models)
    figure, (row,) = style.joint_panels(len(joints), across, size, sharey=True)
    shown = deviation.set_index(["source", "t"])[columns("s", joints)].loc[[*lines]]
    tops = sorted(shown.groupby("source").max().max(axis=1))
    while len(tops) > 1 and tops[-1] > OUTLYING * tops[-2]:
        tops.pop()
    for joint, axes in zip(joints, row, strict=True):
        for source, line in lines.items():
            axes.plot(shown.loc[source, column("s", joint)], **line)
        axes.set(title=style.joint_label(joint), xlim=(0, deviation["t"].max()))
    row[0].set_ylim(0, 1.05 * tops[-1])
    for first in row[::across]:
        first.set_ylabel(QUANTITIES[mode])
    style.legend(figure)
    return figure


def ridge(ridges: pd.DataFrame, models: list[str]) -> Figure:
    """Draw a row of panels for each Gaussian matrix model among ``models``."""
    named = [model for model in models if model in set(ridges["model"])]
    size = {"rows": len(named), "columns": 2, "sharex": True}
    figure, grid = style.panels(style.TWO_COLUMNS, 0.4 + 1.8 * len(named), **size)
    dot = {
        "color": style.VERMILLION,
        "marker": "o",
        "markersize": 3,
        "linestyle": "none",
    }
    lines = style.model_lines(named)
    for (excess, shape), (model, line) in zip(grid, lines.items(), strict=True):
        rows = ridges[ridges["model"] == model].set_index("u")
        best = rows.loc[rows["excess"].idxmin()]
        excess.plot(rows["excess"], color=line["color"])
        excess.plot(best.name, best["excess"], **dot, clip_on=False)
        excess.set(
            ylabel=f"{line['label']}\nexcess objective (unit: caption)",
            ylim=(0, None),
        )
        for name, label, dashes in RIDGE_SHAPES:
            look = {"color": line["color"], "linestyle": dashes, "label": label}
            shape.plot(rows[name] / best[name], **look)
        shape.plot(best.name, 1.0, **dot, label="best of the bounds tried")
        shape.set(ylabel="ratio to the best bound (1)", ylim=(0, None))
    grid[0, 1].legend(loc="upper right")
    style.letters(grid[0], y=1.1)  # above the exponent of (a)
    for axes in grid[-1]:
        axes.set_xlabel(r"bound $u$ (1/m and 1 mixed)")
    return figure


def sigma_b_over_weight(sigma_b_weights: pd.DataFrame, models: list[str]) -> Figure:
    """Draw a panel for each Wishart model, in the colours of ``models``."""
    named = list(sigma_b_weights["model"].unique())
    height = 1.0 + 2.2 * len(named)
    figure, grid = style.panels(style.ONE_COLUMN, height, rows=len(named), sharex=True)
    lines = style.model_lines(dict.fromkeys([*models, *named]))
    dashed = {
        "ls": "--",
        "lw": 0.8,
        "color": style.VERMILLION,
        "label": "moment estimate",
    }
    mark = {
        "ms": 3,
        "color": style.VERMILLION,
        "label": "weight returning the estimate",
    }
    at_rest = {"lw": 0.8, "color": style.GREY, "label": "weight by the noise at rest"}
    for (axes,), model in zip(grid, named, strict=True):
        rows = sigma_b_weights[sigma_b_weights["model"] == model]
        curves = rows[rows["point"] == "curve"]
        moments = rows[rows["point"] == "moments"]
        used = rows[rows["point"] == "used"]
        for source, curve in curves.groupby("source", sort=False):
            look = SOURCES[source] | {"color": lines[model]["color"]}
            axes.plot(curve["ratio"], curve["sigma_b"], **look)
        if len(moments):
            axes.axhline(moments["sigma_b"].iloc[0], **dashed)
            axes.plot(moments["ratio"], moments["sigma_b"], "o", **mark)
        axes.axvline(used["ratio"].iloc[0], **at_rest)
        axes.set(xscale="log", ylim=(0, None), ylabel=r"$\hat\sigma_B$ (1)")
        if len(named) > 1:
            axes.set_title(lines[model]["label"])
    style.legend(figure, ncols=2)
    grid[-1, 0].set_xlabel(r"weight $\alpha_2/\alpha_1$ (rad)")
    return figure


def noise_quantiles(noise_quantiles: pd.DataFrame) -> Figure:
    """Draw a panel for each joint, a line for each of three joint error laws."""
    joints = list(noise_quantiles["joint"].unique())
    across = style.panels_across(len(joints))
    size = style.TWO_COLUMNS, 1.6, 0.6
    figure, (row,) = style.joint_panels(len(joints), across, size)
    ends = noise_quantiles["normal"].min(), noise_quantiles["normal"].max()
    for joint, axes in zip(joints, row, strict=True):
        axes.plot(ends, ends, color=style.LIGHT_GREY, label="normal law")
        for model, line in LAWS.items():
            of_joint = noise_quantiles["joint"] == joint
            rows = noise_quantiles[of_joint & (noise_quantiles["model"] == model)]
            axes.plot(rows["normal"], rows["noise"], **line)
        axes.set_title(style.joint_label(joint))
    for axes in row[-across:]:
        axes.set_xlabel("normal quantile (std)")
    for axes in row[::across]:
        axes.set_ylabel("noise (predicted std)")
    style.legend(figure)
    return figure
