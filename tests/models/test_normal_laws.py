"""Models of a normal step: draws, density and edges follow from the covariance, and the covariance
is the formula that its model stands for.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pipeline.core.errors import ModelDomainError
from pipeline.models.additive.fit import shrunk_covariance
from pipeline.models.additive.law import build
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.noise import mean_covariance
from pipeline.models.normal import root, without_measurement
from pipeline.models.scaled.law import ScaledModel

SIGMA = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
GAIN = np.array([[0.04, -0.02, 0.01], [-0.02, 0.09, 0.0], [0.01, 0.0, 0.05]])
TIMING = np.full((3, 3), 0.04)  # one share of the step for all joints: a singular gain
NONE = np.zeros((3, 3))
MEASUREMENT = np.array([[0.6, -0.6, 0.0], [-0.6, 1.5, -0.9], [0.0, -0.9, 1.7]]) * 1e-6
MODELS = {
    "additive": build({"noise_covariance": SIGMA}),
    "gaussian": GaussianModel(0.1, 40.0),
    "scaled": ScaledModel(np.diag(np.diag(SIGMA)), np.diag(np.diag(GAIN))),
    "scaled_full": ScaledModel(SIGMA, GAIN),
    "timing": ScaledModel(SIGMA, TIMING),
}
FLAT = {
    "additive": ScaledModel(1e-5 * np.outer([1.0, -1.0, 2.0], [1.0, -1.0, 2.0])),
    "timing": ScaledModel(NONE, TIMING),
    "gaussian": GaussianModel(0.1, 14.5),  # below the norm of poses with a bent elbow
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


@every_model
def test_draws_have_the_models_mean_and_covariance(model, chain, poses, step):
    """Bands: four standard errors of the mean, six times sqrt(2/N) of the covariance."""
    q, expected = np.tile(poses[0], (100_000, 1)), model.covariance(chain, poses[0], step)
    compiled, clipped = draw_steps(model, chain, q, step, np.random.default_rng(70))
    for drawn in (compiled, model.sample(chain, q, step, np.random.default_rng(71))):
        off = drawn.mean(axis=0) - model.mean(chain, poses[0], step)
        assert np.abs(off / np.sqrt(np.diag(expected))).max() < 4 / np.sqrt(len(q))
        assert np.linalg.norm(np.cov(drawn.T) - expected) < 0.03 * np.linalg.norm(expected)
    assert clipped == 0
    # control: at twice the speed the covariance is another, but for that of the additive model
    other = np.linalg.norm(model.covariance(chain, poses[0], 2 * step) - expected)
    assert other > 0.3 * np.linalg.norm(expected) or np.array_equal(expected, SIGMA)


@every_model
@pytest.mark.parametrize("measurement", [None, MEASUREMENT])
def test_the_log_density_is_scipys(model, measurement, chain, poses, step):
    q_next = poses + 0.02 * np.random.default_rng(0).standard_normal(poses.shape)
    result = model.log_density(chain, poses, step, q_next, measurement)
    means, covariances = model.mean(chain, poses, step), model.covariance(chain, poses, step)

    def scipys(added: np.ndarray) -> list[float]:
        each = zip(q_next, means, covariances, strict=True)
        return [stats.multivariate_normal(m, c + added).logpdf(x) for x, m, c in each]

    np.testing.assert_allclose(result, scipys(NONE if measurement is None else measurement), 1e-9)
    # control: the other noise is another density
    other = scipys(MEASUREMENT if measurement is None else NONE)
    assert np.abs(result - other).min() > 1e-6


@pytest.mark.parametrize("kind", FLAT)
def test_a_singular_covariance_is_a_model_without_a_density(kind, chain, poses, step):
    model, beyond = FLAT[kind], np.array([0.0, np.deg2rad(20.0), 0.0])
    for q, v in ((poses[0], np.zeros(3)), (beyond, step)):
        mean = model.mean(chain, q, v)
        with pytest.raises(ModelDomainError, match="singular at 1 of 1 step"):
            model.log_density(chain, q, v, mean)
        total = model.covariance(chain, q, v) + MEASUREMENT
        expected = stats.multivariate_normal(mean, total).logpdf(mean + 1e-3)
        density = model.log_density(chain, q, v, mean + 1e-3, MEASUREMENT)
        np.testing.assert_allclose(density, expected, rtol=1e-9)
        with pytest.raises(ModelDomainError, match="a covariance must be"):
            model.log_density(chain, q, v, mean, -MEASUREMENT)


def test_noise_of_one_direction_stays_in_it(chain, poses, step):
    dq = chain.nominal_step(poses, step)
    for model, along in ((FLAT["additive"], np.array([1.0, -1.0, 2.0])), (FLAT["timing"], dq)):
        compiled, _ = draw_steps(model, chain, poses, step, np.random.default_rng(7))
        for drawn in (compiled, model.sample(chain, poses, step, np.random.default_rng(8))):
            np.testing.assert_allclose(np.cross(drawn - poses - dq, along), 0, atol=1e-8)
            assert np.linalg.norm(drawn - poses - dq, axis=1).min() > 0


def test_noise_that_grows_with_the_speed_is_its_formula(chain, poses, step):
    dq = chain.nominal_step(poses, step)
    outer = dq[:, :, None] * dq[:, None, :]
    for name, floor, gain in (
        ("scaled", np.diag(np.diag(SIGMA)), np.diag(np.diag(GAIN))),
        ("timing", SIGMA, TIMING),
        ("additive", SIGMA, NONE),
    ):
        covariance = MODELS[name].covariance(chain, poses, step)
        np.testing.assert_allclose(covariance, floor + gain * outer, rtol=1e-12)
    at_rest = MODELS["scaled_full"].covariance(chain, poses, np.zeros(3))
    assert np.array_equal(at_rest, np.broadcast_to(SIGMA, at_rest.shape))


@pytest.mark.parametrize(
    "bad",
    [
        np.diag([1.0, 1.0, -0.1]),
        np.triu(np.ones((3, 3))),
        np.ones((2, 3)),
        np.ones(3),
        np.full((3, 3), np.nan),
    ],
)
def test_what_is_no_covariance_is_refused(bad):
    for make in (ScaledModel, root, lambda c: ScaledModel(c, NONE), lambda c: ScaledModel(NONE, c)):
        with pytest.raises(ModelDomainError, match="covariance must be"):
            make(bad)


def test_the_papers_covariance_is_about_the_mean_of_each_step():
    rng = np.random.default_rng(5)
    noise = rng.multivariate_normal(np.zeros(3), SIGMA, (100, 320))
    noise += 0.01 * rng.standard_normal((320, 3))

    def error(covariance: np.ndarray) -> float:
        return float(np.linalg.norm(covariance - SIGMA) / np.linalg.norm(SIGMA))

    assert error(mean_covariance(noise)) < 0.02
    # control: pooled over the steps, the spread of the means would enter
    assert error(np.cov(noise.reshape(-1, 3).T)) > 0.5


def test_shrinkage_is_nearer_to_the_truth_where_takes_are_few_and_vanishes_where_they_are_many():
    rng, true, errors = np.random.default_rng(5), np.diag([1.0, 1.5, 2.0]), np.zeros(2)
    for _ in range(200):
        noise = rng.multivariate_normal(np.zeros(3), true, (3, 4))
        shrunk, intensity = shrunk_covariance(noise)
        assert 0 < intensity <= 1
        errors += [np.sum((shrunk - true) ** 2), np.sum((mean_covariance(noise) - true) ** 2)]
    assert errors[0] < 0.6 * errors[1]
    _, intensity = shrunk_covariance(rng.multivariate_normal(np.zeros(3), true, (400, 10)))
    assert intensity < 0.02


def test_the_measurement_noise_is_taken_off_and_never_more_than_there_is():
    covariance, quiet = without_measurement(np.diag([3.0, 2.0, 1.0]), np.diag([1.0, 1.0, 1.5]))
    np.testing.assert_allclose(covariance, np.diag([2.0, 1.0, 0.0]), atol=1e-15)
    assert quiet == 1
