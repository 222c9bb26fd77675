"""σ̂_B from recorded noise: the weights that its rest noise gives, what it finds, and that it needs
a rest.
"""

from __future__ import annotations

import numpy as np
import pytest
from oracles import every_reading

from pipeline.core.errors import ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import PIVOTED_LU, Decomposition
from pipeline.models.wishart.dispersion import WishartFit, fit_wishart, rest_noise
from pipeline.models.wishart.law import WishartModel

FLOOR = 0.2
REST, MOVING = 10, 30  # steps without a command and steps with one


def recordings(
    chain,
    poses,
    step,
    sigma_b: float,
    measured: float,
    decomposition: Decomposition = PIVOTED_LU,
    *,
    takes: int = 100,
):
    """Poses before each step, commanded steps, and noise of the Wishart model's own steps, measured
    with white noise (rad).
    """
    rng = np.random.default_rng(31)
    v = np.vstack([np.zeros((REST, 3)), np.tile(step, (MOVING, 1))])
    q = np.tile(poses[: REST + MOVING], (takes, 1, 1))
    noise = draw_steps(WishartModel(sigma_b, decomposition), chain, q, v, rng)[0]
    noise -= q + np.matvec(chain.inverse_jacobian(q), v)
    return q, v, noise + measured * rng.standard_normal(noise.shape)


def fit(
    chain, poses, step, sigma_b: float, measured: float, decomposition: Decomposition = PIVOTED_LU
) -> WishartFit:
    return fit_wishart(
        chain,
        *recordings(chain, poses, step, sigma_b, measured, decomposition),
        decomposition,
        FLOOR,
    )


def test_the_rest_noise_is_that_of_the_steps_without_a_command():
    noise = np.zeros((2, 4, 3))
    noise[:, 1] = [[3.0, 0.0, 4.0], [0.0, 5.0, 0.0]]
    noise[:, 3] = 100.0
    v = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1e-9, 0.0]])
    assert rest_noise(noise, v) == 5.0


def test_the_weights_follow_from_the_rest_noise(chain, poses, step):
    result = fit(chain, poses, step, 0.2, 1e-3)
    count = 100 * REST
    assert abs(result.rest_noise / (1e-3 * np.sqrt(3)) - 1) < 4 / np.sqrt(2 * 3 * count)
    np.testing.assert_allclose(
        result.weights[1] / result.weights[0], result.rest_noise / np.sqrt(3)
    )
    np.testing.assert_allclose(sum(result.weights), 1)


def test_at_rest_nothing_is_perturbed_and_the_mean_over_time_counts_those_steps(chain, poses, step):
    result = fit(chain, poses, step, 0.2, 1e-4)
    assert not result.dispersions[:REST].any()
    assert not result.perturbations.s.reshape(100, -1, 3, 3)[:, :REST].any()
    assert np.all(result.dispersions[REST:] > 0)
    np.testing.assert_allclose(result.sigma_b, result.dispersions.mean())


@every_reading
def test_the_estimator_returns_less_than_the_dispersion_that_was_put_in(
    chain, poses, step, decomposition
):
    # one direction shows 2n of the n(n + 1) parts of ‖B − I‖²: an error of the paper's method, not
    # of its solution
    moving = fit(chain, poses, step, 0.2, 1e-6, decomposition).dispersions[REST:].mean()
    assert 0.68 < moving / 0.2 < 0.78


def test_more_dispersion_is_found_where_more_was_put_in(chain, poses, step):
    result = [fit(chain, poses, step, sigma_b, 1e-5).sigma_b for sigma_b in (0.1, 0.2, 0.4)]
    assert result[0] < 0.6 * result[1] < 0.4 * result[2]


def test_the_weights_keep_the_cameras_noise_of_slow_steps_from_being_taken_for_dispersion(
    chain, poses, step
):
    reading = Decomposition("pivoted_lu")
    q, v, noise = recordings(chain, poses, 0.05 * step, 1e-6, 1e-3)
    assert fit_wishart(chain, q, v, noise, reading, FLOOR).sigma_b < 0.3
    # control: with a fifth of the weight it is
    noise[:, :REST] *= 0.2
    assert fit_wishart(chain, q, v, noise, reading, FLOOR).sigma_b > 0.7


@pytest.mark.parametrize("part", ["no rest", "no noise at rest"])
def test_a_motion_without_noise_at_rest_is_refused(part, chain, poses, step):
    q, v, noise = recordings(chain, poses, step, 0.2, 1e-4)
    if part == "no rest":
        q, v, noise = q[:, REST:], v[REST:], noise[:, REST:]
    else:
        noise[:, :REST] = 0.0
    with pytest.raises(ModelDomainError, match="noise recorded at rest"):
        fit_wishart(chain, q, v, noise, PIVOTED_LU, FLOOR)
