"""Depth takes, of images, bags or clouds, as points in the arm's plane on the motion's clock."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from planar_poses import load_arm, planar_chain
from ros_bags import camera_info, cloud, image, write_bag
from sample_options import made
from scipy.spatial.transform import Rotation

from pipeline.arm.model import Arm
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.core.options.dataset import Depth, Pose, Workspace
from pipeline.formats.depth.image import write_depth, write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.recordings.depth import depth_paths, frame_rows
from pipeline.recordings.depth_takes import (
    CameraTake,
    arm_points,
    on_motion_clock,
    with_markers,
)

ROTATION = Rotation.from_euler("z", 0.4).as_matrix()
ARM = Arm(planar_chain(0.02, 0.1), ROTATION, np.array([0.03, -0.02, 0.0]))
WIDTH = 128
HEIGHT = 106
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
    position = camera_position(arm)
    in_base = arm.to_base(np.array([place[0], 0.0, place[1]]))
    x, y, depth = (in_base - position) @ rotation
    assert depth > 0.5
    u = round(CAMERA.fx * x / depth + CAMERA.cx)
    v = round(CAMERA.fy * y / depth + CAMERA.cy)

    around = np.arange(-PATCH, PATCH + 1)
    rows, columns = np.meshgrid(v + around, u + around, indexing="ij")
    rays = rays_of(rows, columns)
    normal = arm.rotation[:, 1]
    distance = (arm.to_base(np.zeros(3)) - position) @ normal
    depths = distance / (rays @ (normal @ rotation))
    image = np.zeros((HEIGHT, WIDTH), dtype=np.uint16)
    image[rows, columns] = np.rint(units * depths)
    return image


def rays_of(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(..., 3) points in the camera's frame at the depth 1 m that it sees in these pixels."""
    x = (columns - CAMERA.cx) / CAMERA.fx
    y = (rows - CAMERA.cy) / CAMERA.fy
    return np.stack([x, y, np.ones(rows.shape)], axis=-1)


def record(folder: Path, arm: Arm, units: float = 1000.0) -> tuple[Path, Depth]:
    """Recordings of one take of three frames, and their description."""
    take = folder / "kinect" / "test_001"
    (take / "depth").mkdir(parents=True)
    files = tuple(f"depth/{i}.png" for i in range(len(PLACES)))
    for file, place in zip(files, PLACES, strict=True):
        write_depth(take / file, depth_image(arm, place, units))
    write_index(take / "depth.txt", np.array([5.0, 5.033, 5.069]), files)
    write_intrinsics(folder / "kinect" / "intrinsics.yaml", CAMERA)
    described = made(
        Depth,
        takes="kinect/test_*",
        index="depth.txt",
        intrinsics="kinect/intrinsics.yaml",
        width=WIDTH,
        height=HEIGHT,
        units_per_metre=units,
        start=0.0,
        camera=Pose(camera_position(arm).tolist(), list(RPY)),
        search=0.4,
        workspace=Workspace(
            0.05,
            0.05,
            0.06,
            -0.02,
            0.0,
            min_pixels=10,
            max_points=500,
        ),
    )
    return take, described


CAMERA_MATRIX = [CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0]
STAMPS = (1700000005.0, 1700000005.033, 1700000005.069)
PIXELS = (2 * PATCH + 1) ** 2
HALF_A_PIXEL = 0.5 * 1.2 / CAMERA.fx  # m, at the depth of the patch
ONES = np.ones((HEIGHT, WIDTH), np.uint16)


def off(points: np.ndarray, place: np.ndarray) -> float:
    return float(np.abs(points.mean(axis=0) - place).max())


def read(path: Path, depth: Depth, folder: Path):
    """Rows of the table, the points of each, and the quality of the take in ``path``."""
    rows, quality = frame_rows(("take", path), depth, ARM, folder, folder)
    counts = {row["quantity"]: row["value"] for row in quality}
    return rows, arm_points(rows, folder), counts


@pytest.mark.parametrize("units", [1000.0, 5000.0])
def test_a_patch_of_the_arm_is_found_where_it_is(tmp_path, units):
    take, depth = record(tmp_path, ARM, units)

    rows, clouds, counted = read(take, depth, tmp_path)

    assert rows["t"].tolist() == [5.0, 5.033, 5.069] and counted["cut_rows"] == 0
    assert rows["file"].tolist() == [f"kinect/test_001/depth/{i}.png" for i in range(3)]
    assert set(rows["valid"]) == {PIXELS / (WIDTH * HEIGHT)}
    size = 2 * PATCH * 1.15 / CAMERA.fx
    for points, place in zip(clouds, PLACES, strict=True):
        assert len(points) == PIXELS
        # half a pixel in the middle of the patch, and the rounding of the depth
        assert off(points, place) < HALF_A_PIXEL + 0.5 / units
        assert_allclose(np.ptp(points, axis=0), size, rtol=0.1)


