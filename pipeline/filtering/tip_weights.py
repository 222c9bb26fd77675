"""Weights of particles by a measured pose of the tip, compiled: a block of poses at a time goes
through the forward kinematics.
"""

from __future__ import annotations

import numpy as np

from pipeline.arm.interface import ArmConstants
from pipeline.arm.kinematics import WIDTH, add_displacement, tip
from pipeline.arm.rows import JOINTS
from pipeline.core.compiled import inner
from pipeline.filtering.state import Frames
from pipeline.filtering.weights import add_square

ROWS = 6  # of a displacement


@inner
def weigh_tip(
    arm: ArmConstants,
    frames: Frames,
    frame: int,
    before: np.ndarray,
    q: np.ndarray,
    log_weights: np.ndarray,
    scratch: np.ndarray,
) -> None:
    """Add to ``log_weights`` (P,) the log-likelihood of ``frame``, a pose of the tip of ``arm``, at
    its share of the way from ``before`` to ``q`` (n, P); ``scratch`` (n, P) or more is overwritten.
    """
    n, share, log_norm = len(q), frames.share[frame], frames.log_norm[frame]
    white, measured = frames.whitening[frame], frames.unbiased[frame]
    # the whole pose, in metres and radians, whatever the task
    whole = ArmConstants(
        arm.plane, arm.frames, arm.sliding, np.arange(ROWS), np.ones(ROWS), arm.least
    )
    first = JOINTS + 6 * n
    block = np.empty((first + ROWS, WIDTH))
    way, whitened, square = block[first:], np.empty(WIDTH), np.empty(WIDTH)
    for start in range(0, len(log_weights), WIDTH):
        count = WIDTH if start + WIDTH < len(log_weights) else len(log_weights) - start
        stop = start + count
        for j in range(n):
            here, there = before[j, start:stop], q[j, start:stop]
            pose = scratch[j, start:stop]
            for i in range(count):
                pose[i] = here[i] + share * (there[i] - here[i])
        tip(whole, scratch, start, count, block)
        way[:], square[:] = 0.0, 0.0
        add_displacement(whole, measured, block, first, 1.0, count)
        for j in range(ROWS):
            add_square(white, j, way, whitened, square, count)
        total = log_weights[start:stop]
        for i in range(count):
            total[i] += log_norm - 0.5 * square[i]
