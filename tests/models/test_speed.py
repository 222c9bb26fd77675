"""The speed law: its likelihood fit returns known parameters, and its law has no Jacobian."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipeline.core.errors import ModelDomainError
from pipeline.models.speed.fit import greatest_likelihood
from pipeline.models.speed.law import SpeedModel, build

STEPS = np.abs(np.sin(np.linspace(0, 12, 20_000))) * 5e-3  # rad


@pytest.mark.parametrize(
    ("rest", "growth", "measured"),
    [(4e-8, 0.5, 1e-8), (0.0, 2.0, 1e-8), (1e-6, 0.0, 0.0)],
)
def test_the_fit_returns_known_variances_within_their_error(rest, growth, measured):
    rng = np.random.default_rng(4)
    std = np.sqrt(rest + growth * STEPS**2 + measured)
    noise = std * rng.standard_normal(STEPS.shape)
    fitted_rest, fitted_growth = greatest_likelihood(noise, STEPS, measured)
    least = std.min() ** 2

    assert fitted_rest == pytest.approx(
        rest,
        abs=0.1 * (rest + measured) + 0.02 * least,
    )
    assert fitted_growth == pytest.approx(growth, rel=0.05, abs=5e-3)


def test_a_joint_without_noise_has_no_variance():
    assert greatest_likelihood(np.zeros(9), np.ones(9), 1e-8) == (0.0, 0.0)


def test_the_covariance_depends_on_the_commanded_joint_step_alone(chain):
    model = build({"rest_variance": [1e-8] * 3, "growth": [0.1, 0.2, 0.3]})
    poses = np.array([[0.3, 1.2, -0.4], [0.1, 0.6, 0.9]])
    steps = np.full((2, 3), 2e-3)
    commands = np.matvec(chain.jacobian(poses), steps)
    covariance = model.covariance(chain, poses, commands)
    expected = np.diag(1e-8 + np.array([0.1, 0.2, 0.3]) * 4e-6)

    assert_allclose(covariance, [expected, expected], rtol=1e-9)

    doubled = model.with_trace(chain, poses, commands, 2 * np.trace(expected))
    assert_allclose(doubled.growth, 2 * model.growth)


@pytest.mark.parametrize("broken", [-1e-9, np.nan])
def test_a_negative_or_missing_variance_is_refused(broken):
    with pytest.raises(ModelDomainError, match="finite and >= 0"):
        SpeedModel(np.array([broken]), np.array([1.0]))
