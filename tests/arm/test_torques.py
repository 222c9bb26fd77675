"""Torques of the youBot's motors against Lagrange's equations, written out in the plane."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arm.model import greatest_torques, torques
from pipeline.core.options.dataset import Robot
from tests.arm.example_urdf import JOINTS, LOCKED, YOUBOT

ROBOT = Robot(str(YOUBOT), JOINTS, "arm_tool", locked=LOCKED, plane=True)
GRAVITY = 9.81  # m/s²
HEADING = np.cumsum(np.deg2rad([-65.0, 146.0, -102.5]))  # of links 2 to 4 about y where q = 0
LINK = np.array([0.155, 0.135])  # m, from joint 2 to 3 and from 3 to 4
# of links 2 to 5: kg, kg·m² about y, m from the joint in the plane; link 5 is held to link 4
MASS = np.array([1.155, 0.934, 0.877, 0.371])
INERTIA = np.array([0.004447, 0.002571, 0.001173, 0.000339])
CENTRE = np.array([[0.0, 0.10453], [0.0, 0.0967], [0.0, 0.05103], [-0.002, 0.130 - 0.00492]])
STEP = 1e-4  # rad


def centres(q: np.ndarray) -> np.ndarray:
    """(4, 2) m, horizontal and vertical places of the links' centres of mass against joint 2."""
    heading = HEADING + np.cumsum(q)
    turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    turn = np.moveaxis(turn, -1, 0)  # of each link: rows horizontal and vertical
    joints = np.cumsum([np.zeros(2), *(turn[:2, :, 1] * LINK[:, None])], axis=0)
    moved = [0, 1, 2, 2]
    return joints[moved] + np.einsum("kij,kj->ki", turn[moved], CENTRE)


def derivative(function, q: np.ndarray) -> np.ndarray:
    """(..., 3) of ``function`` with respect to each joint angle, by central differences."""
    steps = STEP * np.eye(3)
    return np.stack(
        [(function(q + step) - function(q - step)) / (2 * STEP) for step in steps], axis=-1
    )


def inertia(q: np.ndarray) -> np.ndarray:
    """(3, 3) kg·m², of all joints."""
    moved = derivative(centres, q)
    turned = np.array([[1.0, 0, 0], [1, 1, 0], [1, 1, 1], [1, 1, 1]])
    return np.einsum("k,kia,kib->ab", MASS, moved, moved) + np.einsum(
        "k,ka,kb->ab", INERTIA, turned, turned
    )


def lagrange(q: np.ndarray, speed: np.ndarray, acceleration: np.ndarray) -> dict[str, np.ndarray]:
    """(3,) N·m each, what bears the weight, what accelerates and what the speeds ask."""
    slope = derivative(inertia, q)
    return {
        "weight": derivative(lambda q: GRAVITY * MASS @ centres(q)[:, 1], q),
        "acceleration": inertia(q) @ acceleration,
        "speed": slope @ speed @ speed - np.einsum("a,abc,b->c", speed, slope, speed) / 2,
    }


@pytest.fixture(scope="module")
def states() -> np.ndarray:
    """(3, 12, 3): angles, speeds and accelerations."""
    rng = np.random.default_rng(4)
    q = rng.uniform([0, -5, 0], [2.7, 0, 3.5], (12, 3))
    return np.stack([q, rng.normal(0, 1.5, (12, 3)), rng.normal(0, 20.0, (12, 3))])


def test_the_torques_are_those_of_lagranges_equations(states):
    own = torques(ROBOT, *states)
    parts = [lagrange(*state) for state in states.swapaxes(0, 1)]
    stated = np.array([sum(part.values()) for part in parts])
    np.testing.assert_allclose(own, stated, atol=2e-5)
    # control: without any of the three they are not
    for name in parts[0]:
        rest = stated - np.array([part[name] for part in parts])
        assert np.abs(own - rest).max() > 1e-2


def test_a_joint_that_is_held_leaves_the_others_torques_as_they_are(states):
    q, _, acceleration = states
    moving = np.zeros_like(q)
    moving[:, 2] = acceleration[:, 2]
    whole = torques(ROBOT, q, np.zeros_like(q), moving)
    for angles, acting, stated in zip(q, moving, whole, strict=True):
        locked = LOCKED | dict(zip(JOINTS[:2], angles[:2].tolist(), strict=True))
        one = Robot(str(YOUBOT), JOINTS[2:], "arm_tool", locked=locked, plane=True, task=["phi"])
        alone = torques(one, angles[None, 2:], np.zeros((1, 1)), acting[None, 2:])
        np.testing.assert_allclose(alone, [stated[2:]], atol=1e-12)


def test_the_greatest_torques_are_those_of_the_urdf():
    assert greatest_torques(ROBOT).tolist() == [9.5, 6.0, 2.0]


def test_a_continuous_joint_takes_the_torques_of_a_revolute_one_at_the_same_angle(tmp_path):
    text = YOUBOT.read_text().replace(
        '"arm_joint_3" type="revolute"', '"arm_joint_3" type="continuous"'
    )
    file = tmp_path / "endless.urdf"
    file.write_text(text)
    endless = Robot(str(file), JOINTS, "arm_tool", locked=LOCKED, plane=True)
    q, speed, acceleration = np.random.default_rng(3).uniform(-2, 2, (3, 4, 3))
    np.testing.assert_allclose(
        torques(endless, q, speed, acceleration), torques(ROBOT, q, speed, acceleration), atol=1e-12
    )
