"""Poses of rigid bodies from measured points: exact, as accurate as the points allow, and none
where these do not decide it. The trajectory of commanded joint angles: of a planar chain poses, in
space displacements of rotations; beside them the joints of a redundant arm.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.frames import rigid_motion
from pipeline.arm.model import load_arm
from pipeline.arm.serial import SerialChain
from pipeline.core.columns import values

PLACES = np.array([[0.08, 0.0, 0.01], [-0.01, 0.08, 0.0], [-0.07, -0.03, 0.01], [0.0, -0.08, 0.04]])


def moved(number: int, places: np.ndarray, rng) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rotation = Rotation.random(number, rng=rng).as_matrix()
    translation = rng.normal(size=(number, 3))
    return rotation, translation, translation[:, None] + places @ np.swapaxes(rotation, 1, 2)


def test_a_pose_comes_back_from_all_its_points_and_from_any_three():
    rotation, translation, world = moved(50, PLACES, np.random.default_rng(1))
    world[10:20, 1] = np.nan
    found_rotation, position = rigid_motion(PLACES, world)
    np.testing.assert_allclose(found_rotation, rotation, atol=1e-12)
    np.testing.assert_allclose(position, translation, atol=1e-12)


def test_points_that_do_not_decide_it_give_no_pose():
    line = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]])
    _, _, world = moved(3, PLACES, np.random.default_rng(1))
    world[1, :2] = np.nan
    world[2] = np.nan
    assert np.isnan(rigid_motion(PLACES, world)[1]).all(axis=1).tolist() == [False, True, True]
    assert np.isnan(rigid_motion(line, moved(1, line, np.random.default_rng(1))[2])[1]).all()


def test_the_noise_of_a_pose_is_that_of_its_points_over_their_number_and_levers():
    rng, std = np.random.default_rng(2), 1e-4
    places = PLACES - PLACES.mean(axis=0)
    rotation, translation, world = moved(20_000, places, rng)
    estimate, position = rigid_motion(places, world + std * rng.standard_normal(world.shape))
    turn = Rotation.from_matrix(np.swapaxes(rotation, 1, 2) @ estimate).as_rotvec()
    inertia = np.eye(3) * np.sum(places**2) - places.T @ places
    expected = std * np.sqrt(np.diag(np.linalg.inv(inertia)))
    band = 4.5 / np.sqrt(2 * len(turn))
    np.testing.assert_allclose((position - translation).std(axis=0), std / 2, rtol=band)
    np.testing.assert_allclose(turn.std(axis=0), expected, rtol=band)
    # control: about the axis of the largest lever the turn is known better than about the others
    assert turn.std(axis=0)[2] < (1 - 4 * band) * turn.std(axis=0)[0]


RATE, ROWS = 50.0, ("x", "y", "z", "rx", "ry", "rz")
JOINTS = tuple("abcdefg")
# joints about z, y, z, y, … 0.2 m apart, a twist before every other one
TWISTS = [Rotation.from_euler("x", angle).as_matrix() for angle in (0, 90, -90, 90, -90, 90, -90)]


def serial(task: tuple[str, ...], length: float = 1.0) -> SerialChain:
    n = len(TWISTS)
    offset = [0.0, 0.0, 0.2]
    placements = [np.concatenate([twist.ravel(), twist @ offset]) for twist in TWISTS]
    placements.append(np.concatenate([np.eye(3).ravel(), offset]))
    bound = np.full(n, np.inf)
    return SerialChain(task, length, np.array(placements), np.zeros(n, bool), -bound, bound, bound)


def tip(q: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Position and rotation of the tip, joint by joint."""
    position, rotation = np.zeros(3), Rotation.identity()
    for twist, angle in zip(TWISTS, q, strict=True):
        rotation = rotation * Rotation.from_matrix(twist)
        position = position + rotation.apply([0, 0, 0.2])
        rotation = rotation * Rotation.from_euler("z", angle)
    return position + rotation.apply([0, 0, 0.2]), rotation


@pytest.fixture
def motion() -> np.ndarray:
    """(30, 7) rad, at rest over its first five steps."""
    t = np.maximum(np.arange(30) - 5, 0) / 20
    return 0.5 + np.sin(t)[:, None] * np.linspace(-1.2, 1.0, 7)


def test_each_step_is_the_displacement_between_two_poses(motion):
    table = trajectory_table(serial(ROWS, 0.5), motion, RATE, JOINTS)
    steps, places = values(table, "v") / RATE, values(table, "x")
    first = tip(motion[0])
    for k, (start, end) in enumerate(pairwise(motion)):
        (a, before), (b, after) = tip(start), tip(end)
        np.testing.assert_allclose(steps[k, :3], b - a, atol=1e-12)
        turned = (after * before.inv()).as_rotvec()
        np.testing.assert_allclose(steps[k, 3:], 0.5 * turned, atol=1e-12)
        away = (after * first[1].inv()).as_rotvec()
        np.testing.assert_allclose(places[k + 1, 3:], 0.5 * away, atol=1e-12)
        np.testing.assert_allclose(places[k + 1, :3], b, atol=1e-12)
    assert not places[0, 3:].any() and not steps[:5].any() and not steps[-1].any()
    # the control: rotations do not add up as positions do
    np.testing.assert_allclose(places[-1, :3] - places[0, :3], steps.sum(axis=0)[:3], atol=1e-12)
    assert np.abs(places[-1, 3:] - steps.sum(axis=0)[3:]).max() > 1e-3


def test_a_redundant_arm_has_its_joints_commanded_too(motion):
    table = trajectory_table(serial(("x", "rz")), motion, RATE, JOINTS)
    assert list(table)[2:6] == ["x:x", "x:rz", "v:x", "v:rz"]
    speeds = values(table, "u")
    np.testing.assert_allclose(speeds[:-1], np.diff(motion, axis=0) * RATE, atol=1e-12)
    assert not speeds[-1].any()


def test_in_the_plane_the_pose_itself_is_commanded():
    joints = ["joint_2", "joint_3", "joint_4"]
    chain = load_arm("pipeline/arm/ur5.urdf", joints, "wrist_centre", {}).chain
    q = np.linspace([-2.0, -1.5, -0.5], [-2.5, -1.0, -1.0], 20)
    table = trajectory_table(chain, q, RATE, joints)
    assert list(table) == ["k", "t", "x:x", "x:z", "x:phi", "v:x", "v:z", "v:phi"]
    np.testing.assert_array_equal(values(table, "x"), chain.pose(q))
    np.testing.assert_allclose(
        np.diff(values(table, "x"), axis=0), values(table, "v")[:-1] / RATE, atol=1e-15
    )
