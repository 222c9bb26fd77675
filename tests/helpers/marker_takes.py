"""Takes of motion capture of an arm whose joint angles are known."""

from pathlib import Path

import numpy as np
from motive_files import START
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import segment_frames
from pipeline.core.options.dataset import Dataset, Mocap, Motion, Pose, Robot
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.motion.take import MotionTake, RigidBody
from pipeline.perception.markers import JointTrack, track
from pipeline.perception.posture import points_in_plane

STEPS = 40


# (links, markers, 3) m, in the frames of the links
PLACES = np.array([
    [[0.032, -0.048, 0.018], [-0.030, -0.052, 0.071], [0.024, -0.045, 0.139]],
    [[-0.033, -0.046, 0.022], [0.029, -0.055, 0.058], [-0.021, -0.042, 0.121]],
    [[0.030, -0.043, 0.012], [-0.031, -0.050, 0.041], [0.012, -0.038, 0.104]],
])  # fmt: skip
TEMPLATE = {
    f"link{j}": {f"{name}{j}": at for name, at in zip("abc", link, strict=True)}
    for j, link in enumerate(PLACES.tolist(), 1)
}
BASE = Pose([0.4, 0.3, -0.2], [-np.pi / 2, 0.0, 0.0])
MOUNT = Pose([0.01, -0.05, 0.06], [0.3, -0.2, 1.1])
STATED = {"training": "*.csv", "base": BASE, "markers": TEMPLATE, "gate": 0.012, "max_gap": 20}


def dataset(**mocap) -> Dataset:
    robot = Robot("arm.urdf", ["a", "b", "c"], plane=True)
    return Dataset("t", ".", robot, Motion(100.0, STEPS), mocap=Mocap(**STATED | mocap))


def marker_places(q: np.ndarray, template: np.ndarray, chain) -> np.ndarray:
    """(..., n, K, 3) m in the plane's frame, where the arm at ``q`` (..., n) carries the points at
    ``template`` (n, K, 3) of its segments.
    """
    rotation, origin = segment_frames(chain, q)
    return origin[..., None, :] + template @ np.swapaxes(rotation, -1, -2)


def to_world(arm, plane: np.ndarray) -> np.ndarray:
    turn = Rotation.from_euler("xyz", BASE.rpy).as_matrix()
    return arm.to_base(plane) @ turn.T + np.array(BASE.position)


def markers_of(arm, q: np.ndarray) -> dict[str, np.ndarray]:
    places = to_world(arm, marker_places(q, PLACES, arm.chain)).reshape(len(q), 9, 3)
    names = (name for link in TEMPLATE.values() for name in link)
    return {name: places[:, i] for i, name in enumerate(names)}


def bodies_of(arm, q: np.ndarray) -> dict[str, RigidBody]:
    """Bodies B1 to B3, each mounted to its link by MOUNT, in poses made of four points of the
    segment that MOUNT's axes lead to.
    """
    axes = np.array(MOUNT.position) + np.vstack(
        [np.zeros(3), Rotation.from_euler("xyz", MOUNT.rpy).as_matrix().T]
    )
    bodies = {}
    for link in range(3):
        ends = [np.repeat(axes[i : i + 1], 3, axis=0) for i in range(4)]
        origin, *tips = (
            to_world(arm, marker_places(q, np.repeat(end[None], 3, axis=0), arm.chain))[:, link, 0]
            for end in ends
        )
        turn = np.stack([tip - origin for tip in tips], axis=-1)
        bodies[f"B{link + 1}"] = RigidBody(origin, Rotation.from_matrix(turn).as_quat())
    return bodies


def written(folder: Path, markers: dict, bodies: dict | None = None, **stated) -> Path:
    """Motive's file t.csv of a take: of its ``rate`` in Hz, from the frame ``first`` on."""
    first, rate = stated.get("first", 0), stated.get("rate", 100.0)
    frame = first + np.arange(STEPS + 1)
    take = MotionTake("t", "1.23", rate, frame, (frame - first) / rate, markers, bodies or {}, {})
    write_motive(folder / "t.csv", take, start=START)
    return folder / "t.csv"


def tracked(rows, arm) -> JointTrack:
    labelled = rows[rows.link > 0].sort_values(["link", "marker", "k"], kind="stable")
    xyz = labelled[["x", "y", "z"]].to_numpy().reshape(9, STEPS + 1, 3).transpose(1, 0, 2)
    return track(xyz, points_in_plane(arm, PLACES, 0.012), max_gap=20)
