"""Compiled laws of one step against their formulas in NumPy from the same stream, against NumPy's
draws and their moments on arms of any size, at rest and at singular poses.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose
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
MATRIX = {  # without noise at rest
    **{
        f"wishart {name}": WishartModel(0.25, reading)
        for name, reading in READINGS.items()
    },
    "gaussian": GaussianModel(0.05, 30.0),
}
MODELS = NORMAL | MATRIX
WIDE = {
    f"{name}, wide": WishartModel(1.2, reading) for name, reading in READINGS.items()
}
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
POSE, DRAWS, SIGMA_B = np.array([0.4, 1.7, -0.3]), 20_000, 0.2


def RNG(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("name", ARMS)
@every_model
def test_every_compiled_law_is_its_formula_in_numpy(model, name):
    """Equal streams give equal bits, another stream gives others. The compiled step solves with the
    Cholesky factor of JJᵀ, whose error grows with the squared condition number of J; NumPy's step
    solves with LU of J.
    """
    (links, signs) = ARMS[name]
    ends = np.full((3, 3), 9.0)
    arm = PlanarChain(np.zeros(2), links, np.array(signs), -ends[0], *ends[1:])
    q = RNG().uniform(-7, 7, (2000, 3))
    q = q[
        np.abs(np.linalg.det(arm.jacobian(q))) > 0.05 * arm.lengths[0] * arm.lengths[1]
    ]
    condition = np.linalg.cond(arm.jacobian(q))
    sound = condition < 400

    assert sound.mean() > 0.98

    for v in np.array([[0.004, -0.003, 0.03], [-0.004, 0.0, 0.0], [0.0, 0.0, 0.0]]):
        compiled_rng, plain_rng = RNG(2), RNG(2)
        moved, clipped = draw_steps(model, arm, q, v, compiled_rng)
        expected, expected_clipped = plain_steps(model, arm, q, v, plain_rng)
        # relative to the step: a few poses and draws are nearly singular and lead far
        step = np.abs(expected - q)
        error = np.max(np.abs(moved - expected) / (1 + step), axis=1)
        assert error[sound].max() < 1e-12
        assert np.all(error < np.finfo(float).eps * (1 + condition**2))
        assert clipped == expected_clipped
        assert compiled_rng.bit_generator.state == plain_rng.bit_generator.state
        assert np.array_equal(draw_steps(model, arm, q, v, RNG(2))[0], moved)
        assert np.array_equal(draw_steps(model, arm, q, v, RNG(3))[0], moved) == (
            not v.any() and not model.traits.noisy_at_rest
        )


def standardised(drawn: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> tuple:
    """Distances of the draws' mean, in standard errors, and of their covariance, in products of
    standard deviations.
    """
    spread = np.sqrt(np.diag(covariance))
    apart = np.abs(drawn.mean(axis=0) - mean) / spread * np.sqrt(len(drawn))
    off = np.cov(drawn.T).reshape(covariance.shape) - covariance
    return apart.max(), np.abs(off / np.outer(spread, spread)).max()


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
    ours = model.sample(chain, q, step, RNG(1))
    compiled = draw_steps(model, chain, q, step, RNG(2))
    assert least_p_value(ours, compiled[0]) > 1e-5 and compiled[1] == 0

    # control: noise that is 10 % larger
    nominal = q + chain.nominal_step(q, step)
    assert least_p_value(nominal + 1.1 * (ours - nominal), compiled[0]) < 1e-6

    if model not in WIDE.values():
        moments = model.mean(chain, POSE, step), model.covariance(chain, POSE, step)
        for drawn in (ours, compiled[0]):
            apart, off = standardised(drawn, *moments)
            assert apart < 5 and off < 0.07


@every_model
def test_at_rest_a_matrix_model_stays_and_every_other_has_its_floor(
    model,
    chain,
    poses,
):
    rest = np.zeros(3)
    drawn, clipped = draw_steps(model, chain, poses, rest, RNG())
    assert clipped == 0
    for moved in (drawn, model.sample(chain, poses, rest, RNG())):
        assert np.array_equal(moved, poses) != model.traits.noisy_at_rest

    if model.traits.noisy_at_rest:
        assert np.all(np.isfinite(model.log_density(chain, poses, rest, drawn)))
        return
    assert np.array_equal(model.mean(chain, poses, rest), poses)
    assert not np.any(model.covariance(chain, poses, rest))
    with pytest.raises(ModelDomainError, match="measurement noise"):
        model.log_density(chain, poses, rest, drawn)

    noise = stats.multivariate_normal(cov=MEASUREMENT).logpdf(np.full(3, 1e-3))
    density = model.log_density(chain, poses, rest, poses + 1e-3, MEASUREMENT)
    assert_allclose(density, noise, rtol=1e-9)


@every_model
def test_noise_depends_on_the_jacobian_where_the_law_says_so(model, chain, step):
    """The steps at two poses are the same joint step."""
    second = POSE + np.array([0.5, -0.8, 0.4])
    same = chain.jacobian(second) @ chain.nominal_step(POSE, step)
    covariances = (
        model.covariance(chain, POSE, step),
        model.covariance(chain, second, same),
    )
    needed = (
        model.traits.needs_jacobian and model is not MATRIX["wishart qr_transposed"]
    )

    assert np.allclose(*covariances, rtol=1e-9, atol=0) != needed


@pytest.mark.parametrize("kind", [-1, max(LAWS) + 1, 99])
def test_a_law_of_an_unknown_kind_is_refused(kind, chain, step, monkeypatch):
    assert np.all(draw_steps(MATRIX["gaussian"], chain, POSE, step, RNG())[0] != POSE)
    law = MATRIX["gaussian"].law(chain)._replace(kind=kind)
    monkeypatch.setattr(GaussianModel, "law", lambda self, chain: law)
    with pytest.raises(ModelDomainError, match="no law of this kind"):
        draw_steps(MATRIX["gaussian"], chain, POSE, step, RNG())


@every_model
@pytest.mark.parametrize("pose", [[0.3, 0.0, 0.2], [0.3, np.pi, 0.2], [0.3, 1e-15, 0.2],
                                  [np.nan, 1.0, 0.2]])  # fmt: skip
def test_a_singular_pose_is_refused_by_every_method(model, pose, chain, step):
    """Also for a least singular value of 1e-15, at which rounding gives finite numbers."""
    q = np.array([[0.3, 1.5, 0.2], pose])
    for call in (
        lambda: draw_steps(model, chain, q, step, RNG()),
        lambda: model.sample(chain, q, step, RNG()),
        lambda: model.log_density(chain, q, step, q + 0.01),
        lambda: model.log_density(chain, q, step, q + 0.01, MEASUREMENT),
        lambda: model.mean(chain, q, step),
    ):
        with pytest.raises(SingularJacobianError) as refused:
            call()
        assert refused.value.evidence["index"] == (1,)


SIZES = [(6, 6), (7, 6), (3, 2), (5, 1)]


def arm_and_command(n: int, m: int) -> tuple[SerialChain, np.ndarray, np.ndarray]:
    """Random arm, regular pose and command."""
    arm = random_arm(n, m)
    q, v = motion(arm, 1, 0)
    return arm, q[0], v[0]


@pytest.mark.parametrize("n, m", SIZES)
def test_wishart_steps_have_the_moments_of_the_closed_form_whatever_the_size(n, m):
    """Bands: five standard errors of the mean and of the covariance, which has heavy tails."""
    chain, q, command = arm_and_command(n, m)
    v, jacobian = command[:m], chain.jacobian(q)
    # one row is one pivot: J₁ is a number, as with QR
    for name in ("pivoted_lu", "qr", "qr_transposed")[m == 1 :]:
        law = Decomposition(name)
        model = WishartModel(SIGMA_B, law)
        many = np.tile(q, (DRAWS, 1))
        drawn, _ = draw_steps(model, chain, many, command, RNG(4))
        (a, back, _) = split(jacobian, v, law)
        d = (m + 1) / SIGMA_B**2
        null = chain.null_step(q, command)
        mean = q + null + d / (d - m - 1) * np.linalg.pinv(jacobian) @ v
        apart, off = standardised(drawn, mean, step_covariance(a, back, SIGMA_B))
        assert apart < 5 and off < 0.08
        # control: a dispersion that is 10 % larger
        assert (
            standardised(drawn, mean, step_covariance(a, back, 1.1 * SIGMA_B))[1] > 0.1
        )


def test_the_first_steps_of_a_serial_arm_do_not_depend_on_the_number_of_poses():
    chain, q, command = arm_and_command(7, 6)
    many = q + 0.1 * RNG(6).standard_normal((300, 7))
    model = MODELS["wishart qr"]
    moved, _ = draw_steps(model, chain, many, command, RNG(4))
    for number in (64, 128, 256):  # whole sets of variates
        few, _ = draw_steps(model, chain, many[:number], command, RNG(4))
        assert np.array_equal(few, moved[:number])


@pytest.mark.parametrize("n, m", SIZES)
def test_normal_models_steps_are_their_formula_in_numpy_whatever_the_size(n, m):
    chain, q, command = arm_and_command(n, m)
    q = q + 0.1 * RNG(6).standard_normal((300, n))
    factor = 1e-3 * RNG(5).standard_normal((n, n))
    noise = factor @ factor.T + 1e-8 * np.eye(n)
    norms = np.linalg.norm(np.linalg.pinv(chain.jacobian(q)), axis=(1, 2))
    bounded = GaussianModel(0.1, float(np.median(norms)))
    for model in (AdditiveModel(noise), bounded):
        moved, clipped = draw_steps(model, chain, q, command, RNG(4))
        expected, expected_clipped = plain_steps(model, chain, q, command, RNG(4))
        assert np.max(np.abs(moved - expected) / (1 + np.abs(expected - q))) < 1e-12
        assert clipped == expected_clipped == (150 if model is bounded else 0)

    with pytest.raises(ModelDomainError, match="run the stage fit"):
        NORMAL["additive"].law(random_arm(7, 6))
