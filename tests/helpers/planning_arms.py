"""Arms to plan for, a path for each, and models to plan under."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from space_arms import LWR4

import pipeline.arm
from pipeline.arm.chain import Chain
from pipeline.arm.model import chain_of
from pipeline.core.options.dataset import Robot
from pipeline.models.kinds import build_model
from pipeline.planning.problem import Cost, Problem, uncertainty

PLANAR = Robot(
    str(Path(pipeline.arm.__file__).parent / "youbot.urdf"),
    ["arm_joint_2", "arm_joint_3", "arm_joint_4"],
    "arm_tool",
    locked={"arm_joint_1": 2.967, "arm_joint_5": 2.923},
    plane=True,
)
# a robot and two poses between which it moves, rad
ARMS = {
    "planar": (replace(PLANAR, task=["x", "z"]), [1.47, -4.0, 2.0], [2.26, -3.2, 2.79]),
    "square": (PLANAR, [1.47, -4.0, 2.0], [2.0, -3.4, 2.3]),
    "seven": (
        LWR4,
        [0.3, 0.95, -0.3, -1.6, 0.4, 1.05, 0.2],
        [0.0, 0.65, 0.0, -1.2, 0, 0.75, 0.5],
    ),
}
ARMS["two spare"] = (
    replace(LWR4, task=["x", "y", "z", "rx", "ry"]),
    *ARMS["seven"][1:],
)
LAWS = {
    "additive": {"kind": "additive", "noise_covariance": (1e-6 * np.eye(3)).tolist()},
    "gaussian": {"kind": "gaussian", "alpha": 0.1, "u": 60.0},
    "qr_transposed": {
        "kind": "wishart",
        "sigma_b": 0.25,
        "decomposition": "qr_transposed",
    },
    "pivoted_lu": {"kind": "wishart", "sigma_b": 0.25, "decomposition": "pivoted_lu"},
}


def chain(arm: str) -> Chain:
    return chain_of(ARMS[arm][0])


def joint_path(arm: str, steps: int) -> np.ndarray:
    """(steps + 1, n) rad, straight in the joints, from rest to rest."""
    _, start, end = ARMS[arm]
    share = (1 - np.cos(np.linspace(0, np.pi, steps + 1))) / 2
    return np.array(start) + share[:, None] * (np.array(end) - np.array(start))


def law_cost(law: str, arm: Chain, objective: str = "trace") -> Cost:
    return uncertainty(build_model(LAWS[law]), arm, objective)


def path_problem(arm: str, steps: int, **changes: float) -> Problem:
    """The path of an arm, done in two seconds, and what its motion has to keep."""
    moved = chain(arm)
    numbers = {"rate": steps / 2, "margin": 0.01, "smoothness": 1e-3} | changes
    return Problem(moved, moved.pose(joint_path(arm, steps)), **numbers)
