"""Small valid recordings of motion capture and depth camera, made by the laboratory and the writers
of the formats, and the values that the stages recover from them, damaged or not.
"""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from marker_takes import marker_places
from numpy.random import default_rng
from planar_poses import load_arm
from sample_options import made
from scipy.spatial.transform import Rotation
from synthetic_session import TRAJECTORY

from pipeline.arm.model import Arm
from pipeline.configuration.config import compose_config
from pipeline.core.columns import values
from pipeline.core.errors import PipelineError
from pipeline.core.options.analysis import ArticulationSection
from pipeline.core.options.dataset import Dataset, Motion
from pipeline.formats.depth.image import write_depth, write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.motion.take import MotionTake
from pipeline.formats.trajectory import write_trajectory
from pipeline.laboratory.dynamics import desired_joints, desired_trajectory
from pipeline.laboratory.kinect import DepthCamera, draw_bias
from pipeline.laboratory.options import KinectOptions
from pipeline.perception.markers import follower
from pipeline.recordings import depth, motion_capture
from pipeline.recordings.depth_takes import (
    CameraTake,
    arm_points,
    articulate_rows,
    on_motion_clock,
)

ROOT = Path(__file__).parents[2]
SAME = 1e-9  # rad: above the rounding of a sum, below the resolution of any instrument
# of the motion grid
STEPS = 180
RATE = 100.0
GRID = np.arange(STEPS + 1) / RATE
# s into the dataset's motion, shortly before the arm starts: its speeding up gives the clock offset
START = 0.1
# of the depth camera
FRAMES = 27
FRAME_RATE = 15.0
# px, and how many of a Kinect's pixels one of these is wide
SIZE = (141, 170)
COARSER = 3.0


class Recovered(NamedTuple):
    """Joint angles (N, 3) in rad at ``time`` (N,) in s, and counts of the table ``quality``."""

    time: np.ndarray
    q: np.ndarray
    counts: dict[str, float]


class Bench:
    """Files of a valid recording by their paths in ``folder``, and the recovered values."""

    def __init__(self, folder: Path, recover: Callable[[Path], Recovered]) -> None:
        files = (file for file in sorted(folder.rglob("*")) if file.is_file())
        self.files = {
            str(file.relative_to(folder)): file.read_bytes() for file in files
        }
        self.recover, self.clean = recover, recover(folder)

    def outcome(
        self,
        files: dict[str, bytes],
        counted: tuple[str, ...] = (),
    ) -> tuple[str, object]:
        """``refused`` with the error, or one of ``repaired``, ``unharmed`` and ``unnoticed`` with
        the recovered values. A repair changes one of the counts ``counted``, an estimate by more
        than three of its standard errors. Any other exception passes through.
        """
        with TemporaryDirectory() as folder:
            for name, content in files.items():
                file = Path(folder) / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
            try:
                recovered = self.recover(Path(folder))
            except PipelineError as error:
                return "refused", error
        before = self.clean.counts
        after = recovered.counts
        for name in counted:
            margin = 3 * before.get(f"{name}_standard_error", 0.0)
            if abs(after.get(name, 0.0) - before.get(name, 0.0)) > margin:
                return "repaired", recovered
        same = recovered.q.shape == self.clean.q.shape and np.allclose(
            recovered.q,
            self.clean.q,
            rtol=0,
            atol=SAME,
        )
        return "unharmed" if same else "unnoticed", recovered


def counts_of(quality: list[dict]) -> dict[str, float]:
    return {row["quantity"]: row["value"] for row in quality}


@pytest.fixture(scope="session")
def dataset() -> Dataset:
    """The synthetic dataset's own options, for a motion of 1.8 s and a coarse camera."""
    options = compose_config(ROOT / "params.yaml").dataset
    options.laboratory["trajectory"] = TRAJECTORY
    options.motion = Motion(RATE, STEPS)

    options.mocap.training, options.mocap.test = "optitrack/*.csv", None
    options.depth.height, options.depth.width = SIZE
    options.depth.rate, options.depth.workspace.min_pixels = FRAME_RATE, 5
    return options


@pytest.fixture(scope="session")
def motion(dataset) -> Callable[[np.ndarray], np.ndarray]:
    """Joint angles (K, 3) at times (K,) s: the dataset's motion from START on."""
    trajectory = dataset.laboratory["trajectory"]
    return lambda t: desired_joints(np.asarray(t) + START, trajectory)[0]


