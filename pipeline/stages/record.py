"""record@dataset: the synthetic laboratory → raw files in the formats that the real instruments
write, and the truth that scoring may open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.model import arm_of, chain_of, link_chains
from pipeline.core import config, contracts, rng
from pipeline.core.columns import spread
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError
from pipeline.formats.depth.image import write_depth
from pipeline.formats.depth.index import write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.force.daqft import ForceRecord, write_daqft
from pipeline.formats.joints.table import write_joint_table
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.motion.take import MotionTake, RigidBody
from pipeline.formats.trajectory import write_trajectory
from pipeline.laboratory.force import Cables, record_force
from pipeline.laboratory.kinect import DepthCamera
from pipeline.laboratory.mocap import (
    MarkerCluster,
    as_built,
    capture,
    capture_bodies,
    in_body,
    place_markers,
)
from pipeline.laboratory.sensor import draw_bias
from pipeline.laboratory.session import (
    PerformedMotion,
    Session,
    depth_frames,
    log_joints,
    open_session,
    perform,
)
from pipeline.laboratory.swing import desired_path, desired_trajectory

RAW = Path("data/raw")
# Motive's spelling of when a capture began; no wall clock enters the recordings
STARTED = "2017-05-02 10.00.00.000 AM"
# writes the files of a take: of its name and part, motion and stream; its depth camera's clock
# offset in s, where it has one
Instruments = Callable[[str, str, PerformedMotion, np.random.Generator], float | None]


def run(name: str) -> None:
    """Record every take and every force record of the dataset ``name``; where another dataset is
    what is analysed, as `dvc repro -P` runs this for all, its recordings stay as they are.
    """
    settings = config.sections("record", RAW / name / "dvc.yaml")
    dataset, laboratory = settings.dataset, settings.dataset.laboratory
    if Path(dataset.recordings) != RAW / name / "recordings":
        print(f"record: analysed is {dataset.recordings}; to record {name} set dataset: {name}")
        for folder in ("recordings", "truth"):
            (RAW / name / folder).mkdir(exist_ok=True)
        return
    if laboratory is None:
        message = f"{name} has no laboratory that would record it"
        raise ConfigError(message, key="dataset.laboratory")
    with (
        contracts.replacing(RAW / name / "recordings") as folder,
        contracts.replacing(RAW / name / "truth") as truth,
    ):
        if dataset.robot is not None:
            _record_takes(settings, folder, truth)
        if "robots" in laboratory:
            _record_forces(folder, settings)


def _record_takes(settings, folder: Path, truth: Path) -> None:
    """Every take of the motion, and its truth."""
    dataset, scale = settings.dataset, settings.scale
    # those with depth images, which take longest, first
    takes = [("test", i) for i in range(scale.test_takes)]
    takes += [("train", i) for i in range(scale.training_takes)]
    # what an arm does has nothing to do with which rows of its task are analysed
    nominal = chain_of(replace(dataset.robot, task=None))
    stream = rng.stream(settings.seed, "record.session")
    session = open_session(nominal, dataset.laboratory["dynamics"], stream)
    set_up = _in_plane if dataset.robot.plane else _in_space
    instruments = set_up(session, dataset, stream, folder)
    record = partial(_record_take, session=session, settings=settings, instruments=instruments)
    rows = list(run_trials(record, takes, compute=settings.compute, label="record: takes"))
    rows = rows[scale.test_takes :] + rows[: scale.test_takes]
    joints = pd.concat([joints for joints, _ in rows], ignore_index=True)
    contracts.write(joints, "true_joints", truth)
    if clocks := [clock for _, clock in rows if clock]:
        contracts.write(pd.DataFrame(clocks), "true_clock", truth)


def _record_take(
    take: tuple[str, int], session: Session, settings, instruments: Instruments
) -> tuple[pd.DataFrame, dict | None]:
    """The files of one take; its true joint angles and, where it has depth images, its clock."""
    kind, number = take
    dataset, laboratory = settings.dataset, settings.dataset.laboratory
    name, part = f"{kind}_{number + 1:03d}", "training" if kind == "train" else "test"
    stream = rng.stream(settings.seed, f"record.{kind}", number)
    motion = perform(session, laboratory["trajectory"], laboratory["dynamics"], stream)
    offset = instruments(name, part, motion, stream)
    frame = np.arange(len(motion.truth))
    joints = pd.DataFrame(
        {"take": name, "part": part, "k": frame, "t": frame / dataset.motion.rate}
    ).assign(**spread("q", dataset.robot.joints, motion.truth))
    return joints, None if offset is None else {"take": name, "part": part, "offset": offset}


def _in_plane(session: Session, dataset, stream: np.random.Generator, folder: Path) -> Instruments:
    """Markers on the links of a planar arm, and a depth camera."""
    laboratory, arm = dataset.laboratory, arm_of(dataset.robot)
    template = np.array([list(link.values()) for link in dataset.mocap.markers.values()])
    markers = place_markers(template, laboratory["mocap"], stream)
    bias = draw_bias(laboratory["kinect"], stream)
    for place in ("optitrack", "kinect"):
        (folder / place).mkdir()
    trajectory = desired_trajectory(session.nominal, laboratory["trajectory"])
    path = desired_path(session.nominal, laboratory["trajectory"])
    joints = spread("q", dataset.robot.joints, path)
    write_trajectory(folder / "trajectory.csv", trajectory.assign(**joints))
    k = laboratory["kinect"]
    camera = Intrinsics(k.fx, k.fy, k.cx, k.cy, k.width, k.height)
    write_intrinsics(folder / "kinect" / "intrinsics.yaml", camera)
    arm = replace(arm, chain=session.chain)
    return partial(
        _write_in_plane, arm=arm, markers=markers, bias=bias, dataset=dataset, folder=folder
    )


def _write_in_plane(
    name: str, part: str, motion: PerformedMotion, stream, *, arm, markers, bias, dataset, folder
) -> float | None:
    laboratory = dataset.laboratory
    duration = laboratory["trajectory"].duration
    frames = depth_frames(motion.swing, duration, laboratory["clock"], stream)
    options = laboratory["mocap"]
    observed = capture(arm, motion.motion_capture, markers, *_base(dataset), options, stream)
    _write_take(name, observed.markers, {}, dataset, folder)
    if part == "training":
        return None
    camera = DepthCamera(arm, laboratory["kinect"], bias)
    images = folder / "kinect" / name / "depth"
    images.mkdir(parents=True, exist_ok=True)
    files = tuple(f"depth/{i:04d}.png" for i in range(len(frames.times)))
    for file, q in zip(files, frames.joints, strict=True):
        write_depth(images.parent / file, camera.observe(q, stream))
    write_index(images.parent / "depth.txt", frames.times, files)
    return frames.clock_offset


def _in_space(session: Session, dataset, stream: np.random.Generator, folder: Path) -> Instruments:
    """Rigid bodies on the links of any arm, and its controller's log."""
    laboratory, mocap = dataset.laboratory, dataset.mocap
    if {*mocap.bodies} != {*mocap.markers}:
        message = "the laboratory follows rigid bodies: every link of markers needs its body"
        raise ConfigError(message, key="dataset.mocap.bodies")
    chains, clusters = link_chains(dataset.robot, mocap.markers, "dataset.mocap.markers"), {}
    for link, body in mocap.bodies.items():
        drawn = np.array(list(mocap.markers[link].values()))
        clusters[body.name] = MarkerCluster(
            chain=as_built(chains[link], session.chain),
            places=place_markers(drawn, laboratory["mocap"], stream),
            shape=in_body(drawn, body.mount.position, body.mount.rpy),
        )
    for place in ("optitrack", "joints"):
        (folder / place).mkdir()
    path = desired_path(session.nominal, laboratory["trajectory"])
    command = {"t": np.arange(len(path)) / dataset.motion.rate}
    command |= spread("q", dataset.robot.joints, path)
    write_trajectory(folder / "trajectory.csv", pd.DataFrame(command))
    return partial(_write_in_space, clusters=clusters, dataset=dataset, folder=folder)


