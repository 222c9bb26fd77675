"""Models of a normal step: density and refusals follow from the covariance. The Gaussian matrix
model of the inverse Jacobian against Algorithm 2 and the conic solver. The fit of (ũ, α): exact in
α, recovery from the model's moments, and the ridge.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy import stats

from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models import convex
from pipeline.models.additive.fit import shrunk_covariance
from pipeline.models.additive.law import AdditiveModel, build
from pipeline.models.convex import solve_noise_covariance
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.fit import fit_distance
from pipeline.models.gaussian.law import GaussianModel, noise_scale
from pipeline.models.model import frobenius, root
from pipeline.models.steps import mean_covariance

SIGMA = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MEASUREMENT = np.array([[0.6, -0.6, 0.0], [-0.6, 1.5, -0.9], [0.0, -0.9, 1.7]]) * 1e-6
MODELS = {
    "additive": build({"noise_covariance": SIGMA}),
    "gaussian": GaussianModel(0.1, 40.0),
}
FLAT = {
    "additive": AdditiveModel(1e-5 * np.outer([1.0, -1.0, 2.0], [1.0, -1.0, 2.0])),
    "gaussian": GaussianModel(0.1, 14.5),  # below the norm of poses with a bent elbow
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def normal_densities(means, covariances, points) -> list[float]:
    """SciPy's log density of each point."""
    densities = []
    for mean, covariance, point in zip(means, covariances, points, strict=True):
        densities.append(stats.multivariate_normal(mean, covariance).logpdf(point))
    return densities


@every_model
@pytest.mark.parametrize("measurement", [None, MEASUREMENT])
def test_the_log_density_is_scipys(model, measurement, chain, poses, step):
    q_next = poses + 0.02 * default_rng(0).standard_normal(poses.shape)
    means = model.mean(chain, poses, step)
    without = model.covariance(chain, poses, step)
    covariances = [without, without + MEASUREMENT]
    if measurement is not None:
        covariances.reverse()
    expected, unlike = (normal_densities(means, c, q_next) for c in covariances)

    result = model.log_density(chain, poses, step, q_next, measurement)

    assert_allclose(result, expected, 1e-9)
    # control: the other noise is another density
    assert np.abs(result - unlike).min() > 1e-6


@pytest.mark.parametrize("is_at_rest", [True, False])
@pytest.mark.parametrize("kind", FLAT)
def test_a_singular_covariance_is_a_model_without_a_density(
    kind,
    is_at_rest,
    chain,
    poses,
    step,
):
    model = FLAT[kind]
    q = np.array([0.0, np.deg2rad(20.0), 0.0])
    v = step
    if is_at_rest:
        q = poses[0]
        v = np.zeros(3)
    mean = model.mean(chain, q, v)
    total = model.covariance(chain, q, v) + MEASUREMENT

    with pytest.raises(ModelDomainError, match="singular at 1 of 1 step"):
        model.log_density(chain, q, v, mean)
    with pytest.raises(ModelDomainError, match="a covariance must be"):
        model.log_density(chain, q, v, mean, -MEASUREMENT)
    expected = stats.multivariate_normal(mean, total).logpdf(mean + 1e-3)
    density = model.log_density(chain, q, v, mean + 1e-3, MEASUREMENT)
    assert_allclose(density, expected, rtol=1e-9)


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
    for make in (AdditiveModel, root):
        with pytest.raises(ModelDomainError, match="covariance must be"):
            make(bad)


def test_the_papers_covariance_is_about_the_mean_of_each_step():
    rng = default_rng(5)
    noise = rng.multivariate_normal(np.zeros(3), SIGMA, (100, 320))
    noise += 0.01 * rng.standard_normal((320, 3))

    def error(covariance: np.ndarray) -> float:
        return np.linalg.norm(covariance - SIGMA) / np.linalg.norm(SIGMA)

    assert error(mean_covariance(noise)) < 0.02
    # control: pooled over the steps, the spread of the means would enter
    assert error(np.cov(noise.reshape(-1, 3).T)) > 0.5


def test_shrinkage_is_nearer_to_the_truth_where_takes_are_few_and_vanishes_where_they_are_many():
    rng = default_rng(5)
    true = np.diag([1.0, 1.5, 2.0])
    shrunk = []
    unshrunk = []
    for _ in range(200):
        noise = rng.multivariate_normal(np.zeros(3), true, (3, 4))
        covariance, intensity = shrunk_covariance(noise)
        assert 0 < intensity <= 1
        shrunk.append(np.sum((covariance - true) ** 2))
        unshrunk.append(np.sum((mean_covariance(noise) - true) ** 2))
    assert np.mean(shrunk) < 0.6 * np.mean(unshrunk)

    many = rng.multivariate_normal(np.zeros(3), true, (400, 10))
    _, intensity = shrunk_covariance(many)
    assert intensity < 0.02


