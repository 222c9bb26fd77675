"""Arms of the public collection example-robot-data against Pinocchio.

The collection is part of the peers' environment, which ``make test-all`` makes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.arm.model import chain_of
from pipeline.arm.serial import LEAST_SINGULAR
from pipeline.core.options.dataset import Robot
from tests.arm.arm_urdfs import by_pinocchio

PEERS = Path(__file__).parents[2] / ".venv-peers"
UNIVERSAL = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow")]
UNIVERSAL += [f"wrist_{j}_joint" for j in (1, 2, 3)]
TIAGO = [f"arm_{j}_joint" for j in range(1, 8)]
ARMS = {  # URDF, joints, tip, base
    "UR5": ("ur_description/urdf/ur5_robot.urdf", UNIVERSAL, "tool0", "base"),
    "UR10": ("ur_description/urdf/ur10_robot.urdf", UNIVERSAL, "ee_link", "base_link"),
    "Panda": (
        "panda_description/urdf/panda.urdf",
        [f"panda_joint{j}" for j in range(1, 8)],
        "panda_hand_tcp",
        None,
    ),
    "xArm7": ("xarm_description/urdf/xarm7.urdf", [f"joint{j}" for j in range(1, 8)], None, None),
    "Kinova": (  # three of its joints are continuous
        "kinova_description/robots/kinova.urdf",
        [f"j2s6s200_joint_{j}" for j in range(1, 7)],
        "j2s6s200_end_effector",
        None,
    ),
    "TIAGo": ("tiago_description/robots/tiago.urdf", TIAGO, "arm_tool_link", "torso_lift_link"),
    "TIAGo and its torso": (  # which slides
        "tiago_description/robots/tiago.urdf",
        ["torso_lift_joint", *TIAGO],
        "hand_tool_link",
        "base_link",
    ),
    "TALOS": (
        "talos_data/robots/talos_reduced.urdf",
        ["torso_1_joint", "torso_2_joint", *(f"arm_left_{j}_joint" for j in range(1, 7))],
        "arm_left_6_link",
        None,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_an_arm_of_the_collection_moves_as_in_pinocchio(name):
    places = PEERS.glob("lib/*/site-packages/cmeel.prefix/share/example-robot-data/robots")
    if (collection := next(places, None)) is None:
        pytest.skip("example-robot-data is absent; `make test-all` installs it in .venv-peers")
    urdf, joints, tip, base = ARMS[name]
    robot = Robot(str(collection / urdf), joints, tip, base, length=0.3)
    chain = chain_of(robot)
    low, high = (np.clip(limit, -np.pi, np.pi) for limit in (chain.lower, chain.upper))
    q = np.random.default_rng(1).uniform(low, high, (200, len(joints)))
    expected, jacobian = by_pinocchio(robot, tip or "link_eef", q)
    np.testing.assert_allclose(chain.pose(q), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(chain.jacobian(q), jacobian, rtol=0, atol=1e-12)
    least = np.linalg.svd(jacobian, compute_uv=False)[:, -1]
    np.testing.assert_array_equal(chain.singular(q), least < LEAST_SINGULAR * chain.scale)
    back = np.linalg.pinv(jacobian[~chain.singular(q)])
    size = np.linalg.norm(back, axis=(-2, -1), keepdims=True)
    result = chain.inverse_jacobian(q[~chain.singular(q)])
    np.testing.assert_allclose(result / size, back / size, atol=1e-12)
    assert len(back) > 150