def test_frozen_frames_are_left_out_and_empty_ones_stay(tmp_path):
    take, depth = record(tmp_path, ARM)
    _, (first, *_), _ = read(take, depth, tmp_path)
    images = take / "depth"
    shutil.copy(images / "0.png", images / "1.png")
    write_depth(images / "2.png", 0 * ONES)

    # frames are dropped by the times of the index, whatever rate is stated
    rows, points, counted = read(take, replace(depth, rate=15.0), tmp_path)

    assert rows["frame"].tolist() == [0, 2]
    assert rows["points"].tolist() == [PIXELS, 0]
    assert counted["frozen_frames"] == 1 and counted["dropped_frames"] == 0
    assert_array_equal(points[0], first)


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
def test_a_bag_of_images_gives_the_points_of_the_images(tmp_path, form):
    take, depth = record(tmp_path, ARM)
    expected, points, _ = read(take, depth, tmp_path)
    images = []
    for stamp, place in zip(STAMPS, PLACES, strict=True):
        images.append((stamp, image(depth_image(ARM, place, 1000.0), stamp)))
    info = camera_info(CAMERA_MATRIX, [0.0] * 5, (WIDTH, HEIGHT))
    topics = {"/depth/image": images, "/depth/camera_info": [(STAMPS[0], info)]}
    (tmp_path / "bags").mkdir()
    bag = write_bag(tmp_path / "bags", form, topics)
    recorded = replace(depth, takes="bags/*", index=None, intrinsics=None, start=None)

    rows, of_bag, _ = read(bag, recorded, tmp_path)

    assert depth_paths(tmp_path, recorded) == {"take": bag}
    assert_allclose(rows["t"], [0.0, 0.033, 0.069], atol=1e-6)
    assert rows["file"].tolist() == [f"bags/{bag.name}#{number}" for number in range(3)]
    assert_array_equal(np.concatenate(of_bag), np.concatenate(points))
    assert rows["valid"].tolist() == expected["valid"].tolist()


def recorded_cloud(place: np.ndarray) -> np.ndarray:
    """The patch of :func:`depth_image` as points (N, 3) in the camera's frame, with clutter and
    points without a measurement.
    """
    depth = depth_image(ARM, place, 1000.0) / 1000
    rows, columns = np.nonzero(depth)
    patch = depth[rows, columns, None] * rays_of(rows, columns)

    near = [-1, -1, 0.2]
    far = [1, 1, 3]
    clutter = np.random.default_rng(4).uniform(near, far, size=(40, 3))
    unmeasured = np.full((UNMEASURED, 3), np.nan)
    return np.concatenate([patch, clutter, unmeasured])


UNMEASURED = 9
CLOUDS = [recorded_cloud(place) for place in PLACES]
PCD = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {0}\nHEIGHT 1\nPOINTS {0}\n"


def write_pcds(folder: Path) -> Path:
    """Write a PCD file for each of the CLOUDS; return their folder."""
    take = folder / "take"
    take.mkdir(parents=True)
    for number, points in enumerate(CLOUDS):
        head = f"{PCD.format(len(points))}DATA binary\n".encode()
        (take / f"{number}.pcd").write_bytes(head + points.astype("<f4").tobytes())
    return take


def write_cloud_bag(folder: Path) -> Path:
    """Write a bag of the CLOUDS; return its path."""
    folder.mkdir()
    fields = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]
    messages = []
    for stamp, points in zip(STAMPS, CLOUDS, strict=True):
        messages.append((stamp, cloud(points, stamp, fields, 16)))
    return write_bag(folder, "ros1", {"/points": messages})


