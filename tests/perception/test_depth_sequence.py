"""Depth frames of a take as points in the arm's plane: a patch put at a known place is found there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ros_bags import camera_info, cloud, image, write_bag
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.errors import PipelineError, RecordingError
from pipeline.instruments.depth import write_depth
from pipeline.instruments.depth_index import write_index
from pipeline.instruments.depth_intrinsics import Intrinsics, write_intrinsics
from pipeline.perception.depth_sequence import DepthSequence, take_paths
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
        takes="kinect/test_*", index="depth.txt", intrinsics="kinect/intrinsics.yaml", width=WIDTH, height=HEIGHT, encoding="plain",
        units_per_metre=units, rate=30.0, start=0.0, camera=camera, workspace=workspace, search=0.4,
    )  # fmt: skip


@pytest.mark.parametrize("units", [1000.0, 5000.0])
def test_a_patch_of_the_arm_is_found_where_it_is(arm, tmp_path, units):
    take, depth = record(tmp_path, arm, units)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    for frame, place in enumerate(PLACES):
        points, valid = next(sequence.points([frame]))
        assert len(points) == (2 * PATCH + 1) ** 2
        # half a pixel in the middle of the patch, and the rounding of the depth
        assert np.abs(points.mean(axis=0) - place).max() < 0.5 * 1.2 / CAMERA.fx + 0.5 / units
        np.testing.assert_allclose(np.ptp(points, axis=0), 2 * PATCH * 1.15 / CAMERA.fx, rtol=0.1)
        assert valid == (2 * PATCH + 1) ** 2 / (WIDTH * HEIGHT)


def test_a_camera_that_stands_elsewhere_sees_the_arm_elsewhere(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    depth.camera.position = (np.array(depth.camera.position) + arm.rotation @ [0.03, 0.0, 0.0]).tolist()
    points, _ = next(DepthSequence(take, depth, arm, tmp_path).points([0]))
    np.testing.assert_allclose(points.mean(axis=0), PLACES[0] + [0.03, 0.0], atol=0.007)


def test_times_and_files_are_those_of_the_index(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    assert sequence.time.tolist() == [5.0, 5.033, 5.069]
    assert sequence.references == tuple(f"kinect/test_001/depth/{i}.png" for i in range(3))
    assert sequence.counts == {"cut_rows": 0}


def test_frames_are_read_when_they_are_asked_for(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    sequence = DepthSequence(take, depth, arm, tmp_path)
    (take / "depth/1.png").unlink()
    seen = sequence.points([0, 2, 1])
    assert len(next(seen)[0])
    assert len(next(seen)[0])
    with pytest.raises(RecordingError) as refused:
        next(seen)
    assert refused.value.evidence["file"] == take / "depth/1.png"


def test_an_empty_frame_has_no_points(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    write_depth(take / "depth/1.png", np.zeros((HEIGHT, WIDTH), dtype=np.uint16))
    points, valid = next(DepthSequence(take, depth, arm, tmp_path).points([1]))
    assert points.shape == (0, 2)
    assert valid == 0


def test_a_frame_of_another_size_than_the_camera_is_refused(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    write_depth(take / "depth/1.png", np.zeros((HEIGHT, WIDTH - 1), dtype=np.uint16))
    with pytest.raises(RecordingError, match="127 × 106"):
        next(DepthSequence(take, depth, arm, tmp_path).points([1]))


@pytest.mark.parametrize("missing", ["kinect/test_001/depth.txt", "kinect/intrinsics.yaml"])
def test_a_take_without_its_index_or_its_camera_is_refused(arm, tmp_path, missing):
    take, depth = record(tmp_path, arm)
    (tmp_path / missing).unlink()
    with pytest.raises(RecordingError) as refused:
        DepthSequence(take, depth, arm, tmp_path)
    assert refused.value.evidence["file"] == tmp_path / missing


CAMERA_MATRIX = [CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0]
STAMPS = (1700000005.0, 1700000005.033, 1700000005.069)


def in_camera(arm: Arm, place: np.ndarray) -> np.ndarray:
    """The patch of :func:`depth_image` as points (N, 3) in the camera's frame, without the rounding of an image."""
    depth = depth_image(arm, place, 1000.0) / 1000
    rows, columns = np.nonzero(depth)
    rays = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(len(rows))], axis=-1)
    return depth[rows, columns, None] * rays


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
def test_a_bag_of_images_gives_the_points_of_the_images(arm, tmp_path, form):
    take, depth = record(tmp_path, arm)
    expected = list(DepthSequence(take, depth, arm, tmp_path).points(range(3)))
    images = [(stamp, image(depth_image(arm, place, 1000.0), stamp)) for stamp, place in zip(STAMPS, PLACES, strict=True)]
    info = [(STAMPS[0], camera_info(CAMERA_MATRIX, [0.0] * 5, (WIDTH, HEIGHT)))]
    (tmp_path / "bags").mkdir()
    bag = write_bag(tmp_path / "bags", form, {"/depth/image": images, "/depth/camera_info": info})
    recorded = replace(depth, takes="bags/*", index=None, intrinsics=None, start=None)
    assert take_paths(tmp_path, recorded) == {"take": bag}
    sequence = DepthSequence(bag, recorded, arm, tmp_path)
    np.testing.assert_allclose(sequence.time, [0.0, 0.033, 0.069], atol=1e-6)
    assert sequence.references == tuple(f"bags/{bag.name}#{number}" for number in range(3))
    for (points, valid), (same, share) in zip(sequence.points(range(3)), expected, strict=True):
        np.testing.assert_array_equal(points, same)
        assert valid == share
    np.testing.assert_array_equal(next(sequence.points([2]))[0], expected[2][0])