def _write_in_space(
    name: str, part: str, motion: PerformedMotion, stream, *, clusters, dataset, folder
) -> None:
    laboratory = dataset.laboratory
    poses = capture_bodies(
        clusters, motion.motion_capture, _base(dataset), laboratory["mocap"], stream
    )
    bodies = {body: RigidBody(*pose) for body, pose in poses.items()}
    _write_take(name, {}, bodies, dataset, folder)
    log = log_joints(motion.swing, laboratory["trajectory"], laboratory["encoders"])
    write_joint_table(folder / "joints" / f"{name}.csv", *log, dataset.robot.joints)


def _base(dataset) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position of the arm's base in the motion capture's world."""
    base = dataset.mocap.base
    return Rotation.from_euler("xyz", base.rpy).as_matrix(), np.array(base.position)


def _write_take(name: str, markers: dict, bodies: dict, dataset, folder: Path) -> None:
    """The take as Motive exports it."""
    frame = np.arange(dataset.motion.steps + 1)
    rate = dataset.motion.rate
    take = MotionTake(name, "1.23", rate, frame, frame / rate, markers, bodies, {})
    write_motive(folder / "optitrack" / f"{name}.csv", take, start=STARTED)


def _record_forces(folder: Path, settings) -> None:
    """The force records, as the transducer's own program logs them."""
    laboratory, force = settings.dataset.laboratory, settings.dataset.force
    transducer = laboratory["transducer"]
    for number, configuration in enumerate(force.configurations.values()):
        felt = record_force(
            Cables(
                configuration.tension,
                configuration.direction,
                configuration.elevation,
                configuration.attachment,
            ),
            laboratory["robots"].first(len(configuration.tension)),
            transducer,
            force.tare,
            settings.scale.force_seconds,
            rng.stream(settings.seed, "record.force", number),
        )
        felt = ForceRecord(
            felt.time, felt.force, felt.torque, transducer.rate, "FT00001", STARTED, {}
        )
        file = folder / configuration.file
        file.parent.mkdir(parents=True, exist_ok=True)
        write_daqft(file, felt)
