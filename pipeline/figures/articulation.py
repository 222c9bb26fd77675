"""Articulation of the arm in the depth camera's point cloud.

Points of the arm in the plane of its motion and the three segments O1–O2–O3–EE fitted to them, (a)
in the first frame of a test take, the initial and final configuration, and (b) in the frame with
the end-effector farthest from O1, the most extended configuration. The segments should run through
the middle of the points of each link; their lengths may vary within a range.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"cloud": "data/articulate", "skeleton": "data/articulate"}
NEEDS = "depth camera"
LABEL_DISTANCE = 13  # pt from the node, on the outer side of the bend


def draw(cloud: pd.DataFrame, skeleton: pd.DataFrame) -> Figure:
    """Fig. (KinOptFig): one panel per view, both on the same scale."""
    extent = cloud[["x", "z"]].max() - cloud[["x", "z"]].min()
    height = 1.6 + 2 * (style.ONE_COLUMN - 0.6) * extent["z"] / extent["x"]
    figure, grid = style.panels(style.ONE_COLUMN, height, rows=2, sharex=True, sharey=True)
    for axes, (name, view) in zip(grid[:, 0], (("a", "initial"), ("b", "extended")), strict=True):
        points, nodes = (
            table.loc[table["view"] == view, ["x", "z"]].to_numpy() for table in (cloud, skeleton)
        )
        dots = {"color": style.SKY, "markersize": 1.8, "markeredgewidth": 0, "rasterized": True}
        axes.plot(*points.T, ".", label="point cloud", **dots)
        rings = {"color": style.VERMILLION, "markersize": 3.5, "markerfacecolor": "white"}
        axes.plot(*nodes.T, "o-", label="fitted segments", **rings)
        for text, node, side in zip(("O1", "O2", "O3", "EE"), nodes, _outer(nodes), strict=True):
            place = {"xytext": LABEL_DISTANCE * side, "textcoords": "offset points"}
            axes.annotate(text, node, **place, ha="center", va="center")
        axes.set(ylabel="z (m)", aspect="equal")
        axes.margins(0.12, 0.2)
        style.letter(axes, name)
    grid[-1, 0].set_xlabel("x (m)")
    style.legend(figure, ncols=2).legend_handles[0].set_markersize(4)
    return figure


def _outer(nodes: np.ndarray) -> np.ndarray:
    """(4, 2) unit vectors from every node away from its neighbours; up at a straight joint."""
    before, after = np.roll(nodes, 1, axis=0), np.roll(nodes, -1, axis=0)
    before[0], after[-1] = nodes[1], nodes[-2]
    away = 2 * nodes - before - after
    away[~away.any(axis=1)] = (0.0, 1.0)
    return away / np.linalg.norm(away, axis=1, keepdims=True)
