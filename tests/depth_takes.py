"""Takes of a depth camera that sees a patch of the arm at known places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.core.options.instruments import Depth, Pose, Workspace
from pipeline.formats.depth.image import write_depth
from pipeline.formats.depth.index import write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics

LINKS, LIMIT = np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]]), np.full(3, 3.0)
CHAIN = PlanarChain(np.array([0.02, 0.1]), LINKS, np.ones(3), -LIMIT, LIMIT, np.ones(3))
ARM = Arm(CHAIN, Rotation.from_euler("z", 0.4).as_matrix(), np.array([0.03, -0.02, 0.0]))
WIDTH, HEIGHT = 128, 106
CAMERA = Intrinsics(91.4, 91.0, 63.7, 51.3, WIDTH, HEIGHT)


# m, x and z in the plane of a patch of the arm, one a frame
PLACES = np.array([[0.05, 0.25], [-0.12, 0.32], [0.2, 0.2]])
RPY = (-1.62, 0.03, 0.4)
PATCH = 4  # px on either side


def camera_position(arm: Arm) -> np.ndarray:
    return arm.to_base(np.array([0.05, -1.1, 0.25]))


def depth_image(arm: Arm, place: np.ndarray, units: float) -> np.ndarray:
    """A patch of the arm's plane about ``place``, seen by the camera; no depth anywhere else."""
    rotation = Rotation.from_euler("xyz", RPY).as_matrix()
    observed = (arm.to_base(np.array([place[0], 0.0, place[1]])) - camera_position(arm)) @ rotation
    assert observed[2] > 0.5
    x, y = observed[:2] / observed[2]
    u, v = round(CAMERA.fx * x + CAMERA.cx), round(CAMERA.fy * y + CAMERA.cy)
    rows, columns = np.mgrid[v - PATCH : v + PATCH + 1, u - PATCH : u + PATCH + 1]
    x, y = (columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy
    rays = np.stack([x, y, np.ones(rows.shape)], axis=-1)
    normal = arm.rotation[:, 1] @ rotation
    distance = (arm.to_base(np.zeros(3)) - camera_position(arm)) @ arm.rotation[:, 1]
    image = np.zeros((HEIGHT, WIDTH), dtype=np.uint16)
    image[rows, columns] = np.rint(units * distance / (rays @ normal))
    return image


def record(folder: Path, arm: Arm, units: float = 1000.0) -> tuple[Path, Depth]:
    """Recordings of one take of three frames, and their description."""
    take = folder / "kinect" / "test_001"
    (take / "depth").mkdir(parents=True)
    files = tuple(f"depth/{i}.png" for i in range(len(PLACES)))
    for file, place in zip(files, PLACES, strict=True):
        write_depth(take / file, depth_image(arm, place, units))
    write_index(take / "depth.txt", np.array([5.0, 5.033, 5.069]), files)
    write_intrinsics(folder / "kinect" / "intrinsics.yaml", CAMERA)
    camera = Pose(position=camera_position(arm).tolist(), rpy=list(RPY))
    return take, Depth(
        takes="kinect/test_*",
        index="depth.txt",
        intrinsics="kinect/intrinsics.yaml",
        **{"width": WIDTH, "height": HEIGHT, "encoding": "plain", "units_per_metre": units},
        **{"rate": 30.0, "start": 0.0, "camera": camera, "search": 0.4},
        workspace=Workspace(0.05, 0.05, 0.06, -0.02, 0.0, min_pixels=10, max_points=500),
    )
