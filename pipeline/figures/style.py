"""Common style of the figures: widths of one and two journal columns, letters of 7 pt or more, the
colours of Okabe and Ito (jfly.uni-koeln.de/color, 2008), a dash pattern for each line of a panel,
and reproducible bytes.
"""

from collections.abc import Iterable, Sequence
from itertools import cycle
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.legend import Legend

# in
ONE_COLUMN = 3.5
TWO_COLUMNS = 7.16
PNG_RESOLUTION = 200  # dots per inch

BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#999999"
LIGHT_GREY = "#CCCCCC"

# the label says if recorded or simulated
RECORDED = {
    "color": VERMILLION,
    "linestyle": "-",
}
MODELS = {
    name: {"label": label, "color": color, "linestyle": dashes}
    for name, label, color, dashes in (
        ("additive", "additive Gaussian noise", SKY, ":"),
        ("wishart", "Wishart perturbation", BLUE, "--"),
        ("gaussian", "Gaussian noise matrix", BLACK, "-."),
    )
}
FURTHER = (  # looks of models that are not in MODELS, in turn
    {"color": GREEN, "linestyle": (0, (4, 3))},
    {"color": PURPLE, "linestyle": (0, (2, 2, 6, 2))},
    {"color": ORANGE, "linestyle": (0, (10, 1.5, 2, 1.5))},
)
COLORS = (BLUE, VERMILLION, GREEN, PURPLE, SKY, ORANGE, BLACK, GREY)  # of joints
DASHES = (
    "-",
    "--",
    "-.",
    ":",
    (0, (6, 2)),
    (0, (3, 1, 1, 1)),
    (0, (1, 1)),
    (0, (8, 1.5, 1, 1.5)),
)
BESIDE = 4  # greatest number of joints whose panels are in one line

# matplotlib's defaults, so that a user's matplotlibrc has no effect
mpl.rcdefaults()
mpl.rcParams.update(
    {
        "font.family": "STIXGeneral",  # part of matplotlib: equal letters on every machine
        "mathtext.fontset": "stix",
        **dict.fromkeys(["font.size", "axes.titlesize", "axes.labelsize"], 8),
        **dict.fromkeys(["xtick.labelsize", "ytick.labelsize", "legend.fontsize"], 7.5),
        **dict.fromkeys(
            ["legend.frameon", "axes.spines.top", "axes.spines.right"],
            False,
        ),
        **dict.fromkeys(
            ["axes.linewidth", "xtick.major.width", "ytick.major.width"],
            0.5,
        ),
        **dict.fromkeys(["xtick.major.size", "ytick.major.size"], 2.5),
        "legend.handlelength": 2.6,
        "lines.linewidth": 1.0,
        "figure.dpi": 300,  # of rasterised parts of the SVG
        "svg.hashsalt": "manipulator-uncertainty",
        "svg.fonttype": "path",
    },
)


def model_lines(models: Iterable[str]) -> dict[str, dict]:
    """Return label, colour and dashes of every model; a model not in MODELS gets a FURTHER look."""
    further = cycle(FURTHER)
    return {
        model: MODELS.get(model) or {"label": plain_label(model)} | next(further)
        for model in models
    }


def plain_label(name: str) -> str:
    """Return a ``name`` from a file as text: without formulas and control characters."""
    return "".join(c if c.isprintable() else " " for c in name).replace("$", r"\$")


def joint_label(joint: str) -> str:
    """Return a joint's name as text, without underscores."""
    return plain_label(joint.replace("_", " "))


def joint_lines(joints: Sequence[str]) -> dict[str, dict]:
    """Return label, colour and dashes of every joint by its name."""
    looks = zip(joints, cycle(COLORS), cycle(DASHES), strict=False)
    return {
        joint: {"label": joint_label(joint), "color": color, "linestyle": dashes}
        for joint, color, dashes in looks
    }


