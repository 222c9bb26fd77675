"""Maximum likelihood returns what the data were drawn with, where the stated measurement noise is
that of the data.
"""

from __future__ import annotations

import numpy as np
import pytest
from oracles import every_reading

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.gaussian.likelihood import fit_alpha_u
from pipeline.models.norm import frobenius
from pipeline.models.wishart.decomposition import PIVOTED_LU
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.likelihood import fit_sigma_b

MEASUREMENT = np.array([[0.6, -0.6, 0.0], [-0.6, 1.5, -0.9], [0.0, -0.9, 1.7]]) * 1e-6
# a start from rest, as shares of the step
SPEEDS = np.concatenate([[0.0, 0.0], np.geomspace(0.01, 1.0, 28)])


def recordings(chain, poses, step, model, *, takes: int, seed: int):
    """Poses, commanded steps and measured noise of the model's own steps."""
    rng = np.random.default_rng(seed)
    v = SPEEDS[:, None] * step
    q = np.tile(poses[: len(v)], (takes, 1, 1))
    drawn, _ = draw_steps(model, chain, q, v, rng)
    noise = drawn - q - np.matvec(chain.inverse_jacobian(q), v)
    return q, v, noise + rng.multivariate_normal(np.zeros(3), MEASUREMENT, noise.shape[:-1])


@every_reading
@pytest.mark.parametrize("sigma_b", [0.1, 0.25, 0.5])
def test_the_dispersion_comes_back_from_300_steps(chain, poses, step, sigma_b, decomposition):
    q, v, noise = recordings(
        chain, poses, step, WishartModel(sigma_b, decomposition), takes=10, seed=1
    )
    result = fit_sigma_b(chain, q, v, noise, MEASUREMENT, decomposition)
    assert not result.at_end
    assert abs(result.sigma_b / sigma_b - 1) < 0.1
    # control: without the measurement noise the slow steps blow it up
    assert (
        fit_sigma_b(chain, q, v, noise, 1e-4 * MEASUREMENT, decomposition).sigma_b > 1.5 * sigma_b
    )


def test_the_dispersion_has_no_bias_to_speak_of(chain, poses, step):
    result = [
        fit_sigma_b(
            chain,
            *recordings(chain, poses, step, WishartModel(0.25), takes=10, seed=seed),
            MEASUREMENT,
            PIVOTED_LU,
        ).sigma_b
        for seed in range(8)
    ]
    error = np.std(result, ddof=1) / np.sqrt(len(result))
    assert error < 0.005
    assert abs(np.mean(result) - 0.25) < 3.5 * error
    # control: the paper's estimator returns 0.71 to 0.77 of the true value
    assert abs(0.77 * 0.25 - 0.25) > 3.5 * error


def test_noise_that_is_the_measurements_alone_leaves_no_dispersion(chain, poses, step):
    q, v, noise = recordings(chain, poses, step, WishartModel(1e-6), takes=10, seed=2)
    result = fit_sigma_b(chain, q, v, noise, MEASUREMENT, PIVOTED_LU)
    assert result.sigma_b < 0.03


def test_the_level_and_the_bound_of_the_gaussian_model_come_back_along_their_ridge(
    chain, poses, step
):
    norms = frobenius(chain.inverse_jacobian(poses[: len(SPEEDS)]))
    true = GaussianModel(0.1, 1.3 * float(norms[2:].max()))
    q, v, noise = recordings(chain, poses, step, true, takes=200, seed=3)
    fit = fit_alpha_u(chain, q, v, noise, MEASUREMENT, np.linspace(0.02, 1.0, 25))
    assert not fit.at_end
    assert abs(fit.u / true.u - 1) < 0.1

    def level(alpha: float, u: float) -> float:
        """The standard deviation of the step at the mean pose, all of (α, u) that is well
        determined.
        """
        return alpha * np.sqrt(u**2 - np.mean(norms**2))

    assert abs(level(fit.alpha, fit.u) / level(true.alpha, true.u) - 1) < 0.02
    # the ridge: twice the bound costs less than 1 % of the likelihood's height, while α halves
    assert fit.alphas[-1] < 0.75 * true.alpha
    assert fit.objectives.min() >= fit.objective - 1e-6 * abs(fit.objective)
    # control: the wrong noise gives another level
    wrong = fit_alpha_u(chain, q, v, noise, 30 * MEASUREMENT, np.linspace(0.02, 1.0, 25))
    assert abs(level(wrong.alpha, wrong.u) / level(true.alpha, true.u) - 1) > 0.04


def test_the_objective_of_the_gaussian_fit_is_the_models_own_log_likelihood(chain, poses, step):
    q, v, noise = recordings(chain, poses, step, GaussianModel(0.1, 25.0), takes=10, seed=4)
    fit = fit_alpha_u(chain, q, v, noise, MEASUREMENT, np.linspace(0.02, 1.0, 5))
    q_next = q + np.matvec(chain.inverse_jacobian(q), v) + noise
    model = GaussianModel(fit.alpha, fit.u)
    assert -model.log_density(chain, q, v, q_next, MEASUREMENT)[:, 2:].sum() == pytest.approx(
        fit.objective, rel=1e-12
    )
    for alpha in (0.97 * fit.alpha, 1.03 * fit.alpha):
        assert (
            -GaussianModel(alpha, fit.u).log_density(chain, q, v, q_next, MEASUREMENT)[:, 2:].sum()
            > fit.objective
        )


def test_a_motion_at_rest_throughout_is_refused(chain, poses):
    q = np.tile(poses[:5], (3, 1, 1))
    for fit, last in ((fit_sigma_b, PIVOTED_LU), (fit_alpha_u, np.linspace(0.1, 1, 5))):
        with pytest.raises(ModelDomainError, match="at rest at every step"):
            fit(chain, q, np.zeros((5, 3)), np.zeros(q.shape), MEASUREMENT, last)
