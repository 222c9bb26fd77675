"""Measured poses of the tip: the likelihood is that of Pinocchio's displacement, the posterior the
Kalman update's where everything is nearly linear, and planar arms are refused.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal
from space_arms import LWR4, link_poses

from pipeline.arm.model import chain_of, load_arm
from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.model import open_loop
from pipeline.models.scaled.law import ScaledModel

CHAIN = chain_of(LWR4)
START = np.array([0.3, 0.9, -0.3, -1.6, 0.4, 1.0, 0.2])
STILL = ScaledModel(1e-20 * np.eye(7))
DT = 0.01


def spread(scale: float, seed: int = 1, d: int = 6) -> np.ndarray:
    """(d, d) a covariance of about ``scale``² with every correlation."""
    root = np.random.default_rng(seed).normal(size=(d, d)) / np.sqrt(d) + np.eye(d)
    return scale**2 * root @ root.T


def pose(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    return np.concatenate([position, rotation.ravel()])


def displaced(q: np.ndarray, by: np.ndarray) -> np.ndarray:
    """(12,) Pinocchio's pose of the flange at ``q``, displaced ``by`` (6,) m and rad."""
    (rotation,), (position,) = link_poses(LWR4, "flange", q[None])
    return pose(pin.exp3(by[3:]) @ rotation, position + by[:3])


def measured(t: float, y: np.ndarray, covariance: np.ndarray, bias=None) -> Measurements:
    bias = np.zeros(6) if bias is None else bias
    return Measurements("t", np.array([t]), y[None], bias[None], covariance[None], tip=True)


def filtered(take: Measurements, command: np.ndarray, covariance=None, count: int = 100):
    """From ``START``, by default exactly there."""
    start = Start(START, np.zeros((7, 7)) if covariance is None else covariance)
    options, rng = FilterOptions(count, "none"), np.random.default_rng(5)
    return particle_filter(STILL, CHAIN, open_loop(command), DT, start, take, options, rng)


def log_density(q: np.ndarray, y: np.ndarray, covariance: np.ndarray, bias=0.0) -> float:
    """Of ``y`` about the flange at ``q``, by Pinocchio and SciPy."""
    (rotation,), (position,) = link_poses(LWR4, "flange", q[None])
    way = y[:3] - position
    turn = pin.log3(y[3:].reshape(3, 3) @ rotation.T)
    return multivariate_normal.logpdf(np.concatenate([way, turn]), bias * np.ones(6), covariance)


@pytest.mark.parametrize("size", [1e-3, 0.1, 1.0])
def test_the_likelihood_is_that_of_the_displacement_from_where_the_joints_carry_the_tip(size):
    covariance, by = spread(size), size * np.random.default_rng(2).normal(size=6)
    y = displaced(START, by)
    evidence = filtered(measured(0.0, y, covariance), np.zeros((1, 13))).log_evidence
    assert evidence == pytest.approx(log_density(START, y, covariance), abs=1e-8)
    # control: at another posture it is another
    assert abs(evidence - log_density(START + 0.3 * size, y, covariance)) > 1e-3


def test_a_frame_within_a_step_is_held_against_the_path_there():
    w = np.full(7, 0.02)
    command = np.concatenate([CHAIN.jacobian(START) @ w, w])[None]
    covariance, y = spread(0.01), displaced(START + 0.3 * w, np.full(6, 0.004))
    evidence = filtered(measured(0.3 * DT, y, covariance), command).log_evidence
    assert evidence == pytest.approx(log_density(START + 0.3 * w, y, covariance), abs=1e-6)
    assert abs(evidence - log_density(START + w, y, covariance)) > 0.01


def test_a_bias_displaces_what_is_expected():
    bias, covariance = 0.02 * np.random.default_rng(3).normal(size=6), spread(0.01)
    y = displaced(START, np.zeros(6))
    (rotation,) = Rotation.from_rotvec(bias[None, 3:]).as_matrix()
    shifted = pose(rotation @ y[3:].reshape(3, 3), y[:3] + bias[:3])
    exact, biased, ignored = (
        filtered(take, np.zeros((1, 13))).log_evidence
        for take in (
            measured(0.0, y, covariance),
            measured(0.0, shifted, covariance, bias),
            measured(0.0, shifted, covariance),
        )
    )
    assert biased == pytest.approx(exact, abs=1e-9)
    assert ignored < exact - 0.1


def test_the_posterior_of_nearly_linear_arms_is_the_kalman_updates():
    before, noise, count = spread(1.5e-3, 4, 7), spread(4e-3, 5), 200_000
    y = displaced(START, np.array([2e-3, -3e-3, 1e-3, 2e-3, 4e-3, -3e-3]))
    posterior = filtered(measured(0.0, y, noise), np.zeros((1, 13)), before, count)
    jacobian = pin.computeFrameJacobian(
        (model := pin.buildModelFromUrdf(LWR4.urdf)),
        model.createData(),
        START,
        model.getFrameId("flange", pin.FrameType.BODY),
        pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
    )
    gain = before @ jacobian.T @ np.linalg.inv(jacobian @ before @ jacobian.T + noise)
    (rotation,), (position,) = link_poses(LWR4, "flange", START[None])
    way = np.concatenate([y[:3] - position, pin.log3(y[3:].reshape(3, 3) @ rotation.T)])
    covariance = before - gain @ jacobian @ before
    std, effective = np.sqrt(np.diag(covariance)), posterior.ess[0]
    band = 5 / np.sqrt(effective)
    assert np.all(np.abs(posterior.mean[0] - START - gain @ way) < band * std + 2e-5)
    scaled = (posterior.covariance[0] - covariance) / np.outer(std, std)
    assert np.abs(scaled).max() < 2 * band + 0.02
    # control: the prior is neither
    assert np.abs(gain @ way / std).max() > 10 * band
    assert np.abs((before - covariance) / np.outer(std, std)).max() > 0.2


def test_one_direction_of_seven_joints_stays_as_it_was():
    """Six rows leave the arm its null space."""
    before = 1e-6 * np.eye(7)
    y = displaced(START, np.zeros(6))
    posterior = filtered(measured(0.0, y, 2e-7 * np.eye(6)), np.zeros((1, 13)), before, 200_000)
    *_, rows = np.linalg.svd(CHAIN.jacobian(START))
    variance = np.einsum("ij,jk,ik->i", rows, posterior.covariance[0], rows)
    band = 5 * np.sqrt(2 / posterior.ess[0])
    assert variance[-1] == pytest.approx(1e-6, rel=band) and band < 0.2
    assert variance[0] < 0.2e-6  # control: what moves the tip most is known


def test_a_planar_arm_and_shapes_that_disagree_are_refused():
    planar = load_arm(
        LWR4.urdf.replace("lwr4", "youbot"),
        ["arm_joint_2", "arm_joint_3", "arm_joint_4"],
        "arm_tool",
        {},
    ).chain
    take = measured(0.0, displaced(START, np.zeros(6)), np.eye(6))
    start = Start(np.array([2.0, -2.0, 1.0]), 1e-6 * np.eye(3))
    with pytest.raises(ModelDomainError, match="an arm in space"):
        particle_filter(
            ScaledModel(np.eye(3)),
            planar,
            open_loop(np.zeros((1, 3))),
            DT,
            start,
            take,
            FilterOptions(10),
            np.random.default_rng(1),
        )
    with pytest.raises(ContractError, match="covariance has shape"):
        Measurements("t", np.zeros(1), np.zeros((1, 12)), np.zeros((1, 6)), np.eye(12)[None], True)
