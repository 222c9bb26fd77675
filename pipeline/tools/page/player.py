"""The player: plots of one take, and what a slider sets in them at each depth frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.figures.style import ORANGE, RECORDED, VERMILLION, model_lines
from pipeline.tools.page.pictures import address
from pipeline.tools.page.plots import Axis, Panel, Plot, band, dots, line, stroke
from pipeline.tools.page.take import Posterior, Take

MILLI = 1e3  # deviations are shown in mrad
BANDS = ((2, "#E4E4E4"), (1, "#B8B8B8"))  # standard deviations, widest first
LEFT, GAP, BELOW = 58, 14, 40  # px: letters left of a panel, between panels, below the last
ANGLES, ERRORS, SPREAD = (560, 116), (380, 112), 120  # px: width and height of panels


@dataclass(frozen=True)
class Player:
    """What the page plays: ``models`` by name with their labels and lines' styles, the plot of the
    ``angles``, of each model's ``errors`` and ``spreads``, the ``size`` of an image in px, and the
    ``frames``, which the page's script shows one at a time.
    """

    take: str
    joints: list[str]
    models: Mapping[str, tuple[str, str]]
    angles: Plot
    errors: Mapping[str, Plot]
    spreads: Mapping[str, Plot]
    size: tuple[int, int]
    frames: list[dict]


def player(take: Take) -> Player:
    """The player of ``take``."""
    looks = model_lines(list(take.posteriors))
    styles = {model: stroke(look["color"], look["linestyle"]) for model, look in looks.items()}
    joints = [joint.replace("_", " ") for joint in take.joints]
    truth = np.column_stack([np.interp(take.frame_t, take.t, q) for q in take.truth.T])
    measured = MILLI * (take.frame_q - truth)
    errors = {m: MILLI * (of_m.mean - take.truth) for m, of_m in take.posteriors.items()}
    bounds = {m: MILLI * _std(of_m) for m, of_m in take.posteriors.items()}
    # where a frame lies: at the first step that is not before it
    steps = np.searchsorted(take.t, take.frame_t.clip(take.t[0], take.t[-1]) - 1e-9)
    extents = np.concatenate([np.maximum(abs(errors[m]), 2 * bounds[m]) for m in looks])
    reach = np.quantile(extents, 0.99, axis=0)  # (n,) mrad, all but a hundredth of the steps
    shown = _frames(take, steps, measured, errors, bounds, reach)
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
        take.size,
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
        drawn = [
            take.truth[:, j],
            take.frame_q[:, j],
            *(p.mean[:, j] for p in take.posteriors.values()),
        ]
        y = _padded(np.concatenate(drawn), height)
        shapes = [
            line(x, y, take.t, take.truth[:, j], stroke(RECORDED["color"], width=3)),
            dots(x, y, take.frame_t, take.frame_q[:, j], ORANGE),
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
    margin = 0.05 * (high - low) or 0.01
    return Axis(low - margin, high + margin, height, reversed=True)


def _errors(
    take: Take,
    joints: list[str],
    measured: np.ndarray,
    error: np.ndarray,
    bound: np.ndarray,
    style: str,
    largest: float,
) -> Plot:
    """The estimate minus the truth with bounds of one and two standard deviations.

    Args:
        take: that is played.
        joints: names to be read.
        measured: (F, n) mrad, the depth camera's deviations.
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
            dots(x, y, take.frame_t, measured[:, j], ORANGE),
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
        x, y = _spread_axes(i, j, reach)
        zero = np.zeros(2)
        cross = stroke(VERMILLION, width=1)
        shapes = [
            line(x, y, np.array([x.low, x.high]), zero, cross),
            line(x, y, zero, np.array([y.low, y.high]), cross),
        ]
        left = LEFT + place * (SPREAD + LEFT + 6)
        panels.append(Panel(x, y, left, 6, f"{joints[j]} (mrad)", shapes, f"{joints[i]} (mrad)"))
    return Plot(panels[-1].left + SPREAD + 12, SPREAD + 6 + BELOW, panels)


def _spread_axes(i: int, j: int, reach: np.ndarray) -> tuple[Axis, Axis]:
    across, up = float(reach[i]), float(reach[j])
    return Axis(-across, across, SPREAD), Axis(-up, up, SPREAD, reversed=True)


def _frames(
    take: Take,
    steps: np.ndarray,
    measured: np.ndarray,
    errors: Mapping[str, np.ndarray],
    bounds: Mapping[str, np.ndarray],
    reach: np.ndarray,
) -> list[dict]:
    """What is shown at each frame, ready to be set: place of the cursor in % of the time, image,
    links, dots of the camera, and of each model its ellipses and numbers.

    Args:
        take: that is played.
        steps: (F,) the step of each frame.
        measured: (F, n) mrad, the depth camera's deviations.
        errors: by model (K, n) mrad.
        bounds: by model (K, n) mrad, one standard deviation.
        reach: (n,) mrad, ends of the axes of the spread.
    """
    frames = []
    for f, k in enumerate(steps):
        models = {}
        for model, posterior in take.posteriors.items():
            e, b = errors[model][k], bounds[model][k]
            texts = [f"{error:.1f} ± {bound:.1f}" for error, bound in zip(e, b, strict=True)]
            models[model] = {
                "texts": [*texts, f"{posterior.ess[k]:.0f}"],
                "ellipses": _ellipses(e, MILLI**2 * posterior.covariance[k], reach),
            }
        frames.append(
            {
                "t": f"{take.frame_t[f]:.2f}",
                "cursor": round(100 * float(take.frame_t[f] / take.t[-1]), 2),
                "image": address(take.images[f]),
                "links": " ".join(f"{u:.1f},{v:.1f}" for u, v in take.nodes[f]),
                "dots": _dots(measured[f], reach),
                "models": models,
            }
        )
    return frames


def _dots(measured: np.ndarray, reach: np.ndarray) -> list[list[float]]:
    """px of the depth camera's deviation in each pair of joints."""
    axes = [(i, j, *_spread_axes(i, j, reach)) for i, j in pairwise(range(len(measured)))]
    return [
        [round(float(x.place(measured[i])), 1), round(float(y.place(measured[j])), 1)]
        for i, j, x, y in axes
    ]


def _ellipses(mean: np.ndarray, covariance: np.ndarray, reach: np.ndarray) -> list[str]:
    """For each pair of joints the transform of the unit circle into the outline of one standard
    deviation, from mrad and mrad².
    """
    transforms = []
    for i, j in pairwise(range(len(mean))):
        x, y = _spread_axes(i, j, reach)
        variances, axes = np.linalg.eigh(covariance[np.ix_([i, j], [i, j])])
        root = axes * np.sqrt(np.maximum(variances, 0.0))
        scale = np.array([SPREAD / (x.high - x.low), -SPREAD / (y.high - y.low)])
        (a, c), (b, d) = scale[:, None] * root
        numbers = (a, b, c, d, x.place(mean[i]), y.place(mean[j]))
        transforms.append(f"matrix({' '.join(f'{number:.2f}' for number in numbers)})")
    return transforms
