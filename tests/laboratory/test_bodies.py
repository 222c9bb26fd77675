"""The laboratory's rigid bodies: exact without noise, as noisy as their markers make them, lost
where fewer than three of these are seen, and misplaced with them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from space_arms import LWR4, link_poses

from pipeline.arm.model import chain_of, link_chains
from pipeline.laboratory.bodies import Cluster, as_built, capture_bodies, in_body
from pipeline.laboratory.dynamics import true_chain
from pipeline.laboratory.options import DynamicsOptions, MocapOptions

PLACES = np.array([[0.08, 0.0, 0.01], [-0.01, 0.08, 0.0], [-0.07, -0.03, 0.01], [0.0, -0.05, 0.02]])
MOUNT = (PLACES.mean(axis=0), [0.2, -0.4, 1.1])
BASE = (Rotation.from_euler("xyz", [-1.5, 0.1, 0.3]).as_matrix(), np.array([0.4, 0.9, -1.2]))
SILENT = MocapOptions(noise_std=0, placement_std=0, occlusion_rate=0)
LINKS = {"Fore": "link_5", "Hand": "flange"}


@pytest.fixture(scope="module")
def chains():
    return dict(zip(LINKS, link_chains(LWR4, LINKS.values(), "markers").values(), strict=True))


def clusters(chains, places: np.ndarray = PLACES) -> dict[str, Cluster]:
    shape = in_body(PLACES, *MOUNT)
    return {name: Cluster(chain, places, shape) for name, chain in chains.items()}


def joint_angles(frames: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(-1.5, 1.5, (frames, 7))


def test_without_noise_a_body_is_where_pinocchio_carries_its_mount(chains, rng):
    q = joint_angles(20)
    captured = capture_bodies(clusters(chains), q, BASE, SILENT, rng)
    for name, link in LINKS.items():
        rotation, position = link_poses(LWR4, link, q)
        at = (position + rotation @ MOUNT[0]) @ BASE[0].T + BASE[1]
        turn = BASE[0] @ rotation @ Rotation.from_euler("xyz", MOUNT[1]).as_matrix()
        np.testing.assert_allclose(captured[name][0], at, atol=1e-12)
        pose = Rotation.from_quat(captured[name][1]).as_matrix()
        np.testing.assert_allclose(pose, turn, atol=1e-12)


def test_the_noise_of_a_pose_is_that_of_its_markers(chains, rng):
    q = np.repeat(joint_angles(1), 5000, axis=0)
    options = replace(SILENT, noise_std=5e-5)
    still, shaken = (
        capture_bodies(clusters(chains), q, BASE, chosen, rng)["Hand"]
        for chosen in (SILENT, options)
    )
    band = 4.5 / np.sqrt(2 * 5000)
    np.testing.assert_allclose((shaken[0] - still[0]).std(axis=0), 2.5e-5, rtol=band)
    turns = Rotation.from_quat(still[1]).inv() * Rotation.from_quat(shaken[1])
    local = in_body(PLACES, *MOUNT)
    lever = np.linalg.inv(np.eye(3) * np.sum(local**2) - local.T @ local)
    spread = np.cov(turns.as_rotvec().T)
    np.testing.assert_allclose(np.diag(spread), 25e-10 * np.diag(lever), rtol=2 * band)


def test_a_body_is_lost_where_fewer_than_three_of_its_markers_are_seen(chains, rng):
    options = replace(SILENT, occlusion_rate=0.1, occlusion_frames=1.0)
    position, quaternion = capture_bodies(
        clusters(chains), np.repeat(joint_angles(1), 20_000, axis=0), BASE, options, rng
    )["Hand"]
    gone = np.isnan(position).any(axis=1)
    assert np.array_equal(gone, np.isnan(quaternion).any(axis=1))
    # of four markers two or more are hidden
    share = 1 - 0.9**4 - 4 * 0.1 * 0.9**3
    assert abs(gone.mean() - share) < 4.5 * np.sqrt(share / 20_000)
    assert abs(gone.mean() - (1 - 0.9**4)) > 4.5 * np.sqrt(share / 20_000)  # control: one or more


def test_misplaced_markers_displace_the_body_in_its_own_frame(chains, rng):
    moved = PLACES + np.array([1e-3, 0.0, 0.0])
    q = joint_angles(5)
    at, off = (
        capture_bodies(clusters(chains, places), q, BASE, SILENT, rng)["Hand"][0]
        for places in (PLACES, moved)
    )
    rotation, _ = link_poses(LWR4, "flange", q)
    np.testing.assert_allclose(off - at, 1e-3 * (BASE[0] @ rotation)[..., 0], atol=1e-12)


def test_a_link_follows_the_arm_as_it_was_built(chains, rng):
    nominal = chain_of(LWR4)
    built = true_chain(nominal, DynamicsOptions(sway_std=(0.0,) * 6, length_std=3e-3), rng)
    q = joint_angles(4)
    hand = as_built(chains["Hand"], built).pose(q)[:, :3]
    # only the last length, from the wrist to the flange, is the link's own
    last = built.placements[-1, 9:] - nominal.placements[-1, 9:]
    turn = built.pose(q)[:, 3:].reshape(-1, 3, 3)
    np.testing.assert_allclose(hand + turn @ last, built.pose(q)[:, :3], atol=1e-12)
    assert np.abs(hand - chains["Hand"].pose(q)[:, :3]).max() > 1e-3
