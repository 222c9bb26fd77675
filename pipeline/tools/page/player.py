"""The player: plots of one take, and what a slider sets in them at each depth frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.figures.style import ORANGE, RECORDED, VERMILLION, model_lines
from pipeline.tools.page.frames import MILLI, SPREAD, frames_of, spread_axes
from pipeline.tools.page.plots import Axis, Panel, Plot, band, dots, line, stroke
from pipeline.tools.page.posterior import Posterior
from pipeline.tools.page.scene import Scene, scene_data
from pipeline.tools.page.take import Pictures, Take

BANDS = ((2, "#E4E4E4"), (1, "#B8B8B8"))  # standard deviations, widest first
STILL = 0.002  # rad on either side of the angles of a joint that stands still
LEFT, GAP, BELOW = 58, 14, 40  # px: letters left of a panel, between panels, below the last
PAIRS = 2  # of joints beside each other
ANGLES, ERRORS = (560, 116), (380, 112)  # px: width and height of panels


@dataclass(frozen=True)
class Player:
    """What the page plays: ``models`` by name with their labels and lines' styles, the plot of the
    ``angles``, of each model's ``errors`` and ``spreads``, and the ``frames``, which the page's
    script shows one at a time.

    The arm is shown in images of a ``size`` in px, or as a ``scene`` that the script turns.
    ``filtered``: whether the models are those of filters, and not one step ahead.
    """

    take: str
    joints: list[str]
    models: Mapping[str, tuple[str, str]]
    angles: Plot
    errors: Mapping[str, Plot]
    spreads: Mapping[str, Plot]
    size: tuple[int, int] | None
    scene: dict | None
    filtered: bool
    frames: list[dict]


def player(take: Take) -> Player:
    """The player of ``take``."""
    looks = model_lines(list(take.posteriors))
    styles = {model: stroke(look["color"], look["linestyle"]) for model, look in looks.items()}
    joints = [joint.replace("_", " ") for joint in take.joints]
    truth = np.column_stack([np.interp(take.frame_t, take.t, q) for q in take.truth.T])
    measured = None if take.frame_q is None else MILLI * (take.frame_q - truth)
    errors = {m: MILLI * (of_m.mean - take.truth) for m, of_m in take.posteriors.items()}
    bounds = {m: MILLI * _std(of_m) for m, of_m in take.posteriors.items()}
    # where a frame lies: at the first step that is not before it
    steps = np.searchsorted(take.t, take.frame_t.clip(take.t[0], take.t[-1]) - 1e-9)
    extents = np.concatenate([np.maximum(abs(errors[m]), 2 * bounds[m]) for m in looks])
    # (n,) mrad, all but a hundredth of the steps; a joint that no model moves has an axis too
    reach = np.quantile(extents, 0.99, axis=0).clip(1e-6)
    shown = frames_of(take, steps, measured, errors, bounds, reach)
    return Player(
        take.name,
        joints,
        {model: (look["label"], styles[model]) for model, look in looks.items()},
        _angles(take, joints, styles),
        {
            m: _errors(take, joints, measured, errors[m], bounds[m], styles[m], reach.max())
            for m in looks
        },
        {m: _spread(joints, reach) for m in looks},
        take.view.size if isinstance(take.view, Pictures) else None,
        scene_data(take.view) if isinstance(take.view, Scene) else None,
        all(posterior.ess is not None for posterior in take.posteriors.values()),
        shown,
    )


def _std(posterior: Posterior) -> np.ndarray:
    """(K, n) rad."""
    return np.sqrt(np.diagonal(posterior.covariance, axis1=1, axis2=2))


def _stacked(size: tuple[int, int], panels: list[Panel]) -> Plot:
    return Plot(LEFT + size[0] + 6, panels[-1].top + size[1] + BELOW, panels)


def _below(row: int, height: float) -> float:
    return 6 + row * (height + GAP)


def _angles(take: Take, joints: list[str], styles: Mapping[str, str]) -> Plot:
    """The angles themselves: motion capture, depth camera, estimates."""
    width, height = ANGLES
    x = Axis(0.0, float(take.t[-1]), width)
    panels = []
    for j, joint in enumerate(joints):
        by_depth = [] if take.frame_q is None else [take.frame_q[:, j]]
        means = [p.mean[:, j] for p in take.posteriors.values()]
        y = _padded(np.concatenate([take.truth[:, j], *by_depth, *means]), height)
        shapes = [
            line(x, y, take.t, take.truth[:, j], stroke(RECORDED["color"], width=3)),
            *(dots(x, y, take.frame_t, angles, ORANGE) for angles in by_depth),
            *(line(x, y, take.t, p.mean[:, j], styles[m]) for m, p in take.posteriors.items()),
        ]
        last = j == len(joints) - 1
        label = f"{joint} (rad)"
        panels.append(
            Panel(x, y, LEFT, _below(j, height), label, shapes, "time (s)" if last else "")
        )
    return _stacked(ANGLES, panels)


def _padded(values: np.ndarray, height: float) -> Axis:
    low, high = float(values.min()), float(values.max())
    margin = max(0.05 * (high - low), STILL)
    return Axis(low - margin, high + margin, height, reversed=True)


def _errors(
    take: Take,
    joints: list[str],
    measured: np.ndarray | None,
    error: np.ndarray,
    bound: np.ndarray,
    style: str,
    largest: float,
) -> Plot:
    """The estimate minus the truth with bounds of one and two standard deviations.

    Args:
        take: that is played.
        joints: names to be read.
        measured: (F, n) mrad, the deviations of a depth camera, where there is one.
        error: (K, n) mrad.
        bound: (K, n) mrad, one standard deviation.
        style: of the model's line.
        largest: mrad, end of the axes: one scale for models side by side.
    """
    width, height = ERRORS
    coarse = np.unique(np.append(np.arange(0, len(take.t), 2), len(take.t) - 1))  # 2 px wide
    x = Axis(0.0, float(take.t[-1]), width)
    y = Axis(-float(largest), float(largest), height, reversed=True)
    panels = []
    for j, joint in enumerate(joints):
        e, b = error[:, j], bound[:, j]
        shapes = [
            *(
                band(x, y, take.t[coarse], (e - k * b)[coarse], (e + k * b)[coarse], colour)
                for k, colour in BANDS
            ),
            line(x, y, take.t[[0, -1]], np.zeros(2), stroke(VERMILLION, width=1)),
            *(() if measured is None else (dots(x, y, take.frame_t, measured[:, j], ORANGE),)),
            line(x, y, take.t, e, style),
        ]
        last = j == len(joints) - 1
        label = f"{joint} (mrad)"
        panels.append(
            Panel(x, y, LEFT, _below(j, height), label, shapes, "time (s)" if last else "")
        )
    return _stacked(ERRORS, panels)


def _spread(joints: list[str], reach: np.ndarray) -> Plot:
    """Axes for the particles' spread in each pair of neighbouring joints about the truth, which is
    the cross in the middle.
    """
    panels = []
    for place, (i, j) in enumerate(pairwise(range(len(joints)))):
        x, y = spread_axes(i, j, reach)
        zero = np.zeros(2)
        cross = stroke(VERMILLION, width=1)
        shapes = [
            line(x, y, np.array([x.low, x.high]), zero, cross),
            line(x, y, zero, np.array([y.low, y.high]), cross),
        ]
        row, column = divmod(place, PAIRS)
        left, top = LEFT + column * (SPREAD + LEFT + 6), 6 + row * (SPREAD + BELOW + GAP)
        panels.append(Panel(x, y, left, top, f"{joints[j]} (mrad)", shapes, f"{joints[i]} (mrad)"))
    right, below = (max((getattr(p, side) for p in panels), default=0) for side in ("left", "top"))
    return Plot(right + SPREAD + 12, below + SPREAD + BELOW, panels)
