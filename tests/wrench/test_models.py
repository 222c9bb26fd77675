"""The parametric wrench model in plane and space against quadrature, simulation, the paper's
formulas and limits; the random-matrix model against draws of the whole matrix and a bounded
optimiser; the data that
determine Σ_S and Ψ_S.
"""

from dataclasses import replace

import numpy as np
import pytest
from cable_systems import planar_cables, sample_wrench
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad
from scipy.special import i0, i0e, i1, i1e
from scipy.stats import ks_2samp, vonmises, vonmises_fisher
from standard_errors import largest_score

from pipeline.core.errors import ModelDomainError
from pipeline.wrench.models import (
    FORMS,
    CableSystem,
    MatrixModel,
    matrix_model,
    mean_resultant_length,
    optimal_sigma_s,
    sample_wrenches,
    unbounded_sigma_s,
    wrench_covariance,
    wrench_mean,
)

BAND = 4.5  # standard errors; six rows have 27 moments, which leave it with probability 2e-4


def covariance_score(samples: np.ndarray, covariance: np.ndarray) -> float:
    """Greatest deviation of the sample (co)variances from ``covariance``, in standard errors."""
    centred = samples - samples.mean(axis=0)
    i, j = np.triu_indices(samples.shape[1])
    return largest_score(centred[:, i] * centred[:, j], covariance[i, j])


def one_cable(tension: float, angle: float, sd: float, kappa: float) -> CableSystem:
    """A system of one cable with tension, angle, σ_T and κ."""
    return planar_cables([tension], [angle], [sd], [kappa])


def test_the_mean_length_is_a_ratio_of_bessel_functions_in_the_plane_and_of_hyperbolic_in_space():
    kappa = np.array([0.01, 0.5, 4.0, 169.35, 600.0])
    in_plane = mean_resultant_length(kappa, 2)
    in_space = mean_resultant_length(kappa, 3)
    closed = 1 / np.tanh(kappa) - 1 / kappa  # which loses digits as κ falls

    assert_allclose(in_plane, i1(kappa) / i0(kappa), rtol=1e-13)
    assert_allclose(in_space, closed, rtol=1e-13 / kappa.min())
    assert np.abs(in_space - in_plane).min() > 1e-4


WIDE = [[4.0, 7.0, 2.5], [0.4, 2.1, 5.0], [0.5, 2.0, 1.0], [3.0, 8.0, 40.0]]
WIDE = planar_cables(*map(np.array, WIDE))
APART = replace(WIDE, attachment=np.array([[0.3, -0.2], [-0.5, 0.1], [0.2, 0.6]]))
SPACE = replace(
    WIDE,
    direction=np.array([[0.36, 0.48, 0.8], [-0.6, 0.0, 0.8], [0.0, -0.8, 0.6]]),
    attachment=np.array([[0.3, -0.2, 0.1], [-0.5, 0.1, 0.4], [0.2, 0.6, -0.3]]),
)
SYSTEMS = {"plane, one point": WIDE, "plane": APART, "space": SPACE}
SYSTEMS["space, one point"] = replace(SPACE, attachment=None)


@pytest.mark.parametrize("p", [2, 3])
def test_the_mean_length_has_its_limits_at_no_and_at_great_concentration(p):
    lengths = mean_resultant_length(np.array([1e-8, 1e8]), p)
    assert_allclose(lengths, [1e-8 / p, 1 - (p - 1) / 2e8], rtol=1e-9)


@pytest.mark.parametrize(
    ("theta", "kappa"),
    [(0.0, 0.5), (0.7, 4.0), (2.5, 169.35), (4.0, 2416.0)],
)
def test_moments_of_one_cable_equal_those_integrated_over_its_direction(theta, kappa):
    tension = 5.0
    sd = 1.3
    law = vonmises(kappa, loc=0.0)
    edge = min(np.pi, 15 / np.sqrt(kappa))

    def expectation(function):
        def density(angle):
            return function(theta + angle) * law.pdf(angle)

        return quad(density, -edge, edge, epsabs=1e-13, epsrel=1e-13)[0]

    mean = tension * np.array([expectation(np.cos), expectation(np.sin)])
    square = expectation(lambda angle: np.cos(angle) ** 2)
    mixed = expectation(lambda angle: np.sin(2 * angle) / 2)
    second = (tension**2 + sd**2) * np.array([[square, mixed], [mixed, 1 - square]])
    covariance = second - np.outer(mean, mean)

    cable = one_cable(tension, theta, sd, kappa)
    assert_allclose(wrench_mean(cable), mean, atol=1e-10)
    assert_allclose(wrench_covariance(cable), covariance, atol=1e-9)


