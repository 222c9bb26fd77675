"""Every motion model at the edges of where it is defined: at rest, at and near a singular pose,
past u, beyond the joint limits.
"""

from __future__ import annotations

import numpy as np
import pytest
from oracles import READINGS
from scipy import stats

from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
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
