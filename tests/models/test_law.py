"""Every compiled law of one step: its formula in NumPy from the same stream, the law of NumPy's own
draws, and the edges of where it is defined: at rest, at and near a singular pose, past the bound of
the Gaussian model, beyond the joint limits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles import READINGS
from plain_laws import plain_steps
from scipy import stats

from pipeline.arm.chain import PlanarChain
from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import open_loop
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.law import WishartModel

COVARIANCE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MEASUREMENT = np.diag([1e-6, 2e-6, 3e-6])
NORMAL = {
    "additive": ScaledModel(COVARIANCE),
    "scaled": ScaledModel(COVARIANCE, np.diag([0.04, 0.05, 0.06])),
    "timing": ScaledModel(COVARIANCE, np.full((3, 3), 0.04)),
}
MATRIX = {  # without noise at rest
    **{f"wishart {name}": WishartModel(0.25, each) for name, each in READINGS.items()},
    "gaussian": GaussianModel(0.05, 30.0),
}
MODELS = NORMAL | MATRIX
WIDE = [WishartModel(1.2, each) for each in READINGS.values()]
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
# every first pivot of LU occurs, with and without an exchange after it
ARMS = {
    "the arm's": (np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]]), [1.0, 1.0, -1.0]),
    "askew and long": (np.array([[0.9, 1.5], [-0.7, 1.3], [0.3, -1.7]]), [-1.0, 1.0, -1.0]),
}
POSE, DRAWS = np.array([0.4, 1.7, -0.3]), 30_000
NOTHING = Measurements("take", np.zeros(0), *np.zeros((2, 0, 3)), np.zeros((0, 3, 3)))


def RNG(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("v", [[0.004, -0.003, 0.03], [-0.004, 0.0, 0.0], [0.0, 0.0, 0.0]])
@pytest.mark.parametrize("name", ARMS)
@every_model
def test_every_compiled_law_is_its_formula_in_numpy(model, v, name):
    """And equal streams give equal bits, another stream others."""
    (links, signs), v, ends = ARMS[name], np.array(v), np.full((3, 3), 9.0)
    arm = PlanarChain(np.zeros(2), links, np.array(signs), -ends[0], *ends[1:])
    q = RNG().uniform(-7, 7, (2000, 3))
    q = q[np.abs(np.linalg.det(arm.jacobian(q))) > 0.05 * arm.lengths[0] * arm.lengths[1]]
    one, other = RNG(2), RNG(2)
    moved, clipped = draw_steps(model, arm, q, v, one)
    expected, expected_clipped = plain_steps(model, arm, q, v, other)
    # by the size of a step: a few come near a singular draw and lead far
    assert np.max(np.abs(moved - expected) / (1 + np.abs(expected - q))) < 1e-12
    assert clipped == expected_clipped
    assert one.bit_generator.state == other.bit_generator.state
    assert np.array_equal(draw_steps(model, arm, q, v, RNG(2))[0], moved)
    assert np.array_equal(draw_steps(model, arm, q, v, RNG(3))[0], moved) == (
        not v.any() and not isinstance(model, ScaledModel)
    )


def least_p_value(one: np.ndarray, other: np.ndarray) -> float:
    """Least p-value of two-sample Kolmogorov–Smirnov tests of every coordinate, of sums of them and
    of the distance from the common middle.
    """
    axes = np.concatenate([np.eye(3), RNG(3).normal(size=(3, 4))], axis=1)
    views = [np.column_stack([x @ axes, np.linalg.norm(x - np.median(other, axis=0), axis=1)])
             for x in (one, other)]  # fmt: skip
    return min(stats.ks_2samp(*pair).pvalue for pair in zip(*(x.T for x in views), strict=True))


@pytest.mark.parametrize("model", [*MODELS.values(), *WIDE], ids=[*MODELS, *map(str, range(4))])
def test_draws_by_numpy_have_the_law_of_the_compiled_step(model, chain, step):
    """Of a Wishart step from two gammas, where the compiled one takes one."""
    q = np.tile(POSE, (DRAWS, 1))
    ours, (compiled, _) = (
        model.sample(chain, q, step, RNG(1)),
        draw_steps(model, chain, q, step, RNG(2)),
    )
    assert least_p_value(ours, compiled) > 1e-5
    # control: noise a tenth as large again
    nominal = q + chain.nominal_step(q, step)
    assert least_p_value(nominal + 1.1 * (ours - nominal), compiled) < 1e-6


def test_each_command_moves_its_own_poses_and_all_poses_may_take_one(chain, poses, step):
    model, v = ScaledModel(np.zeros((3, 3))), np.linspace(0.1, 1.0, 4)[:, None] * step
    q = poses[:20].reshape(5, 4, 3)
    drawn, _ = draw_steps(model, chain, q, v, RNG(7))
    np.testing.assert_allclose(drawn, model.mean(chain, q, v), atol=1e-14)
    single, _ = draw_steps(model, chain, q, step, RNG(7))
    np.testing.assert_allclose(single, model.mean(chain, q, step), atol=1e-14)
    # control: the commands belong to their poses
    assert np.abs(drawn - model.mean(chain, q, v[::-1])).max() > 1e-3


@every_model
def test_at_rest_a_matrix_model_stays_and_every_other_has_its_floor(model, chain, poses):
    rest = np.zeros(3)
    drawn, clipped = draw_steps(model, chain, poses, rest, RNG())
    assert clipped == 0
    for each in (drawn, model.sample(chain, poses, rest, RNG())):
        assert np.array_equal(each, poses) != isinstance(model, ScaledModel)
    if isinstance(model, ScaledModel):
        assert np.all(np.isfinite(model.log_density(chain, poses, rest, drawn)))
        return
    with pytest.raises(ModelDomainError, match="measurement noise"):
        model.log_density(chain, poses, rest, drawn)
    noise = stats.multivariate_normal(cov=MEASUREMENT).logpdf(np.full(3, 1e-3))
    density = model.log_density(chain, poses, rest, poses + 1e-3, MEASUREMENT)
    np.testing.assert_allclose(density, noise, rtol=1e-9)


@every_model
@pytest.mark.parametrize("pose", [[0.3, 0.0, 0.2], [0.3, np.pi, 0.2], [0.3, 1e-15, 0.2],
                                  [np.nan, 1.0, 0.2]])  # fmt: skip
def test_a_singular_pose_is_refused_by_every_method(model, pose, chain, step):
    """A least singular value of 1e-15 too, which rounding would turn into numbers."""
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


@pytest.mark.parametrize("sine", [0.1, 0.01, 0.0011])
@every_model
def test_close_to_a_singular_pose_everything_is_finite(model, sine, chain, step):
    """Down to the sine below which the inverse is refused."""
    elbow = np.arcsin(sine)
    q = np.array([[0.3, elbow, 0.2], [-1.0, np.pi - elbow, 0.7], [0.5, -elbow, 0.0]])
    many = np.tile(q, (100, 1))
    drawn, _ = draw_steps(model, chain, many, step, RNG(3))
    # beyond u the Gaussian model has the measurement's noise alone
    density = model.log_density(chain, many, step, drawn, MEASUREMENT)
    for values in (drawn, density, model.mean(chain, q, step)):
        assert np.all(np.isfinite(values))
    assert np.all(np.linalg.eigvalsh(model.covariance(chain, q, step))[:, 1:] >= 0)


@every_model
def test_beyond_the_joint_limits_the_model_goes_on_and_the_filter_counts(model, chain, step):
    """The models know of no limits; the filter loses the particles that leave them, and says how
    many.
    """
    nominal, wide = np.linalg.solve(chain.jacobian(POSE), step), (POSE - 2.0, POSE + 2.0)
    axis, tight = int(np.argmax(np.abs(nominal))), np.array(wide)
    # one limit lies where the nominal step leads, so that about half of the steps leave it
    tight[int(nominal[axis] > 0), axis] = POSE[axis] + nominal[axis]

    def arm(ends) -> PlanarChain:
        return replace(chain, lower=ends[0], upper=ends[1])

    def lost(ends) -> int:
        begin = Start(POSE, np.zeros((3, 3)))
        run = arm(ends), open_loop(step[None]), 0.01, begin, NOTHING, FilterOptions(particles=2000)
        return int(particle_filter(model, *run, RNG(11)).outside[1])

    drawn, _ = draw_steps(model, arm(tight), np.tile(POSE, (2000, 1)), step, RNG(11))
    outside = np.mean(~arm(tight).within_limits(drawn))
    assert np.all(np.isfinite(drawn)) and 0.2 < outside < 0.8
    assert abs(lost(tight) / 2000 - outside) < 0.05
    # control: with the limits far away next to none is lost
    assert lost(wide) < 0.05 * 2000