def test_in_the_plane_the_variances_of_the_force_are_the_papers_formulas():
    x, y = WIDE.direction.T
    angle = np.arctan2(y, x)
    length = i1e(WIDE.concentration) / i0e(WIDE.concentration)
    second_moment = WIDE.tension**2 + WIDE.tension_sd**2
    a = second_moment - (length * WIDE.tension) ** 2
    b = length * second_moment / WIDE.concentration
    xx = np.sum(a * np.cos(angle) ** 2 - b * np.cos(2 * angle))
    yy = np.sum(a * np.sin(angle) ** 2 + b * np.cos(2 * angle))
    xy = np.sum(np.sin(2 * angle) * (a - 2 * b) / 2)
    papers = [[xx, xy], [xy, yy]]

    assert_allclose(wrench_covariance(WIDE), papers, rtol=1e-13)
    # the forces of cables with attachments apart are the same
    of_forces = wrench_covariance(APART)[:2, :2]
    assert_allclose(of_forces, papers, rtol=1e-13)


@pytest.mark.parametrize("place", SYSTEMS)
def test_simulated_wrenches_have_the_closed_forms_moments_and_the_small_angle_law_does_not(
    place,
):
    system = SYSTEMS[place]
    samples = sample_wrench(system, 100_000, default_rng(1))
    # the small-angle law
    maps = system.maps()
    columns = system.jacobian()
    across = system.tension**2 / system.concentration
    along = system.tension_sd**2 - across
    small_angle = np.einsum("mip,m,mjp->ij", maps, across, maps)
    small_angle += (columns * along) @ columns.T

    assert samples.shape[1] == {"plane": 3, "space": 6}.get(place, system.dimension)
    assert largest_score(samples, wrench_mean(system)) < BAND
    assert covariance_score(samples, wrench_covariance(system)) < BAND
    assert covariance_score(samples, small_angle) > 5 * BAND  # control


def test_concentrations_whose_bessel_functions_overflow_give_the_small_angle_law():
    kappa = 1e5
    with np.errstate(over="ignore"):
        assert np.isinf(i0(kappa))

    length = mean_resultant_length(kappa, 2)
    across, along = wrench_covariance(one_cable(6.0, np.pi / 2, 2.0, kappa)).diagonal()

    assert length == pytest.approx(1 - 1 / (2 * kappa), abs=1 / kappa**2)
    assert across == pytest.approx((36.0 + 4.0) / kappa, rel=1e-4)
    assert along == pytest.approx(4.0, rel=0.2)


@pytest.mark.parametrize(
    "change",
    [{"concentration": np.zeros(3)}, {"tension_sd": -np.ones(3)}],
)
def test_values_without_a_law_are_refused(change):
    with pytest.raises(ModelDomainError, match="tension_sd ≥ 0 and concentration > 0"):
        replace(WIDE, **change)


MODEL = MatrixModel(
    np.array([[0.9, -0.4, 0.1], [0.3, 0.8, -1.0]]),
    np.array([0.5, -1.0, 2.0]),
    actuation_cov=np.array([[2.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 1.5]]),
    psi=np.array([[1.0, 0.3, 0.0], [0.3, 0.6, 0.1], [0.0, 0.1, 1.4]]),
)
SIGMA_S = np.array([[0.5, 0.2], [0.2, 0.3]])
N = 100_000


def whole_matrix_wrenches(rng):
    """W = S·T with S drawn entry by entry: S̲ + Σ_S^½ Z Ψ_S^½."""
    left = np.linalg.cholesky(SIGMA_S)
    right = np.linalg.cholesky(MODEL.psi)
    of_actuation = np.linalg.cholesky(MODEL.actuation_cov)
    jacobian = MODEL.jacobian + left @ rng.standard_normal((N, 2, 3)) @ right.T
    actuation = MODEL.actuation + rng.standard_normal((N, 3)) @ of_actuation.T
    return np.einsum("knm,km->kn", jacobian, actuation)


