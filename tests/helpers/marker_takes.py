"""Markers on the three segments of a planar arm."""

import numpy as np

from pipeline.arm.chain import segment_frames

# (links, markers, 3) m, in the frames of the links
PLACES = np.array([
    [[0.032, -0.048, 0.018], [-0.030, -0.052, 0.071], [0.024, -0.045, 0.139]],
    [[-0.033, -0.046, 0.022], [0.029, -0.055, 0.058], [-0.021, -0.042, 0.121]],
    [[0.030, -0.043, 0.012], [-0.031, -0.050, 0.041], [0.012, -0.038, 0.104]],
])  # fmt: skip


def marker_places(q: np.ndarray, template: np.ndarray, chain) -> np.ndarray:
    """(..., n, K, 3) m in the plane's frame, where the arm at ``q`` (..., n) carries the points at
    ``template`` (n, K, 3) of its segments.
    """
    rotation, origin = segment_frames(chain, q)
    return origin[..., None, :] + template @ np.swapaxes(rotation, -1, -2)
