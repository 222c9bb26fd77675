"""Recorded steps that a model draws."""

import numpy as np
from numpy.random import default_rng

from pipeline.models.draws import draw_steps
from pipeline.models.steps import Recorded


def drawn_recording(arm, q, v, measured, model, takes: int) -> Recorded:
    """Takes of steps that begin at the poses ``q`` (M, n) and are drawn from the ``model``, each
    measured with noise of the covariance ``measured`` (n, n).
    """
    rng = default_rng(1)
    n = q.shape[1]
    poses = np.tile(q, (takes, 1, 1))
    moved, _ = draw_steps(model, arm, poses, v, rng)
    errors = rng.multivariate_normal(np.zeros(n), measured, poses.shape[:2])
    noise = moved - poses - arm.nominal_step(poses, v) + errors
    joints = tuple(f"joint_{j}" for j in range(n))
    return Recorded(arm, poses, v, noise, joints, measured)
