"""Errata without another test: signs, units and orders, missing moments, the commanded end-effector
of the depth camera, the sketch of motion planning, the published Σ_S, and the wrench.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from planning_arms import LAWS, path_task
from rectangle_clouds import CHAIN, cloud
from sample_options import made
from scipy.stats import wishart

from pipeline.arm.chain import PlanarChain
from pipeline.configuration import config
from pipeline.core.options.analysis import ArticulationSection, Wrench
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel, noise_scale
from pipeline.models.kinds import build_model
from pipeline.models.model import frobenius
from pipeline.models.steps import process_noise
from pipeline.models.wishart.decomposition import COMPUTED, Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.perception.articulation import fit_sequence
from pipeline.recordings.commands import speed_scores
from pipeline.statistics.takes import lag_one_correlation
from pipeline.studies.planning.solver import (
    PathTask,
    feasible_motions,
    summed_variance,
)
from pipeline.verdicts.paper import RATE, noise_levels
from pipeline.verdicts.published import published_results
from pipeline.wrench.models import (
    Bounds,
    draw_systems,
    matrix_model,
    wrench_covariance,
)
from pipeline.wrench.study import (
    averaged_sigma_s,
    expected_sigma_s,
    run_study,
    variance_errors,
)

ROOT = Path(__file__).parents[2]
STATED = config.read_yaml(ROOT / "pipeline/verdicts/claims.yaml")["claims"]
CLAIMS = {claim["id"]: claim for claim in STATED}

POSE = np.array([0.4, 1.7, -0.3])
STEP = np.array([0.004, -0.003, 0.03])


def arm(metre: float = 1.0) -> PlanarChain:
    """The arm with its lengths in units of which a metre has ``metre``."""
    links = metre * np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]])
    ranges = (np.full(3, end) for end in (-3.0, 3.0, np.pi / 2))
    return PlanarChain(np.zeros(2), links, np.array([1.0, 1.0, -1.0]), *ranges)


@pytest.mark.parametrize("norm", [13.6, 14.5, 17.6])
def test_the_printed_scale_and_bound_mean_a_third_of_the_noise_level(norm):
    """L is the level of the law's covariance, L² ‖v‖²/m = tr Cov, and not α·u."""
    printed = {"alpha": 0.1, "u": 18.0}
    fitted = {"noise_level": 3.364, "rms_norm_of_the_inverse_jacobian": norm}

    levels = noise_levels(fitted, printed)

    as_printed = noise_scale(norm, 0.1, 18.0, 3, 3)
    assert levels["published"] ** 2 / 3 == pytest.approx(3 * as_printed)
    as_fitted = noise_scale(norm, levels["alpha"], 18.0, 3, 3)
    assert 3.364**2 / 3 == pytest.approx(3 * as_fitted)
    assert levels["alpha_u"] == pytest.approx(18 * levels["alpha"])
    assert levels["alpha_u"] > 4.9
    assert levels["ratio"] == pytest.approx(3.364 / levels["published"])
    assert noise_levels({}, printed) == {}


def test_noise_of_the_published_size_breaks_the_speed_limit_of_the_joints():
    """A joint at rest or at its commanded peak speed, with the published std of the third joint."""
    std = published_results()["sigma-omega"]["33"] ** 0.5
    limit = arm().max_speed
    assert RATE * std == pytest.approx(limit[2], rel=0.01)
    draws = std * default_rng(3).standard_normal((500, 2, 3))
    at_rest = np.full(3, 1e-9)
    at_peak = limit / RATE
    nominal = np.broadcast_to([at_rest, at_peak], draws.shape)

    noisy = speed_scores(nominal + draws, nominal, limit, RATE, "abc")
    calm = speed_scores(nominal + draws / 20, nominal, limit, RATE, "abc")

    beyond = "true_moving_steps_beyond_a_speed_limit_share"
    backwards = "true_c_fast_steps_backwards_share"
    assert noisy[beyond] > 0.4 and noisy[backwards] > 0.1
    # control: a twentieth of the noise
    assert calm[beyond] < 0.05 and calm[backwards] == 0


