"""Depth takes as bags and as clouds: they give the points that images give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from depth_takes import ARM, CAMERA, HEIGHT, PATCH, PLACES, WIDTH, depth_image, record
from ros_bags import camera_info, cloud, image, write_bag

from pipeline.arm.model import Arm
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.formats.depth.index import write_index
from pipeline.recordings.depth_sequence import DepthSequence, take_paths

CAMERA_MATRIX = [CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0]


STAMPS = (1700000005.0, 1700000005.033, 1700000005.069)


@pytest.fixture
def arm() -> Arm:
    return ARM


def in_camera(arm: Arm, place: np.ndarray) -> np.ndarray:
    """The patch of :func:`depth_image` as points (N, 3) in the camera's frame, without the rounding
    of an image.
    """
    depth = depth_image(arm, place, 1000.0) / 1000
    rows, columns = np.nonzero(depth)
    rays = np.stack(
        [(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(len(rows))],
        axis=-1,
    )
    return depth[rows, columns, None] * rays


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
def test_a_bag_of_images_gives_the_points_of_the_images(arm, tmp_path, form):
    take, depth = record(tmp_path, arm)
    expected = list(DepthSequence(take, depth, arm, tmp_path).points(range(3)))
    images = [
        (stamp, image(depth_image(arm, place, 1000.0), stamp))
        for stamp, place in zip(STAMPS, PLACES, strict=True)
    ]
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
    clouds = [
        np.concatenate([in_camera(arm, place), clutter, np.full((9, 3), np.nan)])
        for place in PLACES
    ]
    take = tmp_path / "clouds" / "take"
    take.mkdir(parents=True)
    if form == "bag":
        fields = [(name, 4 * i, 7, 1) for i, name in enumerate("xyz")]
        messages = [
            (stamp, cloud(points, stamp, fields, 16))
            for stamp, points in zip(STAMPS, clouds, strict=True)
        ]
        take = write_bag(tmp_path / "clouds", "ros1", {"/points": messages})
    for number, points in enumerate(clouds if form != "bag" else []):
        names = {
            "pcd": "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {0}\nHEIGHT "
            "1\nPOINTS {0}\nDATA binary\n"
        }
        names["ply"] = (
            "ply\nformat binary_little_endian 1.0\nelement vertex {0}\n"
            + "".join(f"property float {c}\n" for c in "xyz")
            + "end_header\n"
        )
        (take / f"{number + 1}.{form}").write_bytes(
            names[form].format(len(points)).encode() + points.astype("<f4").tobytes()
        )
    described = replace(
        depth,
        index=None,
        frames=f"*.{form}",
        intrinsics=None,
        width=None,
        height=None,
        units_per_metre=1.0,
        start=None,
    )
    sequence = DepthSequence(take, described, arm, tmp_path)
    for points, (found, valid), place in zip(
        clouds, sequence.points(range(3)), PLACES, strict=True
    ):
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
    bag = write_bag(
        tmp_path,
        "ros1",
        {"/depth": [(stamp + i, image(pixels, stamp)) for i, stamp in enumerate(stamps)]},
    )
    with pytest.raises(RecordingError, match="increase") as refused:
        DepthSequence(bag, depth, arm, tmp_path)
    assert refused.value.evidence["number"] == 2
