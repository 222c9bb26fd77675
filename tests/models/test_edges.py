"""Every motion model at the edges of where it is defined: at rest, at and near a singular pose,
past u, beyond the joint limits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles import READINGS
from scipy import stats

from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import frobenius, open_loop
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.law import WishartModel

MEASUREMENT = np.diag([1e-6, 2e-6, 3e-6])
COVARIANCE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
MODELS = {
    "additive": ScaledModel(COVARIANCE),
    "scaled": ScaledModel(COVARIANCE, np.diag([0.04, 0.05, 0.06])),
    "timing": ScaledModel(COVARIANCE, np.full((3, 3), 0.04)),
    **{f"wishart {name}": WishartModel(0.25, each) for name, each in READINGS.items()},
    "gaussian": GaussianModel(6e-4, 1e3),
}
# those without noise at rest
MATRIX = [kind for kind in MODELS if kind not in ("additive", "scaled", "timing")]
SINGULAR = np.array([[0.3, 1.5, 0.2], [0.3, 0.0, 0.2], [0.3, np.pi, 0.2]])


@pytest.mark.parametrize("kind", MODELS)
def test_at_rest_a_matrix_model_stays_and_every_other_has_its_floor(kind, chain, poses):
    model, rest = MODELS[kind], np.zeros(3)
    drawn, clipped = draw_steps(model, chain, poses, rest, np.random.default_rng(1))
    assert clipped == 0
    assert np.array_equal(drawn, poses) == (kind in MATRIX)
    if kind in MATRIX:
        with pytest.raises(ModelDomainError, match="measurement noise"):
            model.log_density(chain, poses, rest, drawn)
        noise = stats.multivariate_normal(cov=MEASUREMENT).logpdf(np.full(3, 1e-3))
        np.testing.assert_allclose(
            model.log_density(chain, poses, rest, poses + 1e-3, MEASUREMENT), noise, rtol=1e-9
        )
    else:
        assert np.all(np.isfinite(model.log_density(chain, poses, rest, drawn)))


@pytest.mark.parametrize("kind", MODELS)
def test_a_singular_pose_is_refused_by_every_method(kind, chain, step):
    model = MODELS[kind]
    calls = [lambda: draw_steps(model, chain, SINGULAR, step, np.random.default_rng(2))]
    calls += [
        lambda m=m: model.log_density(chain, SINGULAR, step, SINGULAR + 0.01, m)
        for m in (None, MEASUREMENT)
    ]
    calls += [lambda: model.mean(chain, SINGULAR, step)]
    for call in calls:
        with pytest.raises(SingularJacobianError) as refused:
            call()
        assert refused.value.evidence["index"] == (1,)


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("sine", [0.1, 0.01, 0.0011])
def test_close_to_a_singular_pose_everything_is_finite(kind, sine, chain, step):
    """Down to the sine below which the inverse is refused."""
    model = MODELS[kind]
    elbow = np.arcsin(sine)
    q = np.array([[0.3, elbow, 0.2], [-1.0, np.pi - elbow, 0.7], [0.5, -elbow, 0.0]])
    drawn, _ = draw_steps(model, chain, np.tile(q, (100, 1)), step, np.random.default_rng(3))
    assert np.all(np.isfinite(drawn))
    # beyond u, as the inverse form is where it counts, there is the measurement's noise alone
    assert np.all(
        np.isfinite(model.log_density(chain, np.tile(q, (100, 1)), step, drawn, MEASUREMENT))
    )
    assert np.all(np.isfinite(model.mean(chain, q, step)))
    assert np.all(np.linalg.eigvalsh(model.covariance(chain, q, step))[:, 1:] >= 0)


def test_past_the_bound_the_noise_is_clipped_and_counted(chain, poses, step):
    norms = frobenius(chain.inverse_jacobian(poses))
    bounded = GaussianModel(0.1, float(np.quantile(norms, 0.7)))
    drawn, clipped = draw_steps(bounded, chain, poses, step, np.random.default_rng(4))
    nominal = poses + np.matvec(chain.inverse_jacobian(poses), step)
    assert clipped == np.count_nonzero(norms > bounded.u) == 60
    unmoved = np.all(np.abs(drawn - nominal) < 1e-13, axis=1)
    assert np.array_equal(unmoved, norms > bounded.u)
    with pytest.raises(ModelDomainError, match="60 of 200"):
        bounded.log_density(chain, poses, step, drawn)
    assert np.all(np.isfinite(bounded.log_density(chain, poses, step, drawn, MEASUREMENT)))


@pytest.mark.parametrize("kind", [kind for kind in MODELS if kind != "gaussian"])
def test_models_without_a_bound_clip_nothing(kind, chain, poses, step):
    assert draw_steps(MODELS[kind], chain, poses, step, np.random.default_rng(5))[1] == 0


@pytest.mark.parametrize("kind", MODELS)
def test_beyond_the_joint_limits_the_model_goes_on_and_the_filter_counts(kind, chain, step):
    """The models know of no limits; the filter loses the particles that leave them, and says how
    many.
    """
    start = np.array([0.4, 1.7, -0.3])
    nominal = np.linalg.solve(chain.jacobian(start), step)
    axis = int(np.argmax(np.abs(nominal)))
    lower, upper = start - 2.0, start + 2.0
    # one limit lies where the nominal step leads, so that about half of the steps leave it
    (upper if nominal[axis] > 0 else lower)[axis] = start[axis] + nominal[axis]
    tight = replace(chain, lower=lower, upper=upper)
    drawn, _ = draw_steps(
        MODELS[kind], tight, np.tile(start, (2000, 1)), step, np.random.default_rng(11)
    )
    outside = np.mean(~tight.within_limits(drawn))
    assert np.all(np.isfinite(drawn)) and 0.2 < outside < 0.8

    def lost(arm) -> int:
        nothing = Measurements(
            "take", np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3))
        )
        begin, options = Start(start, np.zeros((3, 3))), FilterOptions(particles=2000)
        return int(
            particle_filter(
                MODELS[kind],
                arm,
                open_loop(step[None]),
                0.01,
                begin,
                nothing,
                options,
                np.random.default_rng(11),
            ).outside[1]
        )

    assert abs(lost(tight) / 2000 - outside) < 0.05
    # control: with the limits far away next to none is lost
    assert lost(replace(chain, lower=start - 2.0, upper=start + 2.0)) < 0.05 * 2000
