"""Small valid recordings of every instrument, made by the laboratory and the writers of the
formats.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from made_options import made
from marker_takes import marker_places
from recovery_bench import (
    Bench,
    angles_of_depth,
    angles_of_logs,
    angles_of_markers,
    moments_of_force,
    recovered_from,
)
from scipy.spatial.transform import Rotation
from written_logs import write_joint_log

from pipeline.arm.model import Arm, load_arm
from pipeline.core.config import compose_config
from pipeline.core.options.analysis import ArticulationSection
from pipeline.core.options.dataset import Dataset, Motion
from pipeline.core.options.instruments import JointLogSection as JointLogOptions
from pipeline.formats.depth.image import encode_depth
from pipeline.formats.depth.index import write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.force.daqft import ForceRecord, write_daqft
from pipeline.formats.joints.log import JointLog
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.motion.take import MotionTake
from pipeline.formats.trajectory import write_trajectory
from pipeline.laboratory.kinect import DepthCamera, draw_bias
from pipeline.laboratory.options import KinectOptions
from pipeline.laboratory.swing import desired_joints, desired_trajectory

ROOT = Path(__file__).parents[2]
FULL_SCALE = 32.0  # N, of the force transducer
STEPS, RATE = 180, 100.0  # of the motion grid
# s into the motion of the dataset, still at rest for a little: how it speeds up tells the clocks
# apart
START = 0.1
FRAMES, FRAME_RATE = 27, 15.0  # of the depth camera
SIZE, COARSER = (141, 170), 3.0  # px, and how many of a Kinect's pixels one of these is wide


@pytest.fixture(scope="session")
def dataset() -> Dataset:
    """The synthetic dataset's own options, for a motion of 1.8 s and a coarse camera."""
    config = compose_config(ROOT / "params.yaml")
    options = config.dataset
    options.motion = Motion(RATE, STEPS)
    options.mocap.training, options.mocap.test = "optitrack/*.csv", None
    options.depth.height, options.depth.width = SIZE
    options.depth.rate, options.depth.workspace.min_pixels = FRAME_RATE, 5
    options.force.tare, log = 2.0, options.force.log
    log.full_scale, log.rate = [FULL_SCALE] * 3, 50.0
    return options


@pytest.fixture(scope="session")
def arm(dataset) -> Arm:
    robot = dataset.robot
    return load_arm(ROOT / robot.urdf, robot.joints, robot.tool, robot.locked)


@pytest.fixture(scope="session")
def motion(dataset):
    """Joint angles (K, 3) at times (K,) s: the dataset's motion from START on."""
    trajectory = dataset.laboratory["trajectory"]
    return lambda t: desired_joints(np.asarray(t) + START, trajectory)[0]


def _bench(files: dict[str, bytes], recover, time: np.ndarray, truth: np.ndarray) -> Bench:
    return Bench(files, recover, recovered_from(files, recover), time, truth)