@pytest.mark.parametrize("form", ["pcd", "ply", "bag"])
def test_clouds_enter_at_the_points(arm, tmp_path, form):
    _, depth = record(tmp_path, arm)
    clutter = np.random.default_rng(4).uniform([-1, -1, 0.2], [1, 1, 3], size=(40, 3))
    clouds = [np.concatenate([in_camera(arm, place), clutter, np.full((9, 3), np.nan)]) for place in PLACES]
    take = tmp_path / "clouds" / "take"
    take.mkdir(parents=True)
    if form == "bag":
        fields = [(name, 4 * i, 7, 1) for i, name in enumerate("xyz")]
        messages = [(stamp, cloud(points, stamp, fields, 16)) for stamp, points in zip(STAMPS, clouds, strict=True)]
        take = write_bag(tmp_path / "clouds", "ros1", {"/points": messages})
    for number, points in enumerate(clouds if form != "bag" else []):
        names = {"pcd": "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {0}\nHEIGHT 1\nPOINTS {0}\nDATA binary\n"}
        names["ply"] = (
            "ply\nformat binary_little_endian 1.0\nelement vertex {0}\n" + "".join(f"property float {c}\n" for c in "xyz") + "end_header\n"
        )
        (take / f"{number + 1}.{form}").write_bytes(names[form].format(len(points)).encode() + points.astype("<f4").tobytes())
    described = replace(depth, index=None, frames=f"*.{form}", intrinsics=None, width=None, height=None, units_per_metre=1.0, start=None)
    sequence = DepthSequence(take, described, arm, tmp_path)
    for points, (found, valid), place in zip(clouds, sequence.points(range(3)), PLACES, strict=True):
        assert len(found) == (2 * PATCH + 1) ** 2
        assert np.abs(found.mean(axis=0) - place).max() < 0.5 * 1.2 / CAMERA.fx + 0.5 / 1000
        assert valid == (len(points) - 9) / len(points)


def test_what_the_description_of_the_camera_leaves_open_or_contradicts_is_refused(arm, tmp_path):
    take, depth = record(tmp_path, arm)
    floats = [(stamp, image(np.ones((HEIGHT, WIDTH), np.float32), stamp)) for stamp in STAMPS]
    bag = write_bag(tmp_path, "ros1", {"/depth": floats})
    for path, changes, words in [
        (take, {"index": None}, "need.* index"),
        (take, {"intrinsics": None}, "intrinsics"),
        (take, {"width": None}, "width"),
        (bag, {"topic": "/colour"}, "/depth"),
        (bag, {"intrinsics": None}, "CameraInfo"),
    ]:
        with pytest.raises(PipelineError, match=words):
            DepthSequence(path, replace(depth, **changes), arm, tmp_path)
    with pytest.raises(PipelineError, match="metres"):
        next(DepthSequence(bag, depth, arm, tmp_path).points([0]))
    with pytest.raises(PipelineError, match="exclude"):
        replace(depth, frames="*.png")
    write_index(take / "depth.txt", np.array([1.0]), ("../../../elsewhere/1.png",))
    with pytest.raises(PipelineError, match="outside"):
        DepthSequence(take, depth, arm, tmp_path)


def test_a_bag_whose_times_do_not_increase_is_refused_at_the_message(arm, tmp_path):
    _, depth = record(tmp_path, arm)
    stamps = [5.0, 5.033, 5.033]
    pixels = np.ones((HEIGHT, WIDTH), np.uint16)
    bag = write_bag(tmp_path, "ros1", {"/depth": [(stamp + i, image(pixels, stamp)) for i, stamp in enumerate(stamps)]})
    with pytest.raises(RecordingError, match="increase") as refused:
        DepthSequence(bag, depth, arm, tmp_path)
    assert refused.value.evidence["number"] == 2


def test_two_takes_of_one_name_are_refused(arm, tmp_path):
    _, depth = record(tmp_path, arm)
    write_bag(tmp_path / "kinect", "ros1", {"/depth": [(5.0, image(np.ones((2, 2), np.uint16), 5.0))]}).rename(
        tmp_path / "kinect/test_001.bag"
    )
    with pytest.raises(RecordingError, match="twice"):
        take_paths(tmp_path, depth)
    with pytest.raises(RecordingError, match="no bag matches"):
        take_paths(tmp_path, replace(depth, takes="elsewhere/*"))