def take_bench(folder: Path, dataset: Dataset, arm: Arm, motion) -> Bench:
    """One take of motion capture."""
    template = np.array(
        [list(link.values()) for link in dataset.mocap.markers.values()],
    )
    base = dataset.mocap.base
    rng = default_rng(1)
    turn = Rotation.from_euler("xyz", base.rpy).as_matrix()
    places = arm.to_base(marker_places(motion(GRID), template, arm.chain)) @ turn.T
    places = (places + np.array(base.position)).reshape(len(GRID), 9, 3)
    places += rng.normal(scale=5e-5, size=places.shape)
    names = [name for link in dataset.mocap.markers.values() for name in link]
    markers = dict(zip(names, np.moveaxis(places, 1, 0), strict=True))
    (folder / "optitrack").mkdir()
    take = MotionTake(
        "test_001",
        "1.23",
        RATE,
        np.arange(STEPS + 1),
        GRID,
        markers,
        {},
        {},
    )
    write_motive(
        folder / "optitrack/test_001.csv",
        take,
        start="2017-05-02 10.00.00.000 AM",
    )

    def recover(raw: Path) -> Recovered:
        take, *_ = motion_capture.find_takes(raw, dataset.mocap)
        rows, quality = motion_capture.marker_rows(*take, dataset)
        follow = follower(dataset.robot, dataset.mocap)
        track = follow(rows, take=take[0])
        time = np.arange(len(track.q)) / dataset.motion.rate
        return Recovered(time, track.q, counts_of(quality) | track.counts)

    return Bench(folder, recover)


def depth_bench(folder: Path, dataset: Dataset, arm: Arm, motion) -> Bench:
    """One take of the depth camera, whose clock is set by the markers of a take."""
    kinect = dataset.laboratory["kinect"]
    rng = default_rng(2)
    coarse = {
        name: getattr(kinect, name) / COARSER for name in ("fx", "fy", "cx", "cy")
    }
    # few pixels, so quiet ones
    quiet = {"axial": (5e-4, 0.0, 0.0, 0.0), "lateral": (0.0, 0.0), "edge_lost": 0.0}
    quiet |= {
        "edge_mixed": 0.0,
        "bias_offset_std": 0.0,
        "height": SIZE[0],
        "width": SIZE[1],
    }
    options = KinectOptions(**{**vars(kinect), **coarse, **quiet})
    camera = DepthCamera(arm, options, draw_bias(options, rng))
    time = np.arange(FRAMES) / FRAME_RATE
    take = folder / "kinect/test_001"
    (take / "depth").mkdir(parents=True)
    names = tuple(f"depth/{i:04d}.png" for i in range(FRAMES))
    for name, q in zip(names, motion(time), strict=True):
        write_depth(take / name, camera.observe(q, rng))
    write_index(take / "depth.txt", time + 0.1, names)
    intrinsics = Intrinsics(*coarse.values(), SIZE[1], SIZE[0])
    write_intrinsics(folder / "kinect/intrinsics.yaml", intrinsics)
    table = desired_trajectory(arm.chain, dataset.laboratory["trajectory"])
    shifted = table.iloc[round(START * RATE) :][: STEPS + 1].assign(t=GRID)
    write_trajectory(folder / "trajectory.csv", shifted)
    nodes = arm.chain.points(motion(GRID))[:, 1:]
    places = arm.to_base(
        np.stack([nodes[..., 0], 0 * nodes[..., 0], nodes[..., 1]], axis=-1),
    )
    k = np.repeat(np.arange(len(GRID)), nodes.shape[1])
    markers = pd.DataFrame(
        {"take": "test_001", "part": "test", "k": k, "t": GRID[k], "link": 1},
    )
    markers[["x", "y", "z"]] = places.reshape(-1, 3)
    section = made(ArticulationSection, minimum_points=80)

    def recover(raw: Path) -> Recovered:
        trajectory = motion_capture.trajectory_rows(raw / dataset.trajectory, dataset)
        take = next(iter(depth.depth_paths(raw, dataset.depth).items()))
        frames, quality = depth.frame_rows(take, dataset.depth, arm, raw, raw)
        clouds = arm_points(frames, raw)
        frames, clock = on_motion_clock(
            CameraTake(frames, markers, []),
            dataset.depth,
            arm,
        )
        joints = dataset.robot.joints
        start = motion(0.0)
        angles = articulate_rows(
            frames,
            clouds,
            arm,
            joints,
            trajectory,
            section,
            start,
        )
        counts = counts_of([*quality, *clock])
        counts["valid"] = float(frames["valid"].mean())
        counts["frames_without_fit"] = len(frames) - len(angles)
        return Recovered(angles["t"].to_numpy(), values(angles, "q"), counts)

    return Bench(folder, recover)


@pytest.fixture(scope="session")
def benches(dataset, motion, tmp_path_factory) -> dict[str, Bench]:
    """Instrument → its recording."""
    robot = dataset.robot
    arm = load_arm(ROOT / robot.urdf, robot.joints, robot.tool, robot.locked)
    folder = tmp_path_factory.mktemp
    return {
        "take": take_bench(folder("take"), dataset, arm, motion),
        "depth": depth_bench(folder("depth"), dataset, arm, motion),
    }