POSE = np.array([0.4, 1.7, -0.3])
DRAWS = 20_000
STEPS = 320
INVERSE_NORM = 15.25 + 1.75 * np.cos(np.linspace(0, 4 * np.pi, STEPS))  # 13.5 … 17
STEP_NORM = 0.03 * np.abs(np.sin(np.linspace(0, 2 * np.pi, STEPS)))
EXTENSIONS = np.geomspace(0.02, 17.0, 200)
OF_MEANS = 0.5 * STEPS * np.sqrt(3) * 0.01  # the means' part of the objective at β₁ = ½


@pytest.mark.parametrize(
    ("norm", "alpha", "u"),
    [(13.5, 0.1, 18.0), (17.0, 1.0, 17.5), (2.0, 0.5, 40.0)],
)
def test_the_closed_form_solves_the_log_det_problem(norm, alpha, u):
    expected = noise_scale(norm, alpha, u, 3, 3) * np.eye(3)
    solved = solve_noise_covariance(norm, alpha, u, 3, 3)
    band = 1e-4 * expected[0, 0]
    assert_allclose(solved, expected, atol=band)
    # control: another scale is seen
    assert np.abs(solved - 1.05 * expected).max() > 100 * band


def test_a_wrong_scale_is_seen(monkeypatch):
    norms = np.array([13.6, 16.4])
    right = convex.noise_scale
    assert convex.noise_covariance_gap(norms, 0.1, 18.0, 3, 3) < 1e-3

    monkeypatch.setattr(convex, "noise_scale", lambda *values: 1.05 * right(*values))
    assert convex.noise_covariance_gap(norms[:1], 0.1, 18.0, 3, 3) > 0.04


def test_a_problem_without_an_optimum_yields_no_number():
    with pytest.raises(SolverError):
        solve_noise_covariance(19.0, 0.1, 18.0, 3, 3)


def test_independent_rows_make_the_step_isotropic_with_variance_v_sigma_v(step):
    """With N ~ N(0, I⊗Σ) after Definition 1, Cov(Nv) = (vᵀΣv)I for any Σ; the other order would
    give ‖v‖²Σ.
    """
    sigma = np.diag([4.0, 1.0, 0.25])
    law = stats.matrix_normal(np.zeros((3, 3)), colcov=sigma)
    drawn = law.rvs(200_000, random_state=default_rng(2)) @ step
    variance = step @ sigma @ step
    other_order = (step @ step) * sigma

    covariance = np.cov(drawn.T) / variance

    assert_allclose(covariance, np.eye(3), atol=0.02)
    assert np.abs(covariance - other_order / variance).max() > 1


def test_the_law_of_a_step_is_that_of_algorithm_2(chain, step):
    """Kolmogorov–Smirnov tests of each joint and of the distance from the mean; control: α of 5 %
    more.
    """
    rng = default_rng(3)
    model = GaussianModel(0.1, 18.0)
    inverse = chain.inverse_jacobian(POSE)
    norm = float(np.linalg.norm(inverse))
    sigma = solve_noise_covariance(norm, model.alpha, model.u, 3, 3)
    law = stats.matrix_normal(inverse, colcov=sigma)
    matrices = POSE + law.rvs(DRAWS, random_state=rng) @ step
    mean = model.mean(chain, POSE, step)

    q = np.tile(POSE, (DRAWS, 1))
    drawn, clipped = draw_steps(model, chain, q, step, rng)
    wrong, _ = draw_steps(GaussianModel(0.105, 18.0), chain, q, step, rng)

    def p_value(sample: np.ndarray) -> float:
        lengths = [np.linalg.norm(x - mean, axis=1) for x in (sample, matrices)]
        return stats.ks_2samp(*lengths).pvalue

    assert clipped == 0
    assert p_value(drawn) > 0.01
    assert p_value(wrong) < 1e-4
    for ours, expected in zip(drawn.T, matrices.T, strict=True):
        assert stats.ks_2samp(ours, expected).pvalue > 0.01
    covariance = model.covariance(chain, POSE, step)
    assert np.abs(np.cov(matrices.T) - covariance).max() < 0.04 * covariance[0, 0]


