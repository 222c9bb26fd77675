"""The hexapod's kinematics against finite differences, closed forms and known singular poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.core.errors import ConfigError, SingularJacobianError, SolverError
from pipeline.studies.outlook.platform import Hexapod, pose_of


def ring(radius: float, corners: list[float], half: float) -> np.ndarray:
    """(6, 3) pairs of joints beside the ``corners`` (degrees)."""
    angles = np.deg2rad([corner + side * half for corner in corners for side in (-1, 1)])
    return radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)


BASE = ring(0.6, [0, 120, 240], 15.0)
HEXAPOD = Hexapod(
    base=BASE,
    platform=np.roll(ring(0.35, [60, 180, 300], 15.0), 1, axis=0),
    home=pose_of(np.array([0.0, 0.0, 0.7]), np.zeros(3)),
    lower=np.full(6, 0.6),
    upper=np.full(6, 1.2),
    max_speed=np.full(6, 0.25),
    length=0.3,
)


def some_poses(count: int) -> np.ndarray:
    rng = np.random.default_rng(5)
    moved = rng.uniform(-0.15, 0.15, (count, 3)) + HEXAPOD.home[:3]
    return pose_of(moved, rng.uniform(-0.4, 0.4, (count, 3)))


def yawed(angle: float) -> np.ndarray:
    """A pose turned by ``angle`` (degrees) about the vertical, above home's."""
    return pose_of(HEXAPOD.home[:3], np.array([0, 0, np.deg2rad(angle)]))


def test_the_pose_comes_back_from_the_legs_of_the_inverse_kinematics():
    poses = some_poses(200)
    q, n = HEXAPOD.legs(poses)
    # an independent route to the legs: a joint at a time
    for pose, lengths in zip(poses[:5], q, strict=False):
        turned = Rotation.from_matrix(pose[3:].reshape(3, 3))
        for leg in range(6):
            joint = pose[:3] + turned.apply(HEXAPOD.platform[leg])
            assert lengths[leg] == pytest.approx(np.linalg.norm(joint - BASE[leg]), rel=1e-14)
    np.testing.assert_allclose(np.linalg.norm(n, axis=-1), 1, rtol=1e-14)
    np.testing.assert_allclose(HEXAPOD.pose(q), poses, rtol=0, atol=1e-11)
    # alone as with the others, and with any leading axes
    assert np.array_equal(HEXAPOD.pose(q[3]), HEXAPOD.pose(q)[3])
    assert np.array_equal(HEXAPOD.pose(q.reshape(4, 50, 6)).reshape(200, 12), HEXAPOD.pose(q))


def test_the_jacobian_is_that_of_finite_differences_of_the_pose():
    h = 1e-6
    for pose in some_poses(4):
        q = HEXAPOD.legs(pose)[0]
        columns = [
            HEXAPOD.displacement(HEXAPOD.pose(q - h * leg), HEXAPOD.pose(q + h * leg)) / (2 * h)
            for leg in np.eye(6)
        ]
        np.testing.assert_allclose(HEXAPOD.jacobian(q), np.stack(columns, -1), atol=2e-8)
        np.testing.assert_allclose(
            HEXAPOD.inverse_jacobian(q) @ np.stack(columns, -1), np.eye(6), atol=1e-7
        )


def test_the_rows_of_the_inverse_are_those_of_the_legs_and_scale_with_the_length_alone():
    pose = some_poses(1)[0]
    q, n = HEXAPOD.legs(pose)
    turned = HEXAPOD.platform @ pose[3:].reshape(3, 3).T
    rows = np.hstack([n, np.cross(turned, n)])
    np.testing.assert_allclose(replace(HEXAPOD, length=1.0).inverse_jacobian(q), rows, atol=1e-11)
    np.testing.assert_allclose(
        HEXAPOD.inverse_jacobian(q), rows / np.repeat([1, 0.3], 3), atol=1e-11
    )


def test_a_displacement_has_the_rotation_vector_in_the_axes_of_the_base():
    start, turn = some_poses(1)[0], np.array([0.2, -0.1, 0.4])
    rotation = Rotation.from_rotvec(turn).as_matrix() @ start[3:].reshape(3, 3)
    end = np.concatenate([start[:3] + np.array([0.1, 0.2, 0.3]), rotation.ravel()])
    np.testing.assert_allclose(
        HEXAPOD.displacement(start, end), [0.1, 0.2, 0.3, *(0.3 * turn)], atol=1e-14
    )


def test_a_quarter_turn_is_singular_and_refused_and_a_smaller_one_is_not():
    """Fichter (1986): at a quarter turn above the base's centre the legs do not hold the yaw."""
    near, at = (HEXAPOD.legs(yawed(angle))[0] for angle in (80.0, 90.0))
    assert HEXAPOD.singular(np.stack([near, at])).tolist() == [False, True]
    with pytest.raises(SingularJacobianError, match="1 leg setting") as refused:
        HEXAPOD.inverse_jacobian(np.stack([near, at]), what="leg setting")
    assert refused.value.evidence["index"] == (1,)
    assert refused.value.evidence["least_singular_value"] < 1e-4
    assert HEXAPOD.singular(np.full(6, np.nan))


def test_similar_figures_of_base_and_platform_are_no_robot():
    with pytest.raises(ConfigError, match="do not hold its platform at home"):
        replace(HEXAPOD, platform=BASE / 2)


def test_legs_that_reach_no_pose_are_refused_with_the_place_and_the_last_pose():
    q = np.stack([HEXAPOD.legs(HEXAPOD.home)[0], [0.2, 0.2, 0.2, 0.2, 0.2, 2.0]])
    with pytest.raises(SolverError, match="reach no pose at 1 place") as refused:
        HEXAPOD.pose(q)
    evidence = refused.value.evidence
    assert evidence["index"] == (1,) and len(evidence["last_pose"]) == 12
    assert evidence["q"] == [0.2, 0.2, 0.2, 0.2, 0.2, 2.0] and evidence["furthest_leg_m"] > 0.1


def test_the_pose_is_that_of_the_start_where_home_is_on_another_branch():
    """Beyond the quarter turn the same legs hold two poses: which one is a matter of the start."""
    path = np.stack([yawed(angle) for angle in (91, 94, 100, 110)])
    q = HEXAPOD.legs(path)[0]
    after = np.stack([HEXAPOD.pose(legs, pose) for legs, pose in zip(q, path, strict=True)])
    np.testing.assert_allclose(after, path, atol=1e-9)
    from_home = HEXAPOD.pose(q)
    np.testing.assert_allclose(HEXAPOD.legs(from_home)[0], q, atol=1e-11)
    assert np.abs(from_home - path).max() > 0.1
