"""The costly pieces of the work on raw files, each against the least that it has to do: frames of
the depth camera recorded and read, and the files of a dataset listed for the parts that read them.
"""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from depth_scenario import TAKE, record
from project_copy import set_parameters
from scenario import ROOT, arm, swing

from pipeline.core.config import compose_config
from pipeline.formats.depth.image import encode_depth
from pipeline.laboratory.kinect import DepthCamera
from pipeline.laboratory.options import KinectOptions
from pipeline.laboratory.sensor import draw_bias
from pipeline.recordings.depth_sequence import DepthSequence
from pipeline.recordings.inventory import by_part, listing

RECORDED = "Depth frames of the laboratory, as PNG"
READ = "Depth frames to the arm's points"
LISTED = "Raw files listed, by the part that reads them"
BYTES = 70_000  # of a raw file, about those of a depth frame


@pytest.fixture
def poses(size) -> np.ndarray:
    return swing(size(30, 2) - 1)


@pytest.fixture
def camera() -> DepthCamera:
    options = KinectOptions()
    return DepthCamera(arm(), options, draw_bias(options, np.random.default_rng(1)))


@pytest.mark.benchmark(group=RECORDED)
def test_ours_of_recording(benchmark, camera, poses):
    benchmark.extra_info |= {"role": "ours", "items": len(poses)}
    rng = np.random.default_rng(2)
    frames = benchmark(lambda: [encode_depth(camera.observe(q, rng)) for q in poses])
    assert min(map(len, frames)) > 10_000


@pytest.mark.benchmark(group=RECORDED)
def test_floor_of_recording(benchmark, camera, poses):
    benchmark.extra_info |= {"role": "floor", "items": len(poses), "target": 2}
    benchmark.extra_info |= {
        "against": "floor of noise and encoding alone",
        "configuration": "a normal number a pixel by NumPy, the same images by OpenCV",
    }
    rng = np.random.default_rng(2)
    images = [camera.observe(q, rng) for q in poses]

    def floor() -> None:
        for image in images:
            rng.standard_normal(image.shape, dtype=np.float32)
            encode_depth(image)

    benchmark(floor)


@pytest.fixture
def recording(size, tmp_path):
    return record(tmp_path, size(60, 2))


@pytest.mark.benchmark(group=READ)
def test_ours_of_reading(benchmark, recording):
    benchmark.extra_info |= {"role": "ours", "items": len(recording.poses)}

    def read() -> list[int]:
        path = recording.folder / "kinect" / TAKE
        sequence = DepthSequence(path, recording.depth, arm(), recording.folder)
        return [len(points) for points, _ in sequence.points(range(len(recording.poses)))]

    assert min(benchmark(read)) > 1000


@pytest.mark.benchmark(group=READ)
def test_floor_of_reading(benchmark, recording):
    benchmark.extra_info |= {"role": "floor", "items": len(recording.poses), "target": 2}
    benchmark.extra_info |= {
        "against": "floor of decoding alone",
        "configuration": "the files read whole, and `cv2.imdecode`; ours has the camera's rays "
        "from the take before, as in the stage",
    }
    files = sorted((recording.folder / "kinect" / TAKE / "depth").iterdir())
    assert len(files) == len(recording.poses)

    def floor() -> None:
        for file in files:
            cv2.imdecode(np.frombuffer(file.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)

    benchmark(floor)


@pytest.fixture
def raw(size, tmp_path) -> Path:
    """Depth frames of a few takes, one file after another of the same size."""
    rng = np.random.default_rng(3)
    for take in range(size(10, 2)):
        folder = tmp_path / "raw/kinect" / f"test_{take:03d}" / "depth"
        folder.mkdir(parents=True)
        for frame in range(size(60, 2)):
            (folder / f"{frame:04d}.png").write_bytes(rng.bytes(BYTES))
    return tmp_path / "raw"


@pytest.mark.benchmark(group=LISTED)
def test_ours_of_listing(benchmark, raw, tmp_path):
    shutil.copy2(ROOT / "params.yaml", tmp_path)
    set_parameters(tmp_path, dataset="youbot", overrides="{}")
    dataset = compose_config(tmp_path / "params.yaml").dataset
    dataset.recordings = str(raw)
    files = len([*raw.rglob("*.png")])
    benchmark.extra_info |= {"role": "ours", "items": files}
    parts = benchmark(lambda: by_part(listing(raw), dataset))
    assert {part: len(rows) for part, rows in parts.items()} == {
        "motion": 0,
        "depth": files,
        "force": 0,
    }


@pytest.mark.benchmark(group=LISTED)
def test_floor_of_listing(benchmark, raw):
    files = [*raw.rglob("*.png")]
    benchmark.extra_info |= {"role": "floor", "items": len(files), "target": 2}
    benchmark.extra_info |= {
        "against": "floor of reading and hashing alone",
        "configuration": "the files read whole, and SHA-256 by `hashlib`",
    }
    benchmark(lambda: [hashlib.sha256(file.read_bytes()).digest() for file in files])
