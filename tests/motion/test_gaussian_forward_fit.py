"""Maximum likelihood of the forward form returns what the data were drawn with, along the ridge."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import ModelDomainError
from pipeline.motion.gaussian import frobenius
from pipeline.motion.gaussian_forward import GaussianForwardModel
from pipeline.motion.gaussian_forward_fit import forward_likelihood

MEASUREMENT = np.array([[0.6, -0.6, 0.0], [-0.6, 1.5, -0.9], [0.0, -0.9, 1.7]]) * 1e-6
SPEEDS = np.concatenate([[0.0, 0.0], np.geomspace(0.05, 1.0, 18)])  # a start from rest, as shares of the step
EXTENSIONS = np.geomspace(0.02, 1.0, 7)


def recordings(chain, poses, step, model, *, takes: int, seed: int):
    """Poses, commanded steps and measured noise of the model's own steps."""
    rng = np.random.default_rng(seed)
    v = SPEEDS[:, None] * step
    q = np.tile(poses[: len(v)], (takes, 1, 1))
    drawn, _ = model.sample(chain, q, np.broadcast_to(v, q.shape), rng)
    noise = drawn - q - np.matvec(chain.inverse_jacobian(q), v)
    return q, v, noise + rng.multivariate_normal(np.zeros(3), MEASUREMENT, noise.shape[:-1])


@pytest.mark.parametrize("std", [0.03, 0.3])
def test_the_level_comes_back_along_the_ridge(chain, poses, step, std):
    """540 scalar residuals of 180 steps leave a relative error of about 1/sqrt(2·540) = 3 % of √s."""
    norms = frobenius(chain.jacobian(poses[: len(SPEEDS)]))
    u = 1.3 * float(norms.max())
    true = GaussianForwardModel(3 * std / np.sqrt(u**2 - np.mean(norms**2)), u)
    q, v, noise = recordings(chain, poses, step, true, takes=10, seed=1)

    def level(alpha: float, bound: float) -> float:
        return alpha * np.sqrt(bound**2 - np.mean(norms[2:] ** 2)) / 3

    likelihood = forward_likelihood(chain, q, v, noise, MEASUREMENT)
    fit = likelihood.fit(EXTENSIONS)
    assert abs(level(fit.alpha, fit.u) / std - 1) < 0.1
    assert fit.u > norms.max() and fit.extension == pytest.approx(fit.u - norms[2:].max())
    # the ridge: over bounds that differ in u² − ‖J‖² by a factor above ten the level stays, and α makes up for it
    wide = fit.extensions > 0.2 * norms.max()
    levels = level(fit.alphas[wide], norms[2:].max() + fit.extensions[wide])
    np.testing.assert_allclose(levels, levels[-1], rtol=0.05)
    assert fit.alphas[-1] < 0.5 * fit.alphas[wide][0]
    # the interpolation over ln s against the model itself, and that neighbours are worse
    q_next = q + np.matvec(chain.inverse_jacobian(q), v) + noise

    def objective(alpha: float) -> float:
        return -GaussianForwardModel(alpha, fit.u).log_density(chain, q[:, 2:], v[2:], q_next[:, 2:], MEASUREMENT).sum()

    assert objective(fit.alpha) == pytest.approx(fit.objective, abs=0.2)
    assert min(objective(0.85 * fit.alpha), objective(1.15 * fit.alpha)) > fit.objective + 1
    # a take named twice counts twice
    assert likelihood.of(np.repeat(np.arange(10), 2)).fit(EXTENSIONS).objective == pytest.approx(2 * fit.objective, rel=1e-6)
    # control: a level a third off is far less likely
    assert objective(1.33 * fit.alpha) > fit.objective + 5


def test_a_motion_at_rest_throughout_is_refused(chain, poses):
    q = np.tile(poses[:5], (3, 1, 1))
    with pytest.raises(ModelDomainError, match="at rest at every step"):
        forward_likelihood(chain, q, np.zeros((5, 3)), np.zeros(q.shape), MEASUREMENT)