def test_the_noise_shrinks_as_the_pose_nears_the_bound_and_is_clipped_and_counted_beyond(
    chain,
    step,
):
    """Against the paper's motivation: nearer a singularity the inverse form gives less noise."""
    q = np.zeros((4, 3))
    q[:, 1] = np.deg2rad([100.0, 70.0, 50.0, 20.0])
    norms = frobenius(chain.inverse_jacobian(q))
    model = GaussianModel(0.1, float(norms[2]) + 0.1)

    variance = model.covariance(chain, q, step)[:, 0, 0]
    drawn, clipped = draw_steps(model, chain, q, step, default_rng(4))

    assert np.all(np.diff(norms) > 0)
    assert np.all(np.diff(variance) < 0)
    assert variance[3] == 0.0 and clipped == 1
    assert_allclose(drawn[3], model.mean(chain, q, step)[3], atol=1e-14)
    with pytest.raises(ModelDomainError, match="1 of 4 poses"):
        noise_scale(norms, 0.1, model.u, 3, 3)


def model_variance(alpha: float, extension: float) -> np.ndarray:
    """(STEPS,) variance of each joint's step under the Gaussian matrix model."""
    u = INVERSE_NORM.max() + extension
    return alpha**2 * (u**2 - INVERSE_NORM**2) / 9 * STEP_NORM**2


def fit_to(variance: np.ndarray, beta1: float = 0.5):
    """Fit (ũ, α) to joints of equal ``variance`` (STEPS,) in each step."""
    covariance = variance[:, None, None] * np.eye(3)
    mean = np.full((STEPS, 3), 0.01)
    norms = STEP_NORM, INVERSE_NORM
    return fit_distance((mean, covariance), *norms, 3, beta1, EXTENSIONS)


@pytest.mark.parametrize(("alpha", "extension"), [(0.1, 1.0), (0.3, 5.0)])
def test_the_models_own_moments_return_its_parameters(alpha, extension):
    variance = model_variance(alpha, extension)
    result = fit_to(variance)

    assert result.alpha == pytest.approx(alpha, rel=1e-3)
    assert result.u == pytest.approx(INVERSE_NORM.max() + extension, rel=1e-3)
    assert not result.at_end and not result.unbounded
    # β₁ weighs a constant: the mean of one step is the nominal one whatever the parameters
    assert result.objective == pytest.approx(OF_MEANS, rel=1e-5)
    reweighted = fit_to(variance, beta1=0.9)
    assert reweighted.alpha == pytest.approx(result.alpha, rel=1e-3)


def test_alpha_is_the_best_for_each_extension():
    factors = default_rng(3).uniform(0.5, 2, STEPS)
    variance = factors * model_variance(0.1, 1.0)
    result = fit_to(variance)

    for i in (0, 80, 199):
        alphas = np.linspace(0.5, 2, 301) * result.alphas[i]
        at_one = model_variance(1.0, EXTENSIONS[i])
        distance = 3 * np.abs(np.outer(alphas**2, at_one) - variance).sum(axis=1)
        rivals = 0.5 * distance + OF_MEANS
        assert result.objectives[i] <= rivals.min() * (1 + 1e-12)
    assert result.objective <= result.objectives.min()


def test_noise_that_follows_the_speed_alone_runs_to_the_end_of_the_interval_along_the_ridge():
    """u → ∞ with αu fixed is one model: such data do not determine u, and the fit says so."""
    result = fit_to(1e-3 * STEP_NORM**2)

    assert result.at_end and result.unbounded
    assert result.extension == EXTENSIONS[-1]
    alphas = result.alphas[-50:]
    products = alphas * (INVERSE_NORM.max() + EXTENSIONS[-50:])
    assert np.ptp(products) / products[-1] < 0.5 * np.ptp(alphas) / alphas[-1]


def test_the_printed_objective_without_the_absolute_value_rewards_no_noise_at_all():
    """tr{Cov(q) − Cov(q̃)} as printed falls all the way to α = 0; its absolute value does not."""
    alphas = np.linspace(0, 0.3, 61)
    variances = np.array([model_variance(alpha, 1.0) for alpha in alphas])
    difference = 3 * (variances - model_variance(0.1, 1.0))

    printed = difference.sum(axis=1)
    absolute = np.abs(difference).sum(axis=1)

    assert alphas[printed.argmin()] == 0
    assert alphas[absolute.argmin()] == pytest.approx(0.1)