def test_only_measured_minus_nominal_is_the_noise_of_a_random_jacobian():
    """(J⁻¹ − J̲⁻¹)ẋᵈΔt of (Omegk) is ω as estimated here, and minus ω as (OmgReal) prints it."""
    chain = arm()
    factor = np.eye(3) + 0.1 * default_rng(0).standard_normal((3, 3))
    random = chain.jacobian(POSE) @ factor
    q = np.stack([POSE, POSE + np.linalg.solve(random, STEP)])
    mean_inverse = chain.inverse_jacobian(POSE)

    estimated = process_noise(chain, q[None], STEP[None])[0, 0]
    printed = q[0] + mean_inverse @ STEP - q[1]

    expected = (np.linalg.inv(random) - mean_inverse) @ STEP
    assert_allclose(estimated, expected, atol=1e-14)
    assert_allclose(printed, -expected, atol=1e-14)
    assert np.abs(expected).max() > 1e-3


@pytest.mark.parametrize("share", [0.4, 0.8])
def test_noise_of_a_corrected_deviation_is_anticorrelated_and_white_noise_is_not(share):
    """ω = e_{k+1} − e_k of e_{k+1} = (1 − κ)e_k + w_k has the lag-one correlation −κ/2. Band: 5
    standard errors; the control is w itself, which would add up to √M times its size.
    """
    takes = 200
    steps = 320
    w = default_rng(9).standard_normal((takes, steps))
    e = np.zeros((takes, steps + 1))
    for k in range(steps):
        e[:, k + 1] = (1 - share) * e[:, k] + w[:, k]

    of_noise = lag_one_correlation(np.diff(e))
    of_white_noise = lag_one_correlation(w)

    band = 5 / np.sqrt(w.size)
    assert abs(of_noise + share / 2) < band
    assert abs(of_white_noise) < band < share / 2
    random_walk = np.sqrt(steps)
    assert w.sum(axis=1).std() > 0.8 * random_walk
    assert e[:, -1].std() < 0.1 * random_walk


@pytest.mark.parametrize("name", COMPUTED)
def test_another_unit_of_length_is_another_model_but_under_qr_of_the_transpose(name):
    model = WishartModel(0.25, Decomposition(name))
    in_millimetres = STEP * [1000, 1000, 1]

    of_metres = model.covariance(arm(), POSE, STEP)
    of_millimetres = model.covariance(arm(1000), POSE, in_millimetres)

    if name == "qr_transposed":
        assert_allclose(of_millimetres, of_metres, rtol=1e-6)
    else:
        ratio = np.diag(of_millimetres) / np.diag(of_metres)
        assert np.abs(ratio - 1).max() > 0.5
    # control: the nominal step is the same
    nominal = arm(1000).inverse_jacobian(POSE) @ in_millimetres
    assert_allclose(nominal, arm().inverse_jacobian(POSE) @ STEP)


def test_the_noise_under_pivoted_lu_jumps_where_the_pivots_change_and_under_qr_nowhere():
    q = np.tile(POSE, (4001, 1))
    q[:, 0] = np.linspace(-2, 2, 4001)

    def greatest_jump(name: str) -> float:
        model = WishartModel(0.25, Decomposition(name))
        variance = np.diagonal(model.covariance(arm(), q, STEP), axis1=-2, axis2=-1)
        return float(np.abs(np.diff(np.log(variance), axis=0)).max())

    assert greatest_jump("pivoted_lu") > 0.3
    assert greatest_jump("qr") < 1e-3 and greatest_jump("qr_transposed") < 1e-2


def test_steps_through_the_inverse_of_a_gaussian_matrix_have_no_variance():
    """P(|Δq| > t) falls as 1/t, for the determinant has a density at zero; with the inverse
    Gaussian it falls faster than any power.
    """
    rng = default_rng(1)
    chain = arm()
    size = 400_000
    noise = 0.05 * rng.standard_normal((size, 3, 3))
    drawn = chain.jacobian(POSE) + noise

    steps = np.abs(np.linalg.solve(drawn, STEP)[:, 0])

    far = np.array([1.0, 4.0, 16.0])
    tail = np.mean(steps > far[:, None], axis=1)
    # four standard errors of the count beyond the farthest
    band = 4 / np.sqrt(size * tail[-1])
    assert_allclose(far * tail, tail[0], rtol=band)
    # control: the model of the inverse has no step as far
    poses = np.tile(POSE, (size, 1))
    moved, _ = draw_steps(GaussianModel(0.1, 30.0), chain, poses, STEP, rng)
    steps = np.abs(moved[:, 0] - POSE[0])
    assert steps.max() < far[0]


