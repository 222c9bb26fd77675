"""The same physics on an arm of seven joints and six task rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from space_arms import LWR4

from pipeline.arm.model import chain_of
from pipeline.arm.serial import SerialChain
from pipeline.core.errors import ConfigError
from pipeline.laboratory.dynamics import simulate_take, true_chain
from pipeline.laboratory.options import TrajectoryOptions
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


def test_without_disturbances_it_follows_its_command(still, rng):
    lab = open_session(CHAIN, still, rng)
    motion = perform(lab, MOTION, still, rng)
    path = desired_path(CHAIN, MOTION)
    assert motion.truth.shape == path.shape == (321, 7)
    assert np.abs(motion.truth - path).max() < 2e-3
    assert np.array_equal(motion.truth, motion.motion_capture)


def test_the_tip_sways_as_stated_along_every_row_of_the_task(still, rng):
    std = np.array([1e-4, 2e-4, 3e-4, 1e-3, 2e-3, 4e-3])
    options, takes = replace(still, sway_std=tuple(std), sway_rest=1.0), 40
    base = simulate_take(CHAIN, NO_OFFSET, MOTION, still, rng).q
    added = np.stack(
        [simulate_take(CHAIN, NO_OFFSET, MOTION, options, rng).q - base for _ in range(takes)]
    )
    sway = np.einsum("kij,nkj->nki", CHAIN.jacobian(base), added)
    # samples are 5 ms apart and ∫ρ² is 4.29 lags of 13.5 ms: a twelfth of them counts
    band = 4.5 / np.sqrt(2 * sway[..., 0].size / 12)
    np.testing.assert_allclose(sway.std(axis=(0, 1)), std, rtol=band)
    # of the seven joints' steps none lies in the null space, which nobody shakes
    null = added - np.einsum("kij,nkj->nki", CHAIN.inverse_jacobian(base), sway)
    assert np.abs(null).max() < 1e-12 < np.abs(added).max()


def test_the_play_is_that_of_the_joint_that_has_it(still, rng):
    base = simulate_take(CHAIN, NO_OFFSET, MOTION, still, rng).q
    loose = replace(still, clearance=0.01, play_joint=6, rattle_speed=0.5)
    added = simulate_take(CHAIN, NO_OFFSET, MOTION, loose, rng).q - base
    assert np.flatnonzero(np.abs(added).max(axis=0) > 1e-15).tolist() == [5]
    assert 1e-3 < np.abs(added).max() <= 0.01


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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"folded": (0.0,) * 6, "extended": (0.5,) * 6}, "must have 7 angles each"),
        ({"extended": (-0.30, 2.5, 0.40, -0.80, -0.40, 0.45, 0.90)}, "leaves the joint limits"),
        ({"extended": (-2.30, 0.35, 0.40, -0.80, -0.40, 0.45, 0.90)}, "faster than the joints"),
    ],
)
def test_motions_that_the_arm_cannot_do_are_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        desired_path(CHAIN, replace(MOTION, **change))


def test_ends_of_different_arms_are_refused():
    with pytest.raises(ConfigError, match="an angle for every joint"):
        replace(MOTION, folded=(0.0,) * 6)


@pytest.mark.parametrize("n", range(1, 9))
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
