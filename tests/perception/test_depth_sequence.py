"""Depth frames of a take as points in the arm's plane: a patch put at a known place is found there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.errors import RecordingError
from pipeline.instruments.depth import Intrinsics, write_depth, write_index, write_intrinsics
from pipeline.perception.depth_sequence import DepthSequence
from pipeline.schema import Depth, Pose, Workspace

WIDTH, HEIGHT = 128, 106
CAMERA = Intrinsics(91.4, 91.0, 63.7, 51.3, WIDTH, HEIGHT)
PLACES = np.array([[0.05, 0.25], [-0.12, 0.32], [0.2, 0.2]])  # m, x and z in the plane of a patch of the arm, one a frame
RPY = (-1.62, 0.03, 0.4)
PATCH = 4  # px on either side


@pytest.fixture(scope="module")
def arm() -> Arm:
    links = np.array([[0.0, 0.155], [0.0, 0.135], [0.0, 0.17]])
    chain = PlanarChain(np.array([0.02, 0.1]), links, np.ones(3), np.full(3, -3.0), np.full(3, 3.0), np.ones(3))
    return Arm(chain, Rotation.from_euler("z", 0.4).as_matrix(), np.array([0.03, -0.02, 0.0]))


def camera_position(arm: Arm) -> np.ndarray:
    return arm.to_base(np.array([0.05, -1.1, 0.25]))


def depth_image(arm: Arm, place: np.ndarray, units: float) -> np.ndarray:
    """A patch of the arm's plane about ``place``, seen by the camera; no depth anywhere else."""
    rotation = Rotation.from_euler("xyz", RPY).as_matrix()
    seen = (arm.to_base(np.array([place[0], 0.0, place[1]])) - camera_position(arm)) @ rotation
    assert seen[2] > 0.5
    u, v = round(CAMERA.fx * seen[0] / seen[2] + CAMERA.cx), round(CAMERA.fy * seen[1] / seen[2] + CAMERA.cy)
    rows, columns = np.mgrid[v - PATCH : v + PATCH + 1, u - PATCH : u + PATCH + 1]
    rays = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(rows.shape)], axis=-1)
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
    workspace = Workspace(half_depth=0.05, girth=0.05, column_half_width=0.06, column_top=-0.02, floor=0.0, min_pixels=10, max_points=500)
    camera = Pose(position=camera_position(arm).tolist(), rpy=list(RPY))
    return take, Depth(
        takes="kinect/test_*", index="depth.txt", intrinsics="kinect/intrinsics.yaml", width=WIDTH, height=HEIGHT, units_per_metre=units,
        rate=30.0, camera=camera, workspace=workspace, search=0.4,
    )  # fmt: skip


@pytest.mark.parametrize("units", [1000.0, 5000.0])
def test_a_patch_of_the_arm_is_found_where_it_is(arm, tmp_path, units):
    take, depth = record(tmp_path, arm, units)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    for frame, place in enumerate(PLACES):
        points, valid = sequence.points(frame)
        assert len(points) == (2 * PATCH + 1) ** 2
        # half a pixel in the middle of the patch, and the rounding of the depth
        assert np.abs(points.mean(axis=0) - place).max() < 0.5 * 1.2 / CAMERA.fx + 0.5 / units
        np.testing.assert_allclose(np.ptp(points, axis=0), 2 * PATCH * 1.15 / CAMERA.fx, rtol=0.1)
        assert valid == (2 * PATCH + 1) ** 2 / (WIDTH * HEIGHT)


def test_a_camera_that_stands_elsewhere_sees_the_arm_elsewhere(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    depth.camera.position = (np.array(depth.camera.position) + arm.rotation @ [0.03, 0.0, 0.0]).tolist()
    points, _ = DepthSequence(take, depth, arm, tmp_path).points(0)
    np.testing.assert_allclose(points.mean(axis=0), PLACES[0] + [0.03, 0.0], atol=0.007)


def test_times_and_files_are_those_of_the_index(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    assert sequence.time.tolist() == [5.0, 5.033, 5.069]
    assert sequence.files == [take / f"depth/{i}.png" for i in range(3)]
    assert sequence.counts == {"cut_rows": 0}


def test_frames_are_read_when_they_are_asked_for(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    (take / "depth/1.png").unlink()
    assert len(sequence.points(0)[0])
    assert len(sequence.points(2)[0])
    with pytest.raises(RecordingError) as refused:
        sequence.points(1)
    assert refused.value.evidence["file"] == take / "depth/1.png"


def test_an_empty_frame_has_no_points(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    write_depth(take / "depth/1.png", np.zeros((HEIGHT, WIDTH), dtype=np.uint16))
    points, valid = DepthSequence(take, depth, arm, tmp_path).points(1)
    assert points.shape == (0, 2)
    assert valid == 0


def test_a_frame_of_another_size_than_the_camera_is_refused(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    write_depth(take / "depth/1.png", np.zeros((HEIGHT, WIDTH - 1), dtype=np.uint16))
    with pytest.raises(RecordingError, match="127 × 106"):
        DepthSequence(take, depth, arm, tmp_path).points(1)


@pytest.mark.parametrize("missing", ["kinect/test_001/depth.txt", "kinect/intrinsics.yaml"])
def test_a_take_without_its_index_or_its_camera_is_refused(arm, tmp_path, missing):
    take, depth = record(tmp_path, arm)
    (tmp_path / missing).unlink()
    with pytest.raises(RecordingError) as refused:
        DepthSequence(take, depth, arm, tmp_path)
    assert refused.value.evidence["file"] == tmp_path / missing
