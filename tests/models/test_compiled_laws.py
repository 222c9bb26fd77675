"""Compiled laws of one step against their formulas in NumPy from the same stream, against NumPy's
draws and their moments on arms of any size, at rest and at singular poses.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from numpy_laws import plain_steps
from printed_algorithms import READINGS, least_p_value
from random_arm import motion, random_arm
from scipy import stats

from pipeline.arm.chain import PlanarChain, SerialChain
from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kernel import LAWS
from pipeline.models.wishart.decomposition import Decomposition, split
from pipeline.models.wishart.law import WishartModel, step_covariance

COVARIANCE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MEASUREMENT = np.diag([1e-6, 2e-6, 3e-6])
NORMAL = {"additive": AdditiveModel(COVARIANCE)}
WISHART = {f"wishart {name}": WishartModel(0.25, READINGS[name]) for name in READINGS}
# without noise at rest
MATRIX = WISHART | {"gaussian": GaussianModel(0.05, 30.0)}
MODELS = NORMAL | MATRIX
WIDE = {f"{name}, wide": WishartModel(1.2, READINGS[name]) for name in READINGS}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
# every first pivot of LU occurs, with and without an exchange after it
ARMS = {
    "the arm's": (
        np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]]),
        [1.0, 1.0, -1.0],
    ),
    "askew and long": (
        np.array([[0.9, 1.5], [-0.7, 1.3], [0.3, -1.7]]),
        [-1.0, 1.0, -1.0],
    ),
}
POSE = np.array([0.4, 1.7, -0.3])
DRAWS = 20_000
SIGMA_B = 0.2


@pytest.fixture
def rng() -> np.random.Generator:
    return default_rng(1)


def regular_poses(arm: PlanarChain) -> np.ndarray:
    """(P, 3) poses anywhere but near singular ones."""
    q = default_rng(1).uniform(-7, 7, (2000, 3))
    determinant = np.linalg.det(arm.jacobian(q))
    return q[np.abs(determinant) > 0.05 * arm.lengths[0] * arm.lengths[1]]


COMMANDS = np.array([[0.004, -0.003, 0.03], [-0.004, 0.0, 0.0], [0.0, 0.0, 0.0]])


@pytest.mark.parametrize("v", COMMANDS, ids=str)
@pytest.mark.parametrize("name", ARMS)
@every_model
def test_every_compiled_law_is_its_formula_in_numpy(model, name, v):
    """Equal streams give equal bits, another stream gives others. The compiled step solves with the
    Cholesky factor of JJᵀ, whose error grows with the squared condition number of J; NumPy's step
    solves with LU of J.
    """
    links, signs = ARMS[name]
    ends = np.full((3, 3), 9.0)
    arm = PlanarChain(np.zeros(2), links, np.array(signs), -ends[0], *ends[1:])
    q = regular_poses(arm)
    condition = np.linalg.cond(arm.jacobian(q))
    sound = condition < 400
    assert sound.mean() > 0.98

    compiled_rng = default_rng(2)
    plain_rng = default_rng(2)
    moved, clipped = draw_steps(model, arm, q, v, compiled_rng)
    expected, expected_clipped = plain_steps(model, arm, q, v, plain_rng)

    # relative to the step: a few poses and draws are nearly singular and lead far
    step = np.abs(expected - q)
    error = np.max(np.abs(moved - expected) / (1 + step), axis=1)
    assert error[sound].max() < 1e-12
    assert np.all(error < np.finfo(float).eps * (1 + condition**2))
    assert clipped == expected_clipped
    assert compiled_rng.bit_generator.state == plain_rng.bit_generator.state

    again, _ = draw_steps(model, arm, q, v, default_rng(2))
    assert_array_equal(again, moved)
    of_other_stream, _ = draw_steps(model, arm, q, v, default_rng(3))
    is_silent = not v.any() and not model.traits.noisy_at_rest
    assert np.array_equal(of_other_stream, moved) == is_silent


def standardised(
    drawn: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
) -> tuple[float, float]:
    """Distances of the draws' mean, in standard errors, and of their covariance, in products of
    standard deviations.
    """
    std = np.sqrt(np.diag(covariance))
    of_mean = (drawn.mean(axis=0) - mean) / std * np.sqrt(len(drawn))
    of_covariance = (np.cov(drawn.T) - covariance) / np.outer(std, std)
    return np.abs(of_mean).max(), np.abs(of_covariance).max()


@pytest.mark.parametrize(
    "model",
    [*MODELS.values(), *WIDE.values()],
    ids=[*MODELS, *WIDE],
)
def test_draws_have_the_models_moments_and_by_numpy_the_law_of_the_compiled_step(
    model,
    chain,
    step,
):
    """NumPy draws a Wishart step from two gamma variates, the compiled law from one. Bands: five
    standard errors of a mean and of a covariance.
    """
    q = np.tile(POSE, (30_000, 1))
    sampled = model.sample(chain, q, step, default_rng(1))
    compiled, clipped = draw_steps(model, chain, q, step, default_rng(2))

    assert least_p_value(sampled, compiled) > 1e-5
    assert clipped == 0
    # control: noise that is 10 % larger
    nominal = q + chain.nominal_step(q, step)
    wider = nominal + 1.1 * (sampled - nominal)
    assert least_p_value(wider, compiled) < 1e-6

    if model in WIDE.values():  # has no covariance
        return
    moments = model.mean(chain, POSE, step), model.covariance(chain, POSE, step)
    for drawn in (sampled, compiled):
        of_mean, of_covariance = standardised(drawn, *moments)
        assert of_mean < 5 and of_covariance < 0.07


REST = np.zeros(3)


@every_model
def test_at_rest_a_matrix_model_stays_and_every_other_has_its_floor(
    model,
    chain,
    poses,
    rng,
):
    drawn, clipped = draw_steps(model, chain, poses, REST, rng)
    sampled = model.sample(chain, poses, REST, rng)

    assert clipped == 0
    for moved in (drawn, sampled):
        assert np.array_equal(moved, poses) != model.traits.noisy_at_rest


@pytest.mark.parametrize("model", NORMAL.values(), ids=NORMAL)
def test_a_model_that_is_noisy_at_rest_has_a_density_there(model, chain, poses, rng):
    drawn, _ = draw_steps(model, chain, poses, REST, rng)
    density = model.log_density(chain, poses, REST, drawn)
    assert np.all(np.isfinite(density))


@pytest.mark.parametrize("model", MATRIX.values(), ids=MATRIX)
def test_at_rest_a_matrix_model_has_the_density_of_the_measurement_alone(
    model,
    chain,
    poses,
):
    at_rest = chain, poses, REST
    assert_array_equal(model.mean(*at_rest), poses)
    assert not np.any(model.covariance(*at_rest))
    with pytest.raises(ModelDomainError, match="measurement noise"):
        model.log_density(*at_rest, poses)

    noise = stats.multivariate_normal(cov=MEASUREMENT).logpdf(np.full(3, 1e-3))
    density = model.log_density(*at_rest, poses + 1e-3, MEASUREMENT)
    assert_allclose(density, noise, rtol=1e-9)


@every_model
def test_noise_depends_on_the_jacobian_where_the_law_says_so(model, chain, step):
    """The steps at two poses are the same joint step."""
    second = POSE + np.array([0.5, -0.8, 0.4])
    same = chain.jacobian(second) @ chain.nominal_step(POSE, step)

    first_covariance = model.covariance(chain, POSE, step)
    second_covariance = model.covariance(chain, second, same)

    is_equal = np.allclose(first_covariance, second_covariance, rtol=1e-9, atol=0)
    is_of_joint_step = model is MATRIX["wishart qr_transposed"]
    assert is_equal == (is_of_joint_step or not model.traits.needs_jacobian)


@pytest.mark.parametrize("kind", [-1, max(LAWS) + 1, 99])
def test_a_law_of_an_unknown_kind_is_refused(kind, chain, step, monkeypatch, rng):
    model = MATRIX["gaussian"]
    moved, _ = draw_steps(model, chain, POSE, step, rng)
    assert np.all(moved != POSE)

    law = model.law(chain)._replace(kind=kind)
    monkeypatch.setattr(GaussianModel, "law", lambda self, chain: law)
    with pytest.raises(ModelDomainError, match="no law of this kind"):
        draw_steps(model, chain, POSE, step, rng)


SINGULAR = [
    pytest.param([0.3, 0.0, 0.2], id="stretched"),
    pytest.param([0.3, np.pi, 0.2], id="folded"),
    # rounding gives finite numbers there
    pytest.param([0.3, 1e-15, 0.2], id="least singular value of 1e-15"),
    pytest.param([np.nan, 1.0, 0.2], id="not a number"),
]


@every_model
@pytest.mark.parametrize("pose", SINGULAR)
def test_a_singular_pose_is_refused_by_every_method(model, pose, chain, step, rng):
    q = np.array([[0.3, 1.5, 0.2], pose])
    calls = [
        lambda: draw_steps(model, chain, q, step, rng),
        lambda: model.sample(chain, q, step, rng),
        lambda: model.log_density(chain, q, step, q + 0.01),
        lambda: model.log_density(chain, q, step, q + 0.01, MEASUREMENT),
        lambda: model.mean(chain, q, step),
    ]
    for call in calls:
        with pytest.raises(SingularJacobianError) as refused:
            call()
        assert refused.value.evidence["index"] == (1,)


SIZES = [(6, 6), (7, 6), (3, 2), (5, 1)]


def arm_and_command(n: int, m: int) -> tuple[SerialChain, np.ndarray, np.ndarray]:
    """Random arm, regular pose and command."""
    arm = random_arm(n, m)
    q, v = motion(arm, 1, 0)
    return arm, q[0], v[0]


ROWS = [  # joints, task rows and decomposition; one row is one pivot: J₁ is a number, as with QR
    *[(n, m, name) for n, m in SIZES for name in ("qr", "qr_transposed")],
    *[(n, m, "pivoted_lu") for n, m in SIZES if m > 1],
]


@pytest.mark.parametrize("n, m, name", ROWS)
def test_wishart_steps_have_the_moments_of_the_closed_form_whatever_the_size(
    n,
    m,
    name,
):
    """Bands: five standard errors of the mean and of the covariance, which has heavy tails."""
    chain, q, command = arm_and_command(n, m)
    decomposition = Decomposition(name)
    v = command[:m]
    jacobian = chain.jacobian(q)
    a, back, _ = split(jacobian, v, decomposition)
    d = (m + 1) / SIGMA_B**2
    of_task = d / (d - m - 1) * np.linalg.pinv(jacobian) @ v
    mean = q + chain.null_step(q, command) + of_task

    model = WishartModel(SIGMA_B, decomposition)
    many = np.tile(q, (DRAWS, 1))
    drawn, _ = draw_steps(model, chain, many, command, default_rng(4))

    of_mean, of_covariance = standardised(
        drawn,
        mean,
        step_covariance(a, back, SIGMA_B),
    )
    assert of_mean < 5 and of_covariance < 0.08
    # control: a dispersion that is 10 % larger
    wider = step_covariance(a, back, 1.1 * SIGMA_B)
    assert standardised(drawn, mean, wider)[1] > 0.1


def test_the_first_steps_of_a_serial_arm_do_not_depend_on_the_number_of_poses():
    chain, q, command = arm_and_command(7, 6)
    many = q + 0.1 * default_rng(6).standard_normal((300, 7))
    model = MODELS["wishart qr"]
    moved, _ = draw_steps(model, chain, many, command, default_rng(4))
    for number in (64, 128, 256):  # whole sets of variates
        few, _ = draw_steps(model, chain, many[:number], command, default_rng(4))
        assert_array_equal(few, moved[:number])


@pytest.mark.parametrize("n, m", SIZES)
def test_normal_models_steps_are_their_formula_in_numpy_whatever_the_size(n, m):
    chain, middle, command = arm_and_command(n, m)
    q = middle + 0.1 * default_rng(6).standard_normal((300, n))
    factor = 1e-3 * default_rng(5).standard_normal((n, n))
    noise = factor @ factor.T + 1e-8 * np.eye(n)
    norms = np.linalg.norm(np.linalg.pinv(chain.jacobian(q)), axis=(1, 2))
    bounded = GaussianModel(0.1, float(np.median(norms)))

    for model, of_poses in ((AdditiveModel(noise), 0), (bounded, 150)):
        moved, clipped = draw_steps(model, chain, q, command, default_rng(4))
        expected, expected_clipped = plain_steps(
            model,
            chain,
            q,
            command,
            default_rng(4),
        )
        error = np.abs(moved - expected) / (1 + np.abs(expected - q))
        assert error.max() < 1e-12
        assert clipped == expected_clipped == of_poses


def test_a_covariance_of_other_joints_than_the_arms_is_refused():
    with pytest.raises(ModelDomainError, match="run the stage fit"):
        NORMAL["additive"].law(random_arm(7, 6))