@pytest.mark.parametrize("write", [write_pcds, write_cloud_bag])
def test_clouds_enter_at_the_points(tmp_path, write):
    _, depth = record(tmp_path, ARM)
    take = write(tmp_path / "clouds")
    absent = dict.fromkeys(("index", "intrinsics", "width", "height", "start"))
    described = replace(depth, **absent, frames="*.pcd", units_per_metre=1.0)

    rows, on_arm, _ = read(take, described, tmp_path)

    for points, place in zip(on_arm, PLACES, strict=True):
        assert len(points) == PIXELS
        assert off(points, place) < HALF_A_PIXEL + 0.5e-3
    measured = [1 - UNMEASURED / len(points) for points in CLOUDS]
    assert rows["valid"].tolist() == pytest.approx(measured)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"index": None}, "need.* index"),
        ({"intrinsics": None}, "intrinsics"),
        ({"width": None}, "width"),
        ({"index": "none.txt"}, "none.txt"),
    ],
)
def test_what_the_description_of_the_images_leaves_open_is_refused(
    tmp_path,
    changes,
    words,
):
    take, depth = record(tmp_path, ARM)
    with pytest.raises(PipelineError, match=words):
        read(take, replace(depth, **changes), tmp_path)
    with pytest.raises(PipelineError, match="not both"):
        replace(depth, frames="*.png")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"topic": "/colour"}, "/depth"),
        ({"intrinsics": None}, "CameraInfo"),
        ({}, "metres"),
    ],
)
def test_a_bag_that_contradicts_the_description_is_refused(tmp_path, changes, words):
    _, depth = record(tmp_path, ARM)
    metres = ONES.astype(np.float32)
    messages = [(stamp, image(metres, stamp)) for stamp in STAMPS]
    bag = write_bag(tmp_path, "ros1", {"/depth": messages})

    with pytest.raises(PipelineError, match=words):
        read(bag, replace(depth, **changes), tmp_path)


# s
TIME = np.arange(40) / 30.0
MOTION = np.arange(160) / 100.0


PLANAR = load_arm(
    "pipeline/arm/ur5.urdf",
    ["joint_2", "joint_3", "joint_4"],
    "wrist_centre",
    {},
)


def path(time: np.ndarray) -> np.ndarray:
    """The middle of the arm: a smooth path in its plane."""
    return np.column_stack([np.sin(2 * time), np.cos(3 * time)])


def frames(centroid: np.ndarray, take: str = "test_001") -> pd.DataFrame:
    """Rows of the table ``frames`` of a camera that sees the arm at ``centroid``."""
    columns = {"take": take, "part": "test", "frame": np.arange(len(TIME)), "t": TIME}
    x, z = centroid.T
    return pd.DataFrame(
        columns | {"file": f"kinect/{take}", "points": 5, "x": x, "z": z},
    )


# rows of the table ``markers``: one marker, that runs along the path in the arm's plane
AT = PLANAR.to_base(np.insert(path(MOTION), 1, 0.0, axis=1)).T
MARKERS = pd.DataFrame(
    {"take": "test_001", "part": "test", "k": np.arange(160), "t": MOTION},
)
MARKERS = MARKERS.assign(link=1, marker=1, x=AT[0], y=AT[1], z=AT[2])


def test_an_offset_is_that_of_the_motion_unless_it_is_stated():
    filmed = frames(path(TIME + 0.12))
    rows, (offset, *_) = on_clock(filmed)

    assert offset["quantity"] == "clock_offset"
    assert abs(offset["value"] - 0.12) < 1e-4
    assert_allclose(rows["t"], TIME + offset["value"])
    for seen in (filmed, STILL):  # whatever the motion says
        rows, (offset,) = on_clock(seen, clock_offset=-0.25)
        assert_allclose(rows["t"], TIME - 0.25)
        assert (offset["quantity"], offset["value"]) == ("clock_offset", -0.25)


STILL = frames(np.ones((len(TIME), 2)))
EMPTY = frames(np.full((len(TIME), 2), np.nan)).assign(points=0)


def on_clock(seen: pd.DataFrame, **options: float) -> tuple[pd.DataFrame, list[dict]]:
    """Rows of frames on the clock of the MARKERS, and their quality."""
    described = made(Depth, search=0.3, **options)
    return on_motion_clock(CameraTake(seen, MARKERS, []), described, PLANAR)


def test_takes_that_tell_no_offset_are_refused_by_their_name():
    for seen, words in ((STILL, "no motion to compare"), (EMPTY, "no frame shows")):
        with pytest.raises(RecordingError, match=words) as refused:
            on_clock(seen)
        assert refused.value.evidence["take"] == "test_001"
    with pytest.raises(RecordingError, match="no motion-capture take") as refused:
        with_markers(frames(path(TIME), "test_002"), MARKERS, MARKERS)
    assert refused.value.evidence["take"] == "test_002"
