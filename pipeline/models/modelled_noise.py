"""Process noise of a motion model at the recorded poses, measured as recorded noise is."""

from __future__ import annotations

import numpy as np

from pipeline.models.draws import draw_steps
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded, at_recorded_level
from pipeline.statistics.curves import ModelledNoise

DRAWS = 1000  # of a step, over the poses of all takes


def modelled_noise(
    model: MotionModel, recorded: Recorded, rng: np.random.Generator, draws: int = DRAWS
) -> ModelledNoise:
    """Process noise of ``model`` at the poses of ``recorded``, its level solved again for the
    recorded total variance; raises what :func:`pipeline.models.steps.at_recorded_level` raises.
    """
    own, chain, q, v = at_recorded_level(model, recorded), recorded.chain, recorded.q, recorded.v
    covariance = own.covariance(chain, q, v)
    takes = np.resize(np.arange(len(q)), draws)
    noise = draw_steps(own, chain, q[takes], v, rng)[0] - (q + chain.nominal_step(q, v))[takes]
    root = np.linalg.cholesky(recorded.measurement + 1e-30 * np.eye(q.shape[-1]))
    noise += rng.standard_normal(noise.shape) @ root.T
    return ModelledNoise(
        motion=np.diagonal(covariance, axis1=-2, axis2=-1).mean(axis=0),
        measurement=np.diagonal(recorded.measurement),
        error=own.mean(chain, q, v) - recorded.q_next,
        draws=noise,
    )
