"""Arms of sliding joints, whose Jacobian is the same at every pose: under normal noise the particle
filter has the Kalman filter for its exact posterior.
"""

import numpy as np

from pipeline.arm.chain import SerialChain


def sliding_arm(axes: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> SerialChain:
    """Three joints that slide along the unit vectors ``axes`` (3, 3), a row a joint."""
    placements = []
    before = np.eye(3)
    for axis in np.asarray(axes, dtype=float):
        # its third column along the axis
        frame = np.linalg.svd(axis[None])[2].T[:, [1, 2, 0]]
        frame[:, 2] = axis
        frame[:, 0] *= np.sign(np.linalg.det(frame))
        placements.append([*(before.T @ frame).ravel(), 0.0, 0.0, 0.0])
        before = frame
    placements.append([*before.T.ravel(), 0.0, 0.0, 0.0])
    limits = lower, upper, np.ones(3)
    return SerialChain(
        ("x", "y", "z"),
        1.0,
        np.array(placements),
        np.ones(3, bool),
        *limits,
    )