def _files(folder: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


@pytest.fixture(scope="session")
def marker_bench(dataset, arm, motion, tmp_path_factory) -> Bench:
    folder, rng = tmp_path_factory.mktemp("markers"), np.random.default_rng(1)
    template = np.array([list(link.values()) for link in dataset.mocap.markers.values()])
    frame = np.arange(STEPS + 1)
    q = motion(frame / RATE)
    base = dataset.mocap.base
    turn = Rotation.from_euler("xyz", base.rpy).as_matrix()
    places = arm.to_base(marker_places(q, template, arm.chain)) @ turn.T + np.array(base.position)
    places += rng.normal(scale=5e-5, size=places.shape)
    names = [name for link in dataset.mocap.markers.values() for name in link]
    markers = dict(zip(names, np.moveaxis(places.reshape(len(q), 9, 3), 1, 0), strict=True))
    (folder / "optitrack").mkdir()
    take = MotionTake("test_001", "1.23", RATE, frame, frame / RATE, markers, {}, {})
    write_motive(folder / "optitrack/test_001.csv", take, start="2017-05-02 10.00.00.000 AM")
    return _bench(
        _files(folder),
        partial(angles_of_markers, dataset=dataset),
        frame / RATE,
        q,
    )


@pytest.fixture(scope="session")
def depth_bench(dataset, arm, motion, tmp_path_factory) -> Bench:
    folder, rng = tmp_path_factory.mktemp("depth"), np.random.default_rng(2)
    kinect = dataset.laboratory["kinect"]
    coarse = {name: getattr(kinect, name) / COARSER for name in ("fx", "fy", "cx", "cy")}
    # few pixels, so quiet ones
    quiet = {"axial": (5e-4, 0.0, 0.0, 0.0), "lateral": (0.0, 0.0), "edge_lost": 0.0}
    quiet |= {"edge_mixed": 0.0, "bias_offset_std": 0.0, "height": SIZE[0], "width": SIZE[1]}
    options = KinectOptions(**{**vars(kinect), **coarse, **quiet})
    camera = DepthCamera(arm, options, draw_bias(options, rng))
    time = np.arange(FRAMES) / FRAME_RATE
    take = folder / "kinect/test_001"
    (take / "depth").mkdir(parents=True)
    names = tuple(f"depth/{i:04d}.png" for i in range(FRAMES))
    for name, q in zip(names, motion(time), strict=True):
        (take / name).write_bytes(encode_depth(camera.observe(q, rng)))
    write_index(take / "depth.txt", time + 0.1, names)
    intrinsics = Intrinsics(*coarse.values(), SIZE[1], SIZE[0])
    write_intrinsics(folder / "kinect/intrinsics.yaml", intrinsics)
    grid = np.arange(STEPS + 1) / RATE
    table = desired_trajectory(arm.chain, dataset.laboratory["trajectory"])
    shifted = table.iloc[round(START * RATE) :][: STEPS + 1].assign(t=grid)
    write_trajectory(folder / "trajectory.csv", shifted)
    nodes = arm.chain.points(motion(grid))[:, 1:]
    places = arm.to_base(np.stack([nodes[..., 0], 0 * nodes[..., 0], nodes[..., 1]], axis=-1))
    k = np.repeat(np.arange(len(grid)), nodes.shape[1])
    markers = pd.DataFrame({"take": "test_001", "part": "test", "k": k, "t": grid[k], "link": 1})
    markers[["x", "y", "z"]] = places.reshape(-1, 3)
    known = {"dataset": dataset, "arm": arm, "markers": markers, "start": motion(0.0)}
    options = made(ArticulationSection, minimum_points=80)
    recover = partial(angles_of_depth, **known, options=options)
    return _bench(_files(folder), recover, grid, motion(grid))


@pytest.fixture(scope="session")
def force_bench(dataset, tmp_path_factory) -> Bench:
    folder, rng = tmp_path_factory.mktemp("force"), np.random.default_rng(3)
    time = np.arange(600) / 50.0
    load = np.where(time[:, None] < 2.0, 0.0, [3.0, 5.0, 0.0])
    felt = load + rng.normal(0.2, 0.01, load.shape), rng.normal(0, 1e-3, load.shape)
    record = ForceRecord(time, *felt, 50.0, "FT1", "now", {})
    (folder / "force").mkdir()
    write_daqft(folder / "force/C1.csv", record)
    recover = partial(moments_of_force, name="C1", force=dataset.force)
    clean = recovered_from(_files(folder), recover)
    return Bench(_files(folder), recover, clean, clean.time, clean.values)


@pytest.fixture(scope="session")
def log_bench(dataset, arm, tmp_path_factory) -> Bench:
    """Three repetitions of a motion of 40 steps, there and back, in a folder of three logs."""
    folder, rng = tmp_path_factory.mktemp("log"), np.random.default_rng(4)
    start, end = np.array([1.6, -4.7, 2.0]), np.array([2.0, -4.3, 2.4])
    share = (1 - np.cos(np.linspace(0, np.pi, 41))) / 2
    cycle = np.concatenate([np.zeros(20), share, np.ones(20), share[::-1]])
    way = np.concatenate([cycle, cycle, cycle, np.zeros(20)])
    target = start + way[:, None] * (end - start)
    speed = np.vstack([np.zeros(3), np.diff(target, axis=0) * RATE])
    actual = target - 0.01 * speed + rng.normal(scale=1e-4, size=target.shape)
    time = np.arange(len(way)) / RATE
    (folder / "joints/run").mkdir(parents=True)
    for name, angles in {"actual": actual, "target": target, "speed": speed}.items():
        write_joint_log(folder / f"joints/run/{name}.csv", JointLog(time, {"actual": angles}, {}))
    names = {name: f"{name}.csv" for name in ("actual", "target", "speed")}
    ends = {"start": start.tolist(), "end": end.tolist(), "tolerance": 1e-3, "rest": 5}
    options = JointLogOptions(movements="joints/*", joints=["a", "b", "c"], **names, **ends)
    robot = SimpleNamespace(**vars(dataset.robot) | {"joints": options.joints})
    changes = {"robot": robot, "motion": Motion(RATE, 40 + 10), "joint_log": options}
    logged = SimpleNamespace(**vars(dataset) | changes)
    recover = partial(angles_of_logs, dataset=logged, arm=arm)
    clean = recovered_from(_files(folder), recover)
    return Bench(_files(folder), recover, clean, clean.time[:51], clean.values[:51])


@pytest.fixture(scope="session")
def benches(marker_bench, depth_bench, force_bench, log_bench) -> dict[str, Bench]:
    """Instrument → its recording."""
    return {"take": marker_bench, "depth": depth_bench, "force": force_bench, "joints": log_bench}
