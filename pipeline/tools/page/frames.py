"""What the page's script sets at each depth frame or step of the player, ready to be set."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from pipeline.tools.page.pictures import address
from pipeline.tools.page.plots import Axis
from pipeline.tools.page.scene import Scene, scene_frame
from pipeline.tools.page.take import Pictures, Take

MILLI = 1e3  # deviations are shown in mrad
SPREAD = 120  # px: width and height of a panel of two joints


def spread_axes(i: int, j: int, reach: np.ndarray) -> tuple[Axis, Axis]:
    """Of the panel of joints ``i`` and ``j``, which reach (n,) mrad from the truth."""
    across, up = float(reach[i]), float(reach[j])
    return Axis(-across, across, SPREAD), Axis(-up, up, SPREAD, reversed=True)


def frames_of(
    take: Take,
    steps: np.ndarray,
    measured: np.ndarray | None,
    errors: Mapping[str, np.ndarray],
    bounds: Mapping[str, np.ndarray],
    reach: np.ndarray,
) -> list[dict]:
    """What is shown at each frame, ready to be set: place of the cursor in % of the time, the arm,
    dots of the camera, and of each model its ellipses and numbers.

    Args:
        take: that is played.
        steps: (F,) the step of each frame.
        measured: (F, n) mrad, the deviations of a depth camera, where there is one.
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
            if posterior.ess is not None:
                texts.append(f"{posterior.ess[k]:.0f}")
            models[model] = {
                "texts": texts,
                "ellipses": _ellipses(e, MILLI**2 * posterior.covariance[k], reach),
            }
        frame = {
            "t": f"{take.frame_t[f]:.2f}",
            "cursor": round(100 * float(take.frame_t[f] / take.t[-1]), 2),
            "models": models,
        }
        if measured is not None:
            frame["dots"] = _dots(measured[f], reach)
        frames.append(frame | _arm(take.view, f))
    return frames


def _arm(view: Pictures | Scene, frame: int) -> dict:
    """The arm at a frame: an image with the links in px, or its nodes and tips in space."""
    if isinstance(view, Scene):
        return scene_frame(view, frame)
    links = " ".join(f"{u:.1f},{v:.1f}" for u, v in view.nodes[frame])
    return {"image": address(view.images[frame]), "links": links}


def _dots(measured: np.ndarray, reach: np.ndarray) -> list[list[float]]:
    """px of the depth camera's deviation in each pair of joints."""
    axes = [(i, j, *spread_axes(i, j, reach)) for i, j in pairwise(range(len(measured)))]
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
        x, y = spread_axes(i, j, reach)
        variances, axes = np.linalg.eigh(covariance[np.ix_([i, j], [i, j])])
        root = axes * np.sqrt(np.maximum(variances, 0.0))
        scale = np.array([SPREAD / (x.high - x.low), -SPREAD / (y.high - y.low)])
        (a, c), (b, d) = scale[:, None] * root
        numbers = (a, b, c, d, x.place(mean[i]), y.place(mean[j]))
        transforms.append(f"matrix({' '.join(f'{number:.2f}' for number in numbers)})")
    return transforms
