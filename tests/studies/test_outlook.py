"""Laws of the outlook agree with draws of literal matrices through Newton's method, errors with
their definitions; refusals name the key.
"""

from functools import partial

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from scipy.stats import wishart
from study_runs import options_of

from pipeline.core.errors import ConfigError
from pipeline.studies.outlook.stage import (
    equal_models,
    error_rows,
    legs_at,
    lever,
    motion_of,
    slope_rows,
)
from pipeline.wrench.models import Bounds

OPTIONS = options_of("outlook", "paper")
MOTION = motion_of(OPTIONS)
LAWS = equal_models(MOTION, OPTIONS.noise, OPTIONS.bound)
ROTATIONS = Rotation.from_rotvec(OPTIONS.turn).as_matrix().reshape(-1, 9)
POSES = np.hstack([OPTIONS.position, ROTATIONS])  # first and last
RANGES = ((3.0, 5.0), (np.pi / 4, np.pi), (0.5, 1.0), (100.0, 800.0))
BOUNDS = Bounds(*RANGES, elevation=(0.26, 1.3), attachment=(-0.25, 0.25))


def moved(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the poses (N, 12) after steps (N, 6) in m, angular ones times the length."""
    turn = Rotation.from_rotvec(step[:, 3:] / OPTIONS.length)
    before = Rotation.from_matrix(pose[:, 3:].reshape(-1, 3, 3))
    after = (turn * before).as_matrix()
    return np.hstack([pose[:, :3] + step[:, :3], after.reshape(-1, 9)])


def displacement(start: np.ndarray, legs: np.ndarray) -> np.ndarray:
    """Return by Newton's method the displacement (N, 6) from the pose ``start`` (12,) to the poses
    of ``legs``, turns times the length.
    """
    poses = np.broadcast_to(start, (len(legs), 12))
    for _ in range(30):
        lengths, inverse = legs_at(OPTIONS, poses)
        steps = np.linalg.solve(inverse, (legs - lengths)[..., None])
        poses = moved(poses, steps[..., 0])
    assert_allclose(legs_at(OPTIONS, poses)[0], legs, atol=1e-10)

    after = poses[:, 3:].reshape(-1, 3, 3)
    before = start[3:].reshape(3, 3)
    turn = Rotation.from_matrix(after @ before.T).as_rotvec()
    return np.hstack([poses[:, :3] - start[:3], OPTIONS.length * turn])


def additive_steps(law, k: int, draws: int, rng) -> np.ndarray:
    covariance = law.covariance(MOTION, MOTION.q, MOTION.v)[k]
    noise = rng.multivariate_normal(np.zeros(6), covariance, draws)
    return MOTION.inverse[k] @ MOTION.v[k] + noise


def gaussian_steps(law, k: int, draws: int, rng) -> np.ndarray:
    """Algorithm 2, literally: J⁻¹ + N."""
    inverse = MOTION.inverse[k]
    size = law.alpha * np.sqrt((law.u**2 - np.sum(inverse**2)) / 36)
    matrices = inverse + size * rng.standard_normal((draws, 6, 6))
    return matrices @ MOTION.v[k]


def wishart_steps(law, k: int, draws: int, rng, transposed: bool) -> np.ndarray:
    """Algorithm 1, literally: (J₁BJ₂)⁻¹, by QR of J or of its transpose."""
    jacobian = np.linalg.inv(MOTION.inverse[k])
    if transposed:
        q, r = np.linalg.qr(jacobian.T)
        first = r.T
        second = q.T
    else:
        first, second = np.linalg.qr(jacobian)
    d = 7 / law.sigma_b**2
    b = wishart(d, np.eye(6) / d, seed=rng).rvs(draws)
    command = np.broadcast_to(MOTION.v[k][:, None], (draws, 6, 1))
    return np.linalg.solve(first @ b @ second, command)[..., 0]


STEPS_OF = {
    "additive": additive_steps,
    "gaussian": gaussian_steps,
    "qr": partial(wishart_steps, transposed=False),
    "qr_transposed": partial(wishart_steps, transposed=True),
}


@pytest.mark.parametrize("name", LAWS)
def test_laws_have_the_noise_of_the_options(name):
    legs = LAWS[name].covariance(MOTION, MOTION.q, MOTION.v)
    steps = np.matvec(MOTION.inverse, MOTION.v)
    share = np.trace(legs, axis1=1, axis2=2).mean() / np.sum(steps**2, axis=1).mean()
    assert np.sqrt(share) == pytest.approx(OPTIONS.noise, rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_the_noise_of_the_pose_is_that_of_drawn_legs_through_newtons_method(name):
    law = LAWS[name]
    k = 75
    rng = default_rng(7)
    q = MOTION.q[k]
    share = k / (len(MOTION.q) - 1)
    turn = Rotation.from_rotvec(share * np.array(OPTIONS.turn[1])).as_matrix()
    position = POSES[0, :3] + share * (POSES[1] - POSES[0])[:3]
    pose = np.concatenate([position, turn.ravel()])
    assert_allclose(legs_at(OPTIONS, pose)[0], q, atol=1e-12)

    drawn = displacement(pose, q + STEPS_OF[name](law, k, 3000, rng)).var(axis=0)

    # a variance has a relative standard error of 0.026; the second order is a few percent
    variances = np.diag(MOTION.pose_covariance(law)[k])
    assert_allclose(drawn, variances, rtol=0.15)
    # the control: the noise of the legs is not that of the pose
    legs = law.covariance(MOTION, MOTION.q, MOTION.v)[k]
    assert not np.allclose(np.diag(legs), variances, rtol=0.15)


def test_the_inverse_jacobian_is_that_of_finite_differences_of_the_legs():
    pose = POSES[0]
    h = 1e-6
    poses = np.tile(pose, (6, 1))
    ahead, _ = legs_at(OPTIONS, moved(poses, h * np.eye(6)))
    behind, _ = legs_at(OPTIONS, moved(poses, -h * np.eye(6)))

    _, inverse = legs_at(OPTIONS, pose)

    assert_allclose(inverse, (ahead - behind).T / (2 * h), atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (
            {"platform": (0.5 * np.array(OPTIONS.base)).tolist(), "legs": [0.3, 2.0]},
            "turn",
        ),
        ({"legs": [0.7, 0.9]}, "legs"),
        ({"noise": 1e6}, "noise"),
        # Fichter (1986): at a quarter turn above the base's centre the legs do not hold the yaw
        ({"turn": [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]], "legs": [0.3, 2.0]}, "turn"),
    ],
)
def test_what_is_no_robot_or_motion_is_refused_by_its_key(changes, key):
    options = options_of("outlook", "smoke", **changes)
    with pytest.raises(ConfigError) as refused:
        equal_models(motion_of(options), options.noise, options.bound)
    assert refused.value.evidence["key"] == key


def test_errors_fall_with_the_number_of_cables():
    # a cube's root mean square, half its side
    assert lever(BOUNDS) == pytest.approx(0.25)

    rows = []
    for repeat in range(2):
        generator = default_rng(repeat)
        errors = error_rows(BOUNDS, [3, 6, 12, 24], (200, 300), generator)
        rows.append(errors.assign(repeat=repeat))
    slopes = slope_rows(pd.concat(rows))["slope"]
    assert slopes.between(-0.65, -0.35, inclusive="neither").all()
