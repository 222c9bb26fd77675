"""Each model at the recorded level has the recorded total variance and keeps all else it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_arm import motion, random_arm

from pipeline.core.errors import ModelDomainError
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.noise import mean_covariance
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.steps import Recorded, at_recorded_level
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

MEASUREMENT = 1e-10 * np.diag([1.0, 2.0, 3.0])
FULL = np.array([[2.0, -0.5, 0.1], [-0.5, 1.0, 0.2], [0.1, 0.2, 3.0]])
MODELS = {
    "additive": ScaledModel(1e-7 * FULL),
    "gaussian": GaussianModel(0.1, 40.0),
    "scaled": ScaledModel(1e-8 * FULL, 1e-3 * FULL),
    "wishart": WishartModel(0.1, Decomposition("pivoted_lu")),
    "wishart without a covariance": WishartModel(1.2, Decomposition("qr_transposed")),
}


def recorded(size: float = 1e-4, m: int = 3) -> Recorded:
    """Twelve takes of a motion that begins with a rest, their noise of ``size`` rad."""
    arm = random_arm(3, m)
    q, v = motion(arm, 40, 10)
    noise = size * np.random.default_rng(5).standard_normal((12, *q[:-1].shape))
    joints = ("one", "two", "three")
    return Recorded(arm, np.tile(q[:-1], (12, 1, 1)), v, noise, joints, MEASUREMENT)


def recorded_trace(recorded) -> float:
    """Mean trace of the sample covariance of the process noise over steps, in rad²."""
    return float(np.trace(mean_covariance(recorded.noise)))


def model_trace(model, recorded) -> float:
    """Mean trace of the exact covariance of a step over takes and steps, in rad²."""
    covariance = model.covariance(recorded.chain, recorded.q, recorded.v)
    return float(np.trace(covariance, axis1=-2, axis2=-1).mean())


@pytest.mark.parametrize("m", [3, 2])
@pytest.mark.parametrize("size", [1e-4, 1e-1])
@pytest.mark.parametrize("name", MODELS)
def test_the_total_variance_is_the_recorded_one(name, size, m):
    data = recorded(size, m)
    model = MODELS[name]
    if m == 2 and name == "wishart":
        model = replace(model, decomposition=Decomposition("qr"))
    own = at_recorded_level(model, data)
    assert model_trace(own, data) + np.trace(MEASUREMENT) == pytest.approx(
        recorded_trace(data), rel=1e-9
    )
    # what is no level stays, and so does the course over time of a normal model
    assert type(own) is type(model)
    assert getattr(own, "u", None) == getattr(model, "u", None)
    assert getattr(own, "decomposition", None) == getattr(model, "decomposition", None)
    if name in ("additive", "gaussian", "scaled"):
        at = data.chain, data.q, data.v
        before, after = model.covariance(*at), own.covariance(*at)
        ratio = model_trace(own, data) / model_trace(model, data)
        np.testing.assert_allclose(after, ratio * before, rtol=1e-12)
    # of a loop that is closed every take has its own commands
    closed = replace(data, v=np.tile(data.v, (len(data.q), 1, 1)))
    assert model_trace(at_recorded_level(model, closed), data) == pytest.approx(
        model_trace(own, data), rel=1e-12
    )


def test_there_is_no_level_without_noise_of_the_motion():
    quiet, at_rest = recorded(1e-6), recorded()
    at_rest = replace(at_rest, v=np.zeros_like(at_rest.v))
    for model in MODELS.values():
        with pytest.raises(ModelDomainError, match="not above that of the measurement noise"):
            at_recorded_level(model, quiet)
    with pytest.raises(ModelDomainError, match="without noise"):
        at_recorded_level(GaussianModel(0.0, 40.0), recorded())
    for name in ("gaussian", "wishart"):
        with pytest.raises(ModelDomainError, match=r"without noise|at rest at every step"):
            at_recorded_level(MODELS[name], at_rest)
    with pytest.raises(ModelDomainError, match="at the limit of its covariance"):
        at_recorded_level(MODELS["wishart"], recorded(1e3))
    never_at_rest = replace(recorded(), v=np.ones_like(recorded().v), known_measurement=None)
    with pytest.raises(ModelDomainError, match="never rests"):
        at_recorded_level(MODELS["additive"], never_at_rest)
