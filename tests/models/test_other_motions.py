"""Scores on a held-out motion: the noise of two measured poses is in a step, in the fit and in the
prediction.
"""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pipeline.models.additive.fit import Options, shrunk_covariance
from pipeline.models.other_motions import MotionSteps, matrix_scores, recorded_motions

JOINTS = ("a", "b", "c")
POSE_NOISE = 2e-3
TAKES = 40
STEPS = 60


@pytest.fixture
def motions(chain) -> list[MotionSteps]:
    """Two motions whose steps have noise of 1, 2 and 3 mrad, of poses measured with POSE_NOISE."""
    rng, result = np.random.default_rng(8), []
    for name, direction in (("1", [1.0, 0.5, -1.0]), ("2", [-1.0, 1.0, 0.5])):
        dq = 5e-3 * np.tile(direction, (TAKES, STEPS, 1))
        noise = [1e-3, 2e-3, 3e-3] * rng.standard_normal(dq.shape)
        true = np.concatenate(
            [np.zeros((TAKES, 1, 3)), np.cumsum(dq + noise, axis=1)],
            axis=1,
        )
        q = true + [0.4, 1.7, -0.3] + POSE_NOISE * rng.standard_normal(true.shape)
        result.append(MotionSteps(name, q[:, :-1], dq, np.diff(q, axis=1) - dq))
    return result


def test_a_step_has_the_noise_of_two_measured_poses(chain, motions):
    """Band: four standard errors of a variance, beyond which one pose's noise is."""
    recorded = recorded_motions(chain, motions, JOINTS, POSE_NOISE)
    of_steps = np.array([1e-3, 2e-3, 3e-3]) ** 2
    variance = np.mean(recorded.noise**2, axis=(0, 1))
    band = 4 * variance * np.sqrt(3 / recorded.noise[..., 0].size)
    apart = np.diag(recorded.measurement) + of_steps - variance
    assert np.all(np.abs(apart) < band) and np.all(band < POSE_NOISE**2)


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
        law = multivariate_normal(np.zeros(3), shrunk_covariance(fitted.noise)[0])
        expected = law.logpdf(noise).mean()
        assert scores[scored.name] == pytest.approx(expected, rel=1e-9)
