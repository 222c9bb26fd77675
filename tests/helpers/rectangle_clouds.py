"""An arm of three rectangles as points in its plane, and a motion of it."""

from itertools import pairwise

import numpy as np
from planar_poses import LENGTHS, planar_chain

CHAIN = planar_chain(0.01, 0.115, limit=3.1)


def motion(frames: int = 97) -> np.ndarray:
    """Joint angles out and back: elbow from 135° to 65°, the wrist through the stretched pose, 1.2
    to 1.3 rad a joint.
    """
    phase = (1 - np.cos(np.linspace(0, 2 * np.pi, frames))) / 2
    first = np.array([-55.0, 135.0, -60.0])
    way = np.array([75.0, -70.0, 75.0])
    return np.radians(first + phase[:, None] * way)


def cloud(q: np.ndarray, rng: np.random.Generator, *, points: int = 1500) -> np.ndarray:
    """Points of three rectangles, ever denser towards one side and one end of each, with normal
    noise (m).
    """
    count = points // 3
    width = 0.06  # m
    rectangles = []
    for j, (start, end) in enumerate(pairwise(CHAIN.points(q))):
        along = (end - start) / LENGTHS[j]
        aside = np.array([along[1], -along[0]])
        s, n = rng.random((2, count))
        exponent = 0.7 if j == 1 else 1.5
        lengthwise = s**0.8 * LENGTHS[j]
        sideways = (n**exponent - 0.5) * width
        way = np.outer(lengthwise, along)
        rectangles.append(start + way + np.outer(sideways, aside))

    noise = rng.normal(scale=0.002, size=(3 * count, 2))
    return np.concatenate(rectangles) + noise


def limits(share: float = 0.05) -> np.ndarray:
    """(3, 2) the bounds on the lengths of the segments, m."""
    return LENGTHS[:, None] * np.array([1 - share, 1 + share])
