"""record: the synthetic laboratory → raw files in the formats that the real instruments write, and the truth that scoring may open."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline import config, contracts, rng
from pipeline.arm.model import load_arm
from pipeline.compute.trials import run_trials
from pipeline.instruments.ati import ForceRecord, write_daqft
from pipeline.instruments.depth import write_depth
from pipeline.instruments.depth_index import write_index
from pipeline.instruments.depth_intrinsics import Intrinsics, write_intrinsics
from pipeline.instruments.motion_take import MotionTake
from pipeline.instruments.motive import write_motive
from pipeline.instruments.trajectory import write_trajectory
from pipeline.twin.force import record_force
from pipeline.twin.kinect import DepthCamera
from pipeline.twin.laboratory import Session, open_session, perform
from pipeline.twin.mocap import capture
from pipeline.twin.trajectory import desired_trajectory

DVC_FILE = Path("data/raw/youbot/dvc.yaml")
STARTED = "2017-05-02 10.00.00.000 AM"  # Motive's spelling of when a capture began; no wall clock enters the recordings


def run() -> None:
    """Record every take and every force record of the dataset."""
    settings = config.sections("record", DVC_FILE)
    dataset, twin = settings.dataset, settings.dataset.twin
    arm = load_arm(dataset.robot.urdf, dataset.robot.joints, dataset.robot.tool, dataset.robot.locked)
    template = np.array([list(link.values()) for link in dataset.mocap.markers.values()])
    session = open_session(arm, template, twin["dynamics"], twin["mocap"], twin["kinect"], rng.stream(settings.seed, "record.session"))
    # those with depth images, which take longest, first
    takes = [("test", i) for i in range(settings.scale.test_takes)] + [("train", i) for i in range(settings.scale.training_takes)]
    with contracts.replacing(DVC_FILE.parent / "recordings") as folder, contracts.replacing(DVC_FILE.parent / "truth") as truth:
        (folder / "optitrack").mkdir()
        (folder / "kinect").mkdir()
        (folder / "force").mkdir()
        write_trajectory(folder / "trajectory.csv", desired_trajectory(arm.chain, twin["trajectory"]))
        kinect = twin["kinect"]
        camera = Intrinsics(kinect.fx, kinect.fy, kinect.cx, kinect.cy, kinect.width, kinect.height)
        write_intrinsics(folder / "kinect" / "intrinsics.yaml", camera)
        record = partial(_record_take, session=session, settings=settings, folder=folder)
        rows = list(run_trials(record, takes, compute=settings.compute, label="record: takes"))
        rows = rows[settings.scale.test_takes :] + rows[: settings.scale.test_takes]
        contracts.write(pd.concat([joints for joints, _ in rows], ignore_index=True), "true_joints", truth)
        contracts.write(pd.DataFrame([clock for _, clock in rows if clock]), "true_clock", truth)
        for number, configuration in enumerate(dataset.force.configurations.values()):
            felt = record_force(
                configuration.tension, configuration.direction, twin["robots"], twin["transducer"],
                dataset.force.tare, settings.scale.force_seconds, rng.stream(settings.seed, "record.force", number),
            )  # fmt: skip
            logged = ForceRecord(felt.time, felt.force, felt.torque, twin["transducer"].rate, "FT00001", STARTED, {})
            write_daqft(folder / configuration.file, logged)


def _record_take(take: tuple[str, int], session: Session, settings, folder: Path) -> tuple[pd.DataFrame, dict | None]:
    part, number = take
    dataset, twin = settings.dataset, settings.dataset.twin
    name = f"{part}_{number + 1:03d}"
    stream = rng.stream(settings.seed, f"record.{part}", number)
    motion = perform(session, twin["trajectory"], twin["dynamics"], twin["clock"], stream)
    base = dataset.mocap.base
    rotation = Rotation.from_euler("xyz", base.rpy).as_matrix()
    seen = capture(session.arm, motion.motion_capture, session.markers, rotation, np.array(base.position), twin["mocap"], stream)
    frame = np.arange(len(motion.motion_capture))
    time = frame / dataset.motion.rate
    motive = MotionTake(name, "1.23", dataset.motion.rate, frame, time, seen.markers, {}, {})
    write_motive(folder / "optitrack" / f"{name}.csv", motive, start=STARTED)
    joints = pd.DataFrame({"take": name, "part": "training" if part == "train" else "test", "k": frame, "t": time})
    joints = joints.assign(**{f"q{j + 1}": motion.truth[:, j] for j in range(3)})
    if part == "train":
        return joints, None
    camera = DepthCamera(session.arm, twin["kinect"], session.depth_bias)
    images = folder / "kinect" / name / "depth"
    images.mkdir(parents=True, exist_ok=True)
    files = tuple(f"depth/{i:04d}.png" for i in range(len(motion.frame_times)))
    for file, q in zip(files, motion.frame_joints, strict=True):
        write_depth(images.parent / file, camera.observe(q, stream))
    write_index(images.parent / "depth.txt", motion.frame_times, files)
    return joints, {"take": name, "part": "test", "offset": motion.clock_offset}
