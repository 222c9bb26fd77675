"""The task path that a user gives: poses of the tip, or joint angles that it is told by."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.arm.interface import Chain
from pipeline.core.columns import members, values
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import PLANE, Robot
from pipeline.formats.format import Head
from pipeline.formats.trajectory import FORMAT, read_poses, read_trajectory


def read_path(file: Path, chain: Chain, robot: Robot) -> tuple[np.ndarray, float]:
    """(M+1, p) the poses in ``file``, as ``chain`` has them, and their rate in 1/s.

    A commanded trajectory of the joints stands for the poses that it leads through. Else the
    columns are t and the rows of the task: in space positions and the rotation vector of the tip in
    the axes of the base, in a plane φ as the arm counts it, zero where every joint is. Raises
    RecordingError as the formats do, and for joints that are not the arm's.
    """
    try:
        head = Head.read(file)
    except OSError as error:
        message = f"the file cannot be read ({error.strerror})"
        raise RecordingError(message, file=file) from None
    if FORMAT.recognises(head):
        table = read_trajectory(file)
        if joints := members(table, "q"):
            if sorted(joints) != sorted(robot.joints):
                named, own = (", ".join(names) for names in (joints, robot.joints))
                message = f"the joints are {named}; those of the arm {own}"
                raise RecordingError(message, file=file, line=1)
            order = [joints.index(name) for name in robot.joints]
            return chain.pose(values(table, "q")[:, order]), _rate(table["t"].to_numpy())
    table = read_poses(file, chain.task)
    rows = {name: table[name].to_numpy() for name in chain.task}
    still = chain.pose(np.zeros(len(chain.lower)))
    if len(still) == len(chain.task):
        return np.stack([*rows.values()], axis=-1), _rate(table["t"].to_numpy())
    poses = np.tile(still, (len(table), 1))
    for axis, name in enumerate("xyz"):
        poses[:, axis] = rows.get(name, 0.0)
    turn = np.zeros((len(table), 3))
    for name, turned in rows.items():
        if name == PLANE[2]:
            turn[:, 1] = turned
        elif name.startswith("r"):
            turn[:, "xyz".index(name[1])] = turned
    rotation = Rotation.from_rotvec(turn).as_matrix()
    if PLANE[2] in rows:
        rotation = rotation @ still[3:].reshape(3, 3)
    poses[:, 3:] = rotation.reshape(-1, 9)
    return poses, _rate(table["t"].to_numpy())


def _rate(t: np.ndarray) -> float:
    return float((len(t) - 1) / (t[-1] - t[0]))
