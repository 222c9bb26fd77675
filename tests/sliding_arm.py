"""Arms of sliding joints, whose Jacobian is the same at every pose: under normal noise the particle
filter has the Kalman filter for its exact posterior.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.layout import Layout
from pipeline.arm.serial import SerialChain


def sliding_arm(axes: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> SerialChain:
    """Three joints that slide along the unit vectors ``axes`` (3, 3), a row a joint."""
    layout = Layout(
        names=("a", "b", "c"),
        sliding=np.ones(3, dtype=bool),
        axes=np.asarray(axes, dtype=float),
        points=np.zeros((3, 3)),
        rotation=np.eye(3),
        position=np.zeros(3),
        lower=lower,
        upper=upper,
        max_speed=np.ones(3),
    )
    ends = layout.lower, layout.upper, layout.max_speed
    return SerialChain(("x", "y", "z"), 1.0, layout.placements(), layout.sliding, *ends)