def random_systems(count, agents, rng):
    ranges = ((1.8, 14), (0, 6.3), (0.5, 2.3), (100, 2400))
    values = [rng.uniform(low, high, (count, agents)) for low, high in ranges]
    return planar_cables(*values)


def test_products_of_whole_random_matrices_have_the_closed_forms_moments():
    samples = whole_matrix_wrenches(default_rng(3))
    assert largest_score(samples, MODEL.jacobian @ MODEL.actuation) < BAND
    assert covariance_score(samples, MODEL.covariance(SIGMA_S)) < BAND
    # the control
    identity = replace(MODEL, psi=np.eye(3)).covariance(SIGMA_S)
    assert covariance_score(samples, identity) > 2 * BAND


def test_reduced_sampling_has_the_law_of_the_whole_product_and_a_normal_law_has_not():
    rng = default_rng(4)
    whole = whole_matrix_wrenches(rng)
    reduced = sample_wrenches(MODEL, SIGMA_S, N, rng)
    mean = MODEL.jacobian @ MODEL.actuation
    normal = rng.multivariate_normal(mean, MODEL.covariance(SIGMA_S), N)

    for direction in ([1.0, 0.0], [0.0, 1.0], [0.6, -0.8]):
        assert ks_2samp(whole @ direction, reduced @ direction).pvalue > 1e-3
    assert ks_2samp(whole[:, 0], normal[:, 0]).pvalue < 1e-6


@pytest.mark.parametrize("form", FORMS)
def test_the_optimum_has_the_conditions_of_a_minimum_and_no_feasible_step_from_it_is_lower(
    form,
):
    rng = default_rng(6)
    systems = random_systems(400, 2, rng)
    model = matrix_model(systems)
    covariance = wrench_covariance(systems)
    mask = np.eye(2) if form == "diagonal" else np.ones((2, 2))
    unbounded = unbounded_sigma_s(systems)
    closed, held = optimal_sigma_s(unbounded, form)

    # Karush-Kuhn-Tucker of min ‖Σ − M‖ over Σ ≥ 0, a convex problem
    target = unbounded * mask
    multiplier = closed - target
    size = np.abs(target).max()
    product = np.trace(closed @ multiplier, axis1=1, axis2=2)
    for matrix in (closed, multiplier):
        assert np.linalg.eigvalsh(matrix).min() > -1e-12 * size
    assert np.abs(product).max() < 1e-12 * size**2
    negative = np.sum(np.linalg.eigvalsh(target) < 0, axis=-1)
    assert_array_equal(held, negative)
    assert np.sum(held > 0) >= 10 and np.sum(held == 0) >= 10

    def objective(sigma_s):
        """The paper's norm of the difference of the variances, or of the whole covariances."""
        difference = model.covariance(sigma_s) - covariance
        return np.linalg.norm(difference * mask, axis=(1, 2))

    least = objective(closed) * (1 - 1e-12)
    for factor in [np.zeros((2, 2)), *rng.normal(size=(20, 2, 2))]:
        feasible = 1e-2 * (factor @ factor.T) * mask
        assert np.all(objective(0.9 * closed + 0.1 * feasible) >= least)


