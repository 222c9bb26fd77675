"""The same physics on an arm of seven joints and six task rows, and the rigid bodies on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from space_arms import LWR4, link_poses

from pipeline.arm.model import chain_of, link_chains
from pipeline.arm.serial import SerialChain
from pipeline.laboratory.dynamics import simulate_take, true_chain
from pipeline.laboratory.mocap import MarkerCluster, as_built, capture_bodies, in_body
from pipeline.laboratory.options import DynamicsOptions, MocapOptions, TrajectoryOptions
from pipeline.laboratory.session import open_session, perform
from pipeline.laboratory.swing import desired_path

CHAIN = chain_of(LWR4)
MOTION = TrajectoryOptions(
    folded=(0.30, 0.95, -0.30, -1.60, 0.40, 1.05, 0.20),
    extended=(-0.30, 0.35, 0.40, -0.80, -0.40, 0.45, 0.90),
    rest=0.306,
    ramp=0.35,
)
NO_OFFSET = np.zeros(7)


@pytest.fixture
def still(quiet):
    return replace(quiet, sway_std=(0.0,) * 6)


def test_the_tip_sways_as_stated_along_every_row_of_the_task(still, rng):
    std = np.array([1e-4, 2e-4, 3e-4, 1e-3, 2e-3, 4e-3])
    options, takes = replace(still, sway_std=tuple(std), sway_rest=1.0), 40
    base = simulate_take(CHAIN, NO_OFFSET, MOTION, still, rng).q
    moved = [simulate_take(CHAIN, NO_OFFSET, MOTION, options, rng).q for _ in range(takes)]
    added = np.stack(moved) - base
    sway = np.einsum("kij,nkj->nki", CHAIN.jacobian(base), added)
    # samples are 5 ms apart and ∫ρ² is 4.29 lags of 13.5 ms: a twelfth of them counts
    band = 4.5 / np.sqrt(2 * sway[..., 0].size / 12)
    np.testing.assert_allclose(sway.std(axis=(0, 1)), std, rtol=band)
    # of the seven joints' steps none lies in the null space, which nobody shakes
    null = added - np.einsum("kij,nkj->nki", CHAIN.inverse_jacobian(base), sway)
    assert np.abs(null).max() < 1e-12 < np.abs(added).max()


def test_links_are_built_longer_or_shorter_where_there_are_links(still, rng):
    options = replace(still, length_std=3e-4)
    built = [true_chain(CHAIN, options, rng).placements for _ in range(500)]
    ways = np.array(built)[..., 9:]
    lengths, nominal = np.linalg.norm(ways, axis=2), np.linalg.norm(CHAIN.placements[:, 9:], axis=1)
    spread = (lengths - nominal).std(axis=0)
    linked = nominal > 0
    linked[0] = False  # the base is where it was calibrated
    np.testing.assert_allclose(spread[linked], 3e-4, rtol=4.5 / np.sqrt(2 * 500))
    assert linked.sum() == 4 and not spread[~linked].any()
    assert np.array_equal(built[0][:, :9], CHAIN.placements[:, :9])


PLACES = np.array([[0.08, 0.0, 0.01], [-0.01, 0.08, 0.0], [-0.07, -0.03, 0.01], [0.0, -0.05, 0.02]])
MOUNT = (PLACES.mean(axis=0), [0.2, -0.4, 1.1])
BASE = (Rotation.from_euler("xyz", [-1.5, 0.1, 0.3]).as_matrix(), np.array([0.4, 0.9, -1.2]))
SILENT = MocapOptions(noise_std=0, placement_std=0, occlusion_rate=0)
LINKS = {"Fore": "link_5", "Hand": "flange"}


@pytest.fixture(scope="module")
def chains():
    return dict(zip(LINKS, link_chains(LWR4, LINKS.values(), "markers").values(), strict=True))


def clusters(chains, places: np.ndarray = PLACES) -> dict[str, MarkerCluster]:
    shape = in_body(PLACES, *MOUNT)
    return {name: MarkerCluster(chain, places, shape) for name, chain in chains.items()}


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
    bodies = [capture_bodies(clusters(chains), q, BASE, each, rng) for each in (SILENT, options)]
    still, shaken = (poses["Hand"] for poses in bodies)
    band = 4.5 / np.sqrt(2 * 5000)
    np.testing.assert_allclose((shaken[0] - still[0]).std(axis=0), 2.5e-5, rtol=band)
    turns = Rotation.from_quat(still[1]).inv() * Rotation.from_quat(shaken[1])
    local = in_body(PLACES, *MOUNT)
    lever = np.linalg.inv(np.eye(3) * np.sum(local**2) - local.T @ local)
    spread = np.cov(turns.as_rotvec().T)
    np.testing.assert_allclose(np.diag(spread), 25e-10 * np.diag(lever), rtol=2 * band)


def test_a_body_is_lost_where_fewer_than_three_of_its_markers_are_seen(chains, rng):
    options = replace(SILENT, occlusion_rate=0.1, occlusion_frames=1.0)
    q = np.repeat(joint_angles(1), 20_000, axis=0)
    position, quaternion = capture_bodies(clusters(chains), q, BASE, options, rng)["Hand"]
    gone = np.isnan(position).any(axis=1)
    assert np.array_equal(gone, np.isnan(quaternion).any(axis=1))
    # of four markers two or more are hidden
    share = 1 - 0.9**4 - 4 * 0.1 * 0.9**3
    assert abs(gone.mean() - share) < 4.5 * np.sqrt(share / 20_000)
    assert abs(gone.mean() - (1 - 0.9**4)) > 4.5 * np.sqrt(share / 20_000)  # control: one or more


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


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8])
def test_arms_of_one_to_eight_joints_move_under_every_disturbance(n, dynamics, rng):
    m = min(n, 6)
    turns = Rotation.random(n + 1, rng=rng).as_matrix().reshape(-1, 9)
    placements = np.hstack([turns, rng.uniform(-0.3, 0.3, (n + 1, 3))])
    limits = np.full(n, -3.0), np.full(n, 3.0), np.full(n, 2.0)
    task = ("x", "y", "z", "rx", "ry", "rz")[:m]
    chain = SerialChain(task, 1.0, placements, np.zeros(n, bool), *limits)
    start = rng.uniform(-1.5, 1.5, n)
    way = replace(MOTION, folded=tuple(start), extended=tuple(start + 0.05))
    options = replace(dynamics, sway_std=(1e-4,) * m, clearance=1e-3, play_joint=n)
    motion = perform(open_session(chain, options, rng), way, options, rng)
    path = desired_path(chain, way)
    assert motion.truth.shape == (321, n)
    # the starts, the zeros and the ripple, and what the sway makes of the joints at a slow pace
    assert 1e-5 < np.abs(motion.truth - path).max() < 0.1
