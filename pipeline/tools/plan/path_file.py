"""Task path of a user: poses of the tip, or joint angles that lead through them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.arm.interface import Chain
from pipeline.core.columns import members, values
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import PLANE, Robot
from pipeline.formats.format import format_of
from pipeline.formats.trajectory import FORMAT, read_poses, read_trajectory


def read_path(file: Path, chain: Chain, robot: Robot) -> tuple[np.ndarray, float]:
    """Return (M+1, p) the poses in ``file``, as ``chain`` has them, and their rate in 1/s.

    A commanded trajectory of the joints gives its poses. Else the columns are t and the rows of the
    task: in space positions and the rotation vector of the tip in the axes of the base, in a plane
    φ as the arm counts it, zero where every joint is. Raises RecordingError as the formats do, and
    for joints that are not the arm's.
    """
    if format_of(file, [FORMAT]) and (joints := members(table := read_trajectory(file), "q")):
        if sorted(joints) != sorted(robot.joints):
            named, own = (", ".join(names) for names in (joints, robot.joints))
            message = f"the joints are {named}; those of the arm {own}"
            raise RecordingError(message, file=file, line=1)
        order = [joints.index(name) for name in robot.joints]
        return chain.pose(values(table, "q")[:, order]), _rate(table["t"].to_numpy())
    table = read_poses(file, chain.task)
    rate, still = _rate(table["t"].to_numpy()), chain.pose(np.zeros(len(chain.lower)))
    if len(still) == len(chain.task):
        return table[[*chain.task]].to_numpy(), rate
    poses, turn = np.tile(still, (len(table), 1)), np.zeros((len(table), 3))
    poses[:, :3] = [0.0, 0.0, 0.0]
    for name in chain.task:
        if name in ("x", "y", "z"):
            poses[:, "xyz".index(name)] = table[name]
        else:
            turn[:, 1 if name == PLANE[2] else "xyz".index(name[1])] = table[name]
    rotation = Rotation.from_rotvec(turn).as_matrix()
    if PLANE[2] in chain.task:
        rotation = rotation @ still[3:].reshape(3, 3)
    poses[:, 3:] = rotation.reshape(-1, 9)
    return poses, rate


def _rate(t: np.ndarray) -> float:
    return float((len(t) - 1) / (t[-1] - t[0]))
