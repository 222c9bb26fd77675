"""Poses of rigid bodies from measured points: exact, as accurate as the points allow, and none
where these do not decide it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.arm.frames import rigid_motion

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
