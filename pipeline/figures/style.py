"""One look for every figure: print sizes, a colour-blind-safe palette, one line style per motion
model, and files that keep their bytes.

Colours are those of Okabe and Ito (jfly.uni-koeln.de/color, 2008); lines that share axes also
differ in their dashes, so that they can be told apart in grey. Widths are those of one and of two
columns of a journal page; no letter is smaller than 7 pt at that size.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

ONE_COLUMN, TWO_COLUMNS = 3.5, 7.16  # in
PNG_RESOLUTION = 200  # dots per inch

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#999999"
LIGHT_GREY = "#CCCCCC"

RECORDED = {"label": "recorded", "color": VERMILLION, "linestyle": "-"}
MODELS = {
    "additive": {"label": "additive Gaussian noise", "color": SKY, "linestyle": ":"},
    "wishart": {"label": "Wishart perturbation", "color": BLUE, "linestyle": "--"},
    "gaussian": {"label": "Gaussian noise matrix", "color": BLACK, "linestyle": "-."},
    "scaled": {
        "label": "scaled with speed, by joint",
        "color": GREEN,
        "linestyle": (0, (6, 1.5, 1, 1.5, 1, 1.5)),
    },
    "none": {"label": "no filter", "color": GREY, "linestyle": "-"},
    "scaled_full": {"label": "scaled with speed, full", "color": PURPLE, "linestyle": (0, (8, 2))},
}
# models of other names take these in turn
FURTHER = [
    {"color": GREEN, "linestyle": (0, (4, 3))},
    {"color": PURPLE, "linestyle": (0, (2, 2, 6, 2))},
    {"color": ORANGE, "linestyle": (0, (10, 1.5, 2, 1.5))},
]
JOINTS = [
    {"color": BLUE, "linestyle": "-"},
    {"color": VERMILLION, "linestyle": "--"},
    {"color": GREEN, "linestyle": "-."},
    {"color": PURPLE, "linestyle": ":"},
    {"color": SKY, "linestyle": (0, (6, 2))},
    {"color": ORANGE, "linestyle": (0, (3, 1, 1, 1))},
    {"color": BLACK, "linestyle": (0, (1, 1))},
    {"color": GREY, "linestyle": (0, (8, 1.5, 1, 1.5))},
]
BESIDE = 4  # joints at most whose panels stand in one line

# from the defaults, so that a matplotlibrc of the user's changes no byte
mpl.rcdefaults()
mpl.rcParams.update(
    {
        "font.family": "STIXGeneral",  # comes with matplotlib: the same letters on every machine
        "mathtext.fontset": "stix",
        "font.size": 8,
        "axes.titlesize": 8,
        "axes.labelsize": 8,
        "xtick.labelsize": 7.5,
        "ytick.labelsize": 7.5,
        "legend.fontsize": 7.5,
        "legend.frameon": False,
        "legend.handlelength": 2.6,
        "axes.linewidth": 0.5,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "xtick.major.width": 0.5,
        "ytick.major.width": 0.5,
        "xtick.major.size": 2.5,
        "ytick.major.size": 2.5,
        "lines.linewidth": 1.0,
        "figure.dpi": 300,  # of what is rasterised in the SVG
        "svg.hashsalt": "manipulator-uncertainty",
        "svg.fonttype": "path",
    }
)


def model_lines(models: Iterable[str]) -> dict[str, dict]:
    """Label, colour and dashes of every model by its option's name; other names get the next style
    of a cycle.
    """
    further = [model for model in models if model not in MODELS]
    return {
        model: MODELS[model]
        if model in MODELS
        else {"label": model} | FURTHER[further.index(model) % len(FURTHER)]
        for model in models
    }


def joint_lines(joints: Sequence[str]) -> dict[str, dict]:
    """Label, colour and dashes of every joint by its name."""
    looks = [JOINTS[j % len(JOINTS)] for j in range(len(joints))]
    return {
        joint: {"label": joint.replace("_", " ")} | look
        for joint, look in zip(joints, looks, strict=True)
    }


def panels(
    width: float, height: float, rows: int = 1, columns: int = 1, **layout: object
) -> tuple[Figure, np.ndarray]:
    """A figure of ``width`` × ``height`` in inches and its axes (rows, columns); ``layout`` goes to
    ``Figure.subplots``.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **layout)


def joint_panels(
    joints: int, across: int, size: tuple[float, float, float], groups: int = 1, **layout: object
) -> tuple[Figure, np.ndarray]:
    """A figure over time and its axes (``groups``, ``joints``): of each group a panel for each
    joint, ``across`` of them in a line, the last line of a group as short as it comes.

    Args:
        joints: how many.
        across: panels in a line.
        size: inches: the width of the figure, the height of a line, and what is above and below.
        groups: lines of panels of the same joints, one group below the other.
        layout: goes to ``Figure.subplots``.
    """
    width, line, rest = size
    lines = -(-joints // across)
    figure, grid = panels(
        width, rest + line * groups * lines, groups * lines, across, sharex=True, **layout
    )
    axes = grid.reshape(groups, lines * across)
    for empty in axes[:, joints:].flat:
        empty.remove()
    for lowest in axes[-1, :joints][-across:]:
        lowest.tick_params(labelbottom=True)  # also where the panel below was empty
        lowest.set_xlabel("time (s)")
    return figure, axes[:, :joints]


def beside(joints: int) -> int:
    """Number of panels of ``joints`` in a line over two columns: all, or half of more than
    ``BESIDE``.
    """
    return joints if joints <= BESIDE else -(-joints // 2)


def letter(axes: Axes, name: str) -> None:
    """Name a panel (a), (b), … above its upper left corner, as the paper's captions do."""
    axes.set_title(f"({name})", loc="left", fontweight="bold")


def save(figure: Figure, folder: Path, name: str) -> None:
    """Write ``folder/name.svg`` and ``folder/name.png`` without date or version: the same figure
    gives the same bytes.
    """
    # laid out at the PNG's resolution, at which hinted letters are the wider
    rasterised = figure.dpi
    figure.set_dpi(PNG_RESOLUTION)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    figure.set_dpi(rasterised)
    # the layout's solver differs in its last bits from run to run, and the names of clip paths in
    # the SVG are hashes of all bits
    for axes in figure.axes:
        axes.set_position(np.round(axes.get_position(original=True).bounds, 6))
    # not savefig, which draws every figure twice: once more for a layout that has been found
    FigureCanvasSVG(figure).print_svg(
        folder / f"{name}.svg", metadata={"Date": None, "Creator": None}
    )
    figure.set_dpi(PNG_RESOLUTION)
    FigureCanvasAgg(figure).print_png(
        folder / f"{name}.png", metadata={"Software": None}, pil_kwargs={"optimize": True}
    )
