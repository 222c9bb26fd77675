"""Scores on a held-out motion: the noise of two measured poses is in a step, in the fit and in the
prediction.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.stats import multivariate_normal

from pipeline.models.additive.fit import Options, shrunk_covariance
from pipeline.models.other_motions import MotionSteps, matrix_scores, recorded_motions

JOINTS = ("a", "b", "c")
POSE_NOISE = 2e-3
TAKES = 40
STEPS = 60


NOISE = np.array([1e-3, 2e-3, 3e-3])  # rad, standard deviation of a step of each joint
DIRECTIONS = {"1": [1.0, 0.5, -1.0], "2": [-1.0, 1.0, 0.5]}  # of the two motions


@pytest.fixture
def motions(chain) -> list[MotionSteps]:
    """Two motions whose steps have noise of NOISE, of poses measured with POSE_NOISE."""
    rng = default_rng(8)
    listed = []
    for name, direction in DIRECTIONS.items():
        dq = 5e-3 * np.tile(direction, (TAKES, STEPS, 1))
        steps = dq + NOISE * rng.standard_normal(dq.shape)
        true = np.full((TAKES, STEPS + 1, 3), [0.4, 1.7, -0.3])
        true[:, 1:] += np.cumsum(steps, axis=1)
        q = true + POSE_NOISE * rng.standard_normal(true.shape)
        listed.append(MotionSteps(name, q[:, :-1], dq, np.diff(q, axis=1) - dq))
    return listed


def test_a_step_has_the_noise_of_two_measured_poses(chain, motions):
    """Band: four standard errors of a variance, beyond which one pose's noise is."""
    recorded = recorded_motions(chain, motions, JOINTS, POSE_NOISE)
    variance = np.mean(recorded.noise**2, axis=(0, 1))
    stated = np.diag(recorded.measurement) + NOISE**2
    samples = recorded.noise[..., 0].size
    band = 4 * variance * np.sqrt(3 / samples)

    assert np.all(np.abs(stated - variance) < band)
    assert np.all(band < POSE_NOISE**2)


def test_the_prediction_of_a_motion_has_the_measurement_noise_that_the_fit_left_out(
    chain,
    motions,
):
    options = {"additive": Options("additive", estimator="shrinkage")}
    table = matrix_scores(motions, JOINTS, POSE_NOISE, chain, options)
    scores = table.set_index("motion")["score"]

    for scored, trained in zip(motions, motions[::-1], strict=True):
        fitted = recorded_motions(chain, [trained], JOINTS, POSE_NOISE)
        noise = recorded_motions(chain, [scored], JOINTS, POSE_NOISE).noise
        covariance, _ = shrunk_covariance(fitted.noise)
        densities = multivariate_normal(np.zeros(3), covariance).logpdf(noise)
        assert scores[scored.name] == pytest.approx(densities.mean(), rel=1e-9)