def test_half_of_the_matrices_exceed_the_bound_at_full_level():
    """tr{nΣ} ≤ u² − ‖J̲‖² bounds E‖J‖² by u², and no single norm."""
    rng = default_rng(2)
    inverse = arm().inverse_jacobian(POSE)
    u = 18.0
    draws = 100_000
    scale = np.sqrt(noise_scale(np.linalg.norm(inverse), 1.0, u, 3, 3))

    def norms_at(level: float) -> np.ndarray:
        noise = level * scale * rng.standard_normal((draws, 3, 3))
        return np.linalg.norm(inverse + noise, axis=(1, 2))

    norms = norms_at(1.0)
    assert np.mean(norms**2) == pytest.approx(u**2, rel=0.01)
    assert 0.4 < np.mean(norms > u) < 0.6
    # control: a tenth of the level all but keeps it
    assert np.mean(norms_at(0.1) > u) < 1e-3


HELD = np.radians([-20.0, 100.0, -25.0])
DEVIATION = 0.03  # rad
FRAMES = 240


def slopes(end: str) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) slopes of the errors of the joint angles on the deviations of the joints, and their
    standard errors, of an arm that is commanded to stay at HELD and deviates from it.
    """
    rng = default_rng(9)
    d = rng.normal(scale=DEVIATION, size=(FRAMES, 3))
    clouds = [cloud(HELD + deviation, rng, points=600) for deviation in d]
    commanded = np.broadcast_to(CHAIN.points(HELD)[3], (FRAMES, 2))
    options = made(ArticulationSection, end_point=end)
    fitted = fit_sequence(clouds, CHAIN.origin, commanded, CHAIN, options, HELD)
    error = fitted.q - (HELD + d)

    # least squares on a constant and the deviations
    design = np.column_stack([np.ones(FRAMES), d])
    inverse = np.linalg.inv(design.T @ design)
    coefficients = inverse @ design.T @ error
    residuals = error - design @ coefficients
    residual_variance = np.sum(residuals**2, axis=0) / (FRAMES - 4)
    variance = np.outer(np.diag(inverse), residual_variance)
    return coefficients[1:].T, np.sqrt(variance[1:]).T


@pytest.mark.slow
def test_with_the_commanded_end_the_error_depends_on_the_deviation_and_with_the_fitted_one_not():
    # 4 standard errors: of nine slopes one is that far off in two thousand tests
    slope, error = slopes("fitted")
    assert np.all(np.abs(slope) < 4 * error)
    assert np.all(error < 0.2)

    # the control, and the erratum: with the commanded end every joint's error depends on one at
    # least, those of the last two on each of them by more than the standard errors could hide
    slope, error = slopes("commanded")
    assert np.all(np.any(np.abs(slope) > 4 * error, axis=1))
    assert np.all(np.abs(slope[1:]) > 0.6)


def test_of_two_motions_neither_has_the_lesser_sum_and_trace_and_determinant_disagree():
    task = path_task("planar", 40)
    chain = task.chain
    law = build_model(LAWS["pivoted_lu"])
    sums = []
    log_determinants = []
    for q in feasible_motions(task, 256):
        poses = chain.pose(q)
        v = chain.displacement(poses[:-1], poses[1:])
        covariance = law.covariance(chain, q[:-1], v)
        sums.append(covariance.sum(axis=0))
        moving = np.any(v, axis=-1)
        in_row_space = np.linalg.eigvalsh(covariance[moving])[:, 1:]
        log_determinants.append(np.log(in_row_space).sum())

    by_trace = np.argmin(np.trace(sums, axis1=1, axis2=2))
    by_determinant = np.argmin(log_determinants)

    eigenvalues = np.linalg.eigvalsh(sums[by_determinant] - sums[by_trace])
    margin = 1e-3 * np.abs(eigenvalues).max()
    assert eigenvalues[0] < -margin < margin < eigenvalues[-1]


def planar_motions() -> tuple[PathTask, np.ndarray, np.ndarray]:
    """A path of the planar arm, motions along it (N, 201, 3) in rad, and the steps of their tip."""
    task = path_task("planar", 200)
    motions = feasible_motions(task, 256)
    poses = task.chain.pose(motions)
    return task, motions, task.chain.displacement(poses[:, :-1], poses[:, 1:])


def test_the_least_uncertain_motion_of_the_gaussian_model_goes_where_the_arm_is_worst_conditioned():
    task, motions, tip_steps = planar_motions()
    chain = task.chain
    squares = frobenius(chain.inverse_jacobian(motions[:, :-1])) ** 2
    weighted = squares * np.vecdot(tip_steps, tip_steps)
    worst_conditioned = np.argmax(weighted.sum(axis=1))
    clearance = chain.least_singular_value(motions).mean(axis=1)

    def planned(law: str) -> int:
        sums = summed_variance(build_model(LAWS[law]), task, motions)
        return int(np.argmin(sums))

    assert planned("gaussian") == worst_conditioned
    assert clearance.max() > 1.2 * clearance[worst_conditioned]
    # the control: under the Wishart model by LU it is a better conditioned motion
    assert clearance[planned("pivoted_lu")] > 1.2 * clearance[worst_conditioned]


def test_under_the_wishart_model_by_qr_of_the_transpose_it_is_the_motion_of_least_norm():
    task, motions, tip_steps = planar_motions()
    inverse = task.chain.inverse_jacobian(motions[:, :-1])
    joint_steps = np.matvec(inverse, tip_steps)
    square_norm = np.sum(joint_steps**2, axis=(1, 2))

    def ratio(law: str) -> np.ndarray:
        return summed_variance(build_model(LAWS[law]), task, motions) / square_norm

    constant = ratio("qr_transposed")
    assert_allclose(constant, constant[0], rtol=1e-9)
    # the control: under another decomposition the ratio is not constant
    assert np.ptp(ratio("pivoted_lu")) > 0.1 * constant[0]


CONFIGURATIONS = ("C1", "C2", "C3")
PUBLISHED_SYSTEMS = 1000
CABLES = 3


@pytest.fixture(scope="module")
def bounds() -> dict[str, Bounds]:
    """The printed bounds of each configuration."""
    force = config.read_yaml(ROOT / "data/config.yaml")["dataset"]["force"]
    tension = force["tension_bounds"]
    std = force["tension_std_bounds"]
    kappa = force["kappa_bounds"]

    of_configurations = {}
    for name in CONFIGURATIONS:
        direction = force["configurations"][name]["direction_bounds"]
        ranges = map(tuple, (tension, direction, std, kappa))
        of_configurations[name] = Bounds(*ranges)
    return of_configurations


@pytest.mark.slow
def test_of_the_published_sigma_s_the_second_entry_of_c2_alone_is_doubtful_and_only_just(
    bounds,
):
    """Beyond the 5 % limit of one normal distance, and on that of six (2.638) once the standard
    error is known to a percent.
    """
    distance = np.empty((3, 2))
    control = np.empty((3, 2))
    for i, name in enumerate(CONFIGURATIONS):
        rng = default_rng(i)
        expected = np.diag(expected_sigma_s(bounds[name], CABLES, rng)["diagonal"].mean)
        many = averaged_diagonal(bounds[name], 100 * PUBLISHED_SYSTEMS, rng)
        few = averaged_diagonal(bounds[name], PUBLISHED_SYSTEMS, rng)
        error = 10 * np.diag(many.standard_error)
        published = CLAIMS[f"sigma-s-{name.lower()}"]["published"]
        distance[i] = (published - expected) / error
        # averages over as many systems as the paper's do lie where the expectation says
        control[i] = (np.diag(few.mean) - expected) / error

    assert np.argwhere(np.abs(distance) > 1.96).tolist() == [[1, 1]]
    assert distance[1, 1] == pytest.approx(2.638, rel=0.03)
    assert np.abs(control).max() < 1.96


def averaged_diagonal(bounds: Bounds, systems: int, rng: np.random.Generator):
    """Mean and standard error of the diagonal form of Σ_S over drawn systems."""
    drawn = draw_systems(bounds, systems, CABLES, rng)
    return averaged_sigma_s(drawn)["diagonal"]


def test_a_smaller_theta_meets_the_printed_constraints_with_a_greater_entropy():
    n = 3
    gamma = 2
    entropies = {}
    for theta in (3, 2 * gamma):
        d = theta + n + 1
        law = wishart(d, np.eye(n) / d)
        assert_allclose(law.mean(), np.eye(n))
        # E ‖B⁻¹‖² is finite for more than n + 3 degrees of freedom
        assert d > n + 3
        entropies[theta] = law.entropy()

    assert entropies[3] == pytest.approx(2.786, abs=5e-4)
    assert entropies[2 * gamma] == pytest.approx(2.521, abs=5e-4)


@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_the_distance_of_the_variances_grows_with_the_forces_and_its_share_does_not(
    scale,
):
    bounds = Bounds(
        (3.0 * scale, 5.0 * scale),
        (np.pi / 4, np.pi),
        (0.5 * scale, 1.0 * scale),
        (100.0, 800.0),
    )
    systems = draw_systems(bounds, 500, 3, default_rng(3))
    covariance = wrench_covariance(systems)
    modelled = matrix_model(systems).actuation_part()

    difference = np.diagonal(modelled - covariance, axis1=-2, axis2=-1)
    distance = np.linalg.norm(difference, axis=-1).mean()

    assert distance / scale**2 == pytest.approx(0.1185, rel=1e-3)
    share = variance_errors(modelled, covariance).mean()
    assert share == pytest.approx(0.083, rel=0.02)


@pytest.mark.parametrize(("second", "representable"), [(np.pi / 2, False), (0.0, True)])
def test_the_covariances_of_two_columns_are_no_multiples_of_one_matrix(
    second,
    representable,
):
    rng = default_rng(5)
    kappa = 400.0
    covariances = []
    for angle in (0.0, second):
        angles = rng.vonmises(angle, kappa, 20_000)
        covariances.append(np.cov(np.cos(angles), np.sin(angles)))

    shapes = [covariance / np.trace(covariance) for covariance in covariances]

    distance = np.abs(shapes[0] - shapes[1]).max()
    assert (distance < 0.02) == representable


def test_the_greatest_error_varies_over_repeats_far_more_than_the_mean(bounds):
    study = config.read_yaml(ROOT / "pipeline/conf/wrench/paper.yaml")
    ranges = (study[key] for key in ("kappa", "tension_std", "tension", "direction"))
    options = Wrench([CABLES], *ranges, PUBLISHED_SYSTEMS, 2000, 30, 1)
    _, _, spread = run_study(options, default_rng(5))
    errors = spread[["mean", "maximum"]]
    relative = errors.std() / errors.mean()

    assert relative["maximum"] > 0.05
    assert relative["maximum"] > 3 * relative["mean"]


def test_within_the_bounds_of_the_experiment_actuation_makes_most_of_the_variance(
    bounds,
):
    """The share of the random matrix in the trace of Cov(W), on average over systems within the
    printed bounds.
    """
    trace = partial(np.trace, axis1=-2, axis2=-1)
    for number, name in enumerate(CONFIGURATIONS):
        rng = default_rng(20 + number)
        sigma_s = expected_sigma_s(bounds[name], CABLES, rng)["diagonal"].mean
        model = matrix_model(draw_systems(bounds[name], 2000, CABLES, rng))
        of_actuation = trace(model.actuation_part())

        share = 1 - of_actuation / trace(model.covariance(sigma_s))
        share_of_more = 1 - of_actuation / trace(model.covariance(20 * sigma_s))

        assert share.mean() < 0.1
        # control: with twenty times the matrix's covariance it would be most of it
        assert share_of_more.mean() > 0.4
