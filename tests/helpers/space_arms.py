"""Arms in space, and where they carry points, by Pinocchio."""

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import pipeline.arm
from pipeline.arm.chain import SerialChain
from pipeline.core.columns import SPACE
from pipeline.core.options.dataset import Mocap, Pose, Robot

HERE = Path(pipeline.arm.__file__).parent
UR5 = Robot(str(HERE / "ur5.urdf"), [f"joint_{i}" for i in range(1, 7)], "flange")
LWR4 = Robot(str(HERE / "lwr4.urdf"), [f"joint_{i}" for i in range(1, 8)], "flange")
YOUBOT = Robot(
    str(HERE / "youbot.urdf"),
    [f"arm_joint_{j}" for j in (2, 3, 4)],
    "arm_tool",
    locked={"arm_joint_1": 2.9670597283903604, "arm_joint_5": 2.923426497090502},
    plane=True,
)
# on links near both ends and in between, so that they leave one posture alone
MARKERS = {
    "upper_arm": {
        "a": [0.0, 0.05, 0.06],
        "b": [-0.2, 0.06, 0.05],
        "c": [-0.1, -0.05, 0.06],
    },
    "forearm": {
        "d": [0.0, 0.05, 0.05],
        "e": [-0.2, 0.06, 0.05],
        "f": [-0.1, -0.05, 0.06],
    },
    "flange": {
        "g": [0.0, 0.07, 0.01],
        "h": [0.06, 0.0, 0.02],
        "i": [-0.06, -0.04, 0.0],
    },
}
START = np.array([0.3, -1.2, 1.4, -0.8, 1.0, 0.4])
END = np.array([1.1, -1.7, 2.0, -0.4, 0.3, 1.4])


def revolute_arm(n: int) -> SerialChain:
    """An arm of ``n`` joints placed and pointing anywhere, whose task is the whole pose."""
    rng = np.random.default_rng(n)
    quaternions = rng.normal(size=(n + 1, 4))
    turns = Rotation.from_quat(quaternions).as_matrix()
    positions = rng.uniform(-0.15, 0.15, (n + 1, 3))
    limit = np.full(n, 3.0)
    return SerialChain(
        tuple(SPACE),
        0.3,
        placements=np.hstack([turns.reshape(n + 1, 9), positions]),
        sliding=np.zeros(n, dtype=bool),
        lower=-limit,
        upper=limit,
        max_speed=limit,
    )


def mocap(markers: dict = MARKERS, **options) -> Mocap:
    base = Pose([0.0] * 3, [0.0] * 3)
    defaults = {"training": "*.csv", "base": base, "gate": 0.005, "max_gap": 20}
    return Mocap(**defaults | {"markers": markers} | options)


def motion(frames: int) -> np.ndarray:
    """(frames, 6) rad, of the UR5."""
    return START + np.linspace(0, 1, frames)[:, None] * (END - START)


_model = cache(pin.buildModelFromUrdf)


def link_poses(robot: Robot, link: str, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (N, 3, 3) and positions (N, 3) of the frame of ``link``."""
    model = _model(robot.urdf)
    data = model.createData()
    frame = model.getFrameId(link, pin.FrameType.BODY)

    poses = []
    for row in q:
        pin.framesForwardKinematics(model, data, row)
        poses.append(data.oMf[frame].homogeneous)
    poses = np.array(poses)
    return poses[:, :3, :3], poses[:, :3, 3]


def points(robot: Robot, markers: dict, q: np.ndarray) -> np.ndarray:
    """(N, P, 3) m, where the arm carries the ``markers`` in the frame of its base."""
    places = []
    for link, places_by_marker in markers.items():
        rotation, position = link_poses(robot, link, q)
        local = np.array(list(places_by_marker.values()))
        turned = np.einsum("nab,mb->nma", rotation, local)
        places.append(position[:, None] + turned)
    return np.concatenate(places, axis=1)
