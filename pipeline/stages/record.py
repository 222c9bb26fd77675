"""record: the synthetic laboratory → raw files in the formats that the real instruments write, and
the truth that scoring may open.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.model import arm_of
from pipeline.core import config, contracts, rng
from pipeline.core.columns import spread
from pipeline.core.compute.trials import run_trials
from pipeline.formats.depth.index import write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.depth.png import write_depth
from pipeline.formats.force.daqft import ForceRecord, write_daqft
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.motion.take import MotionTake
from pipeline.formats.trajectory import write_trajectory
from pipeline.laboratory.force import record_force
from pipeline.laboratory.kinect import DepthCamera
from pipeline.laboratory.mocap import capture
from pipeline.laboratory.session import Session, open_session, perform
from pipeline.laboratory.swing import desired_trajectory

DVC_FILE = Path("data/raw/youbot/dvc.yaml")
# Motive's spelling of when a capture began; no wall clock enters the recordings
STARTED = "2017-05-02 10.00.00.000 AM"


def run() -> None:
    """Record every take and every force record of the dataset."""
    settings = config.sections("record", DVC_FILE)
    dataset, laboratory, scale = settings.dataset, settings.dataset.laboratory, settings.scale
    arm = arm_of(dataset.robot)
    template = np.array([list(link.values()) for link in dataset.mocap.markers.values()])
    parts = [laboratory[name] for name in ("dynamics", "mocap", "kinect")]
    session = open_session(arm, template, *parts, rng.stream(settings.seed, "record.session"))
    # those with depth images, which take longest, first
    takes = [("test", i) for i in range(scale.test_takes)]
    takes += [("train", i) for i in range(scale.training_takes)]
    raw = DVC_FILE.parent
    with (
        contracts.replacing(raw / "recordings") as folder,
        contracts.replacing(raw / "truth") as truth,
    ):
        for name in ("optitrack", "kinect", "force"):
            (folder / name).mkdir()
        trajectory = desired_trajectory(arm.chain, laboratory["trajectory"])
        write_trajectory(folder / "trajectory.csv", trajectory)
        k = laboratory["kinect"]
        camera = Intrinsics(k.fx, k.fy, k.cx, k.cy, k.width, k.height)
        write_intrinsics(folder / "kinect" / "intrinsics.yaml", camera)
        record = partial(_record_take, session=session, settings=settings, folder=folder)
        rows = list(run_trials(record, takes, compute=settings.compute, label="record: takes"))
        rows = rows[scale.test_takes :] + rows[: scale.test_takes]
        joints = pd.concat([joints for joints, _ in rows], ignore_index=True)
        contracts.write(joints, "true_joints", truth)
        contracts.write(pd.DataFrame([clock for _, clock in rows if clock]), "true_clock", truth)
        for number, configuration in enumerate(dataset.force.configurations.values()):
            stream = rng.stream(settings.seed, "record.force", number)
            _record_force(folder / configuration.file, configuration, settings, stream)


def _record_force(file: Path, configuration, settings, stream: np.random.Generator) -> None:
    """One force record, as the transducer's own program logs it."""
    laboratory = settings.dataset.laboratory
    felt = record_force(
        configuration.tension,
        configuration.direction,
        laboratory["robots"],
        laboratory["transducer"],
        settings.dataset.force.tare,
        settings.scale.force_seconds,
        stream,
    )
    rate = laboratory["transducer"].rate
    write_daqft(file, ForceRecord(felt.time, felt.force, felt.torque, rate, "FT00001", STARTED, {}))


def _record_take(
    take: tuple[str, int], session: Session, settings, folder: Path
) -> tuple[pd.DataFrame, dict | None]:
    """The files of one take; its true joint angles and, where it has depth images, its clock."""
    part, number = take
    dataset, laboratory = settings.dataset, settings.dataset.laboratory
    name = f"{part}_{number + 1:03d}"
    stream = rng.stream(settings.seed, f"record.{part}", number)
    options = [laboratory[key] for key in ("trajectory", "dynamics", "clock")]
    motion = perform(session, *options, stream)
    base = dataset.mocap.base
    observed = capture(
        session.arm,
        motion.motion_capture,
        session.markers,
        Rotation.from_euler("xyz", base.rpy).as_matrix(),
        np.array(base.position),
        laboratory["mocap"],
        stream,
    )
    frame = np.arange(len(motion.motion_capture))
    time = frame / dataset.motion.rate
    motive = MotionTake(name, "1.23", dataset.motion.rate, frame, time, observed.markers, {}, {})
    write_motive(folder / "optitrack" / f"{name}.csv", motive, start=STARTED)
    part = "training" if part == "train" else "test"
    joints = pd.DataFrame({"take": name, "part": part, "k": frame, "t": time})
    joints = joints.assign(**spread("q", dataset.robot.joints, motion.truth))
    if part == "training":
        return joints, None
    camera = DepthCamera(session.arm, laboratory["kinect"], session.depth_bias)
    images = folder / "kinect" / name / "depth"
    images.mkdir(parents=True, exist_ok=True)
    files = tuple(f"depth/{i:04d}.png" for i in range(len(motion.frame_times)))
    for file, q in zip(files, motion.frame_joints, strict=True):
        write_depth(images.parent / file, camera.observe(q, stream))
    write_index(images.parent / "depth.txt", motion.frame_times, files)
    return joints, {"take": name, "part": "test", "offset": motion.clock_offset}