def panels(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    **layout: object,
) -> tuple[Figure, np.ndarray]:
    """Return a figure of ``width`` × ``height`` in inches and its axes (rows, columns)."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **layout)


def joint_panels(
    joints: int,
    across: int,
    size: tuple[float, float, float],
    groups: int = 1,
    **layout: object,
) -> tuple[Figure, np.ndarray]:
    """Return a figure over time and its axes (``groups``, ``joints``): a group has one panel for
    each joint, ``across`` panels in a line; the last line of a group may be shorter.

    ``size`` in inches: width of the figure, height of a line, total of the margins above and below;
    ``layout`` is passed to ``Figure.subplots``.
    """
    width, line, margins = size
    lines = -(-joints // across)
    height = margins + line * groups * lines
    figure, grid = panels(width, height, groups * lines, across, sharex=True, **layout)
    axes = grid.reshape(groups, lines * across)
    for empty in axes[:, joints:].flat:
        empty.remove()
    for lowest in axes[-1, :joints][-across:]:
        lowest.tick_params(labelbottom=True)  # also above a removed panel
        lowest.set_xlabel("time (s)")
    return figure, axes[:, :joints]


def model_panels(
    models: Sequence[str],
    joints: Sequence[str],
    quantity: str,
) -> tuple[Figure, np.ndarray]:
    """Return a figure over time and its axes (models, joints) on one scale, a group per model."""
    across = panels_across(len(joints))
    size = (TWO_COLUMNS, 1.25, 0.55)
    figure, grid = joint_panels(
        len(joints),
        across,
        size,
        groups=len(models),
        sharey=True,
    )
    for row, line in zip(grid, model_lines(models).values(), strict=True):
        for first in row[::across]:
            first.set_ylabel(f"{line['label']}\n{quantity}")
    # panels of a model's second line are below panels of other joints
    for row in grid if across < len(joints) else grid[:1]:
        for joint, axes in zip(joints, row, strict=True):
            axes.set_title(joint_label(joint))
    return figure, grid


def panels_across(joints: int) -> int:
    """Return the number of panels in a line: all ``joints``, or half of more than BESIDE joints."""
    return joints if joints <= BESIDE else -(-joints // 2)


def letters(panels: Iterable[Axes], **place: float) -> None:
    """Name the ``panels`` (a), (b), … in their order above the upper left corner of each."""
    for axes, name in zip(panels, "abcdefg", strict=False):
        axes.set_title(f"({name})", loc="left", fontweight="bold", **place)


def legend(figure: Figure, ncols: int = 4) -> Legend:
    """Draw and return one legend above all panels, with the labels of all panels once."""
    entries = {}
    for axes in figure.axes:
        entries |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
    return figure.legend(
        entries.values(),
        entries,
        loc="outside upper center",
        ncols=ncols,
    )


def arrow(
    axes: Axes,
    start,
    end,
    color: str,
    arrowstyle: str = "-|>",
    linewidth: float = 0.8,
):
    """Draw an arrow from ``start`` (2,) to ``end`` (2,)."""
    look = {"arrowstyle": arrowstyle, "color": color, "linewidth": linewidth}
    axes.annotate("", end, start, arrowprops=look | {"shrinkA": 0, "shrinkB": 0})


def save(figure: Figure, folder: Path, name: str) -> None:
    """Write ``name.svg`` and ``name.png`` without date or version: equal bytes every time."""
    # the layout is computed at the PNG's resolution, at which hinted letters are wider
    rasterised = figure.dpi
    figure.set_dpi(PNG_RESOLUTION)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    figure.set_dpi(rasterised)
    # rounded: the layout's last bits differ between runs and change names of clip paths in the SVG
    for axes in figure.axes:
        axes.set_position(np.round(axes.get_position(original=True).bounds, 6))
    # savefig would compute the layout, and so draw every figure, a second time
    FigureCanvasSVG(figure).print_svg(
        folder / f"{name}.svg",
        metadata={"Date": None, "Creator": None},
    )
    figure.set_dpi(PNG_RESOLUTION)
    FigureCanvasAgg(figure).print_png(
        folder / f"{name}.png",
        metadata={"Software": None},
        pil_kwargs={"optimize": True},
    )