def excess_of(form: str) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of the matrix model minus the parametric one (300, 2, 2) of random systems, and
    their number of active bounds.
    """
    systems = random_systems(300, 5, default_rng(7))
    sigma_s, held = optimal_sigma_s(unbounded_sigma_s(systems), form)
    covariance = matrix_model(systems).covariance(sigma_s)
    return covariance - wrench_covariance(systems), held


def test_without_active_bounds_the_moments_are_the_parametric_ones_and_else_variances_are_greater():
    excess, held = excess_of("full")
    free = held == 0
    assert 0.5 < np.mean(free) < 1
    assert_allclose(excess[free], 0.0, atol=1e-11)
    assert np.all(np.trace(excess[~free], axis1=-2, axis2=-1) > 0)


MEAN = np.array([[0.9, -0.4, 0.1, 0.5], [0.3, 0.8, -1.0, 0.2]])
SIGMA_CABLES = np.array([[5.0, 2.0], [2.0, 3.0]]) * 1e-4


def test_a_diagonal_sigma_s_has_the_parametric_variances_and_the_actuations_correlation():
    excess, held = excess_of("diagonal")
    variances = np.diagonal(excess[held == 0], axis1=-2, axis2=-1)
    assert_allclose(variances, 0.0, atol=1e-12)
    assert np.abs(excess[..., 0, 1]).max() > 0.01


# its trace is the number of cables
PSI = np.array(
    [
        [0.4, 0.1, 0.0, 0.0],
        [0.1, 0.6, 0.1, 0.0],
        [0.0, 0.1, 2.0, -0.3],
        [0.0, 0.0, -0.3, 1.0],
    ],
)
CABLES = MatrixModel(MEAN, np.array([3.0, 5.0, 4.0, 4.5]), 0.2 * np.eye(4), PSI)


def test_the_columns_of_directions_are_independent_and_their_variances_go_with_1_over_kappa():
    kappa = np.array([100.0, 700.0, 200.0, 400.0])
    means = planar_cables(*np.ones((4, 4))).direction
    rng = default_rng(6)
    draws = []
    for mean, concentration in zip(means, kappa, strict=True):
        draws.append(vonmises_fisher(mean, concentration, seed=rng).rvs(20_000))
    directions = np.stack(draws, axis=1)

    # E[XᵀX] = tr(Σ_S)·Ψ_S, X = S − E[S] (Theorem 5), with tr Ψ_S = 4
    x = directions - directions.mean(axis=0)
    psi = np.einsum("kai,kbi->ab", x, x)
    psi *= 4 / np.trace(psi)
    scale = np.sqrt(np.diag(psi))
    correlation = psi / np.outer(scale, scale)

    # a variance of 20 000 draws is known to 1 %, a correlation to 0.007
    assert_allclose(np.diag(psi), 4 / kappa / np.sum(1 / kappa), rtol=0.045)
    assert np.abs(correlation - np.eye(4)).max() < 0.032
    assert np.abs(psi - np.eye(4)).max() > 0.5


def test_one_law_of_the_tensions_tells_a_trace_with_psi_times_sigma_but_neither_of_the_two():
    exchanged = replace(CABLES, psi=PSI[::-1, ::-1])
    ratio = CABLES.sigma_s_factor() / exchanged.sigma_s_factor()
    due = CABLES.covariance(SIGMA_CABLES)
    of_exchanged = exchanged.covariance(ratio * SIGMA_CABLES)

    assert_allclose(of_exchanged, due, rtol=1e-12)
    # the control: with the same Σ_S
    assert np.abs(exchanged.covariance(SIGMA_CABLES) / due - 1).max() > 0.001


def psi_coefficients(tensions: np.ndarray) -> np.ndarray:
    """(K, 10) of TᵀΨT for tensions (K, 4), which is linear in the entries Ψᵢⱼ, i ≤ j."""
    i, j = np.triu_indices(4)
    return np.where(i == j, 1.0, 2.0) * tensions[:, i] * tensions[:, j]


TENSIONS = default_rng(42).uniform(1, 4, (10, 4))  # as many as Ψ has entries


def test_several_known_tensions_tell_psi_and_sigma_but_for_one_factor():
    covariances = []
    for tension in TENSIONS:
        model = replace(CABLES, actuation=tension, actuation_cov=np.zeros((4, 4)))
        covariances.append(model.covariance(SIGMA_CABLES))

    traces = np.trace(covariances, axis1=1, axis2=2)  # tr Σ_S·TᵀΨT
    i, j = np.triu_indices(4)
    psi = np.zeros((4, 4))
    psi[i, j] = psi[j, i] = np.linalg.solve(psi_coefficients(TENSIONS), traces)
    psi *= 4 / np.trace(psi)
    first = TENSIONS[0]
    sigma_s = covariances[0] / (first @ psi @ first)

    assert_allclose(psi, PSI, atol=1e-7)
    assert_allclose(sigma_s, SIGMA_CABLES, rtol=1e-7)


@pytest.mark.parametrize(
    "tensions",
    [TENSIONS[:9], np.outer(np.arange(1.0, 11), TENSIONS[0])],
    ids=["one fewer", "one in several sizes"],
)
def test_fewer_known_tensions_leave_psi_open(tensions):
    assert np.linalg.matrix_rank(psi_coefficients(tensions)) < 10
