"""record@dataset: raw files of the synthetic laboratory in the formats of the real instruments, and
the truth, which score alone opens.
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
from pipeline.laboratory import mocap, session
from pipeline.laboratory.force import Cables, record_force
from pipeline.laboratory.kinect import DepthCamera, draw_bias
from pipeline.laboratory.session import PerformedMotion, Session
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
    places = RAW / name / "recordings", RAW / name / "truth"
    if Path(dataset.recordings) != places[0]:
        print(f"record: analysed is {dataset.recordings}; to record {name} set dataset: {name}")
        for place in places:
            place.mkdir(exist_ok=True)
        return
    if laboratory is None:
        message = f"{name} has no laboratory that would record it"
        raise ConfigError(message, key="dataset.laboratory")
    with contracts.replacing(places[0]) as folder, contracts.replacing(places[1]) as truth:
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
    opened = session.open_session(nominal, dataset.laboratory["dynamics"], stream)
    set_up = _in_plane if dataset.robot.plane else _in_space
    instruments = set_up(opened, dataset, stream, folder)
    record = partial(_record_take, opened=opened, settings=settings, instruments=instruments)
    rows = list(run_trials(record, takes, compute=settings.compute, label="record: takes"))
    rows = rows[scale.test_takes :] + rows[: scale.test_takes]
    joints = pd.concat([joints for joints, _ in rows], ignore_index=True)
    contracts.write(joints, "true_joints", truth)
    if clocks := [clock for _, clock in rows if clock]:
        contracts.write(pd.DataFrame(clocks), "true_clock", truth)


def _record_take(
    take: tuple[str, int], opened: Session, settings, instruments: Instruments
) -> tuple[pd.DataFrame, dict | None]:
    """The files of one take; its true joint angles and, where it has depth images, its clock."""
    (kind, number), dataset, laboratory = take, settings.dataset, settings.dataset.laboratory
    name, part = f"{kind}_{number + 1:03d}", "training" if kind == "train" else "test"
    stream = rng.stream(settings.seed, f"record.{kind}", number)
    motion = session.perform(opened, laboratory["trajectory"], laboratory["dynamics"], stream)
    offset = instruments(name, part, motion, stream)
    k = np.arange(len(motion.truth))
    step = {"take": name, "part": part, "k": k, "t": k / dataset.motion.rate}
    joints = pd.DataFrame(step | spread("q", dataset.robot.joints, motion.truth))
    return joints, None if offset is None else {"take": name, "part": part, "offset": offset}


def _in_plane(opened: Session, dataset, stream: np.random.Generator, folder: Path) -> Instruments:
    """Markers on the links of a planar arm, and a depth camera."""
    k = dataset.laboratory["kinect"]
    template = np.array([list(link.values()) for link in dataset.mocap.markers.values()])
    markers = mocap.place_markers(template, dataset.laboratory["mocap"], stream)
    bias = draw_bias(k, stream)
    for place in ("optitrack", "kinect"):
        (folder / place).mkdir()
    _write_command(opened, dataset, folder, desired_trajectory)
    camera = Intrinsics(k.fx, k.fy, k.cx, k.cy, k.width, k.height)
    write_intrinsics(folder / "kinect" / "intrinsics.yaml", camera)
    arm = replace(arm_of(dataset.robot), chain=opened.chain)
    parts = {"arm": arm, "markers": markers, "bias": bias}
    return partial(_write_in_plane, dataset=dataset, folder=folder, **parts)


def _write_in_plane(
    name: str, part: str, motion: PerformedMotion, stream, *, arm, markers, bias, dataset, folder
) -> float | None:
    laboratory = dataset.laboratory
    duration, options = laboratory["trajectory"].duration, laboratory["mocap"]
    frames = session.depth_frames(motion.swing, duration, laboratory["clock"], stream)
    world = (*_base(dataset), options, stream)
    observed = mocap.capture(arm, motion.motion_capture, markers, *world)
    _write_take(name, observed, {}, dataset, folder)
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


def _in_space(opened: Session, dataset, stream: np.random.Generator, folder: Path) -> Instruments:
    """Rigid bodies on the links of any arm, and its controller's log."""
    o = dataset.mocap
    if {*o.bodies} != {*o.markers}:
        message = "the laboratory follows rigid bodies: every link of markers needs its body"
        raise ConfigError(message, key="dataset.mocap.bodies")
    chains, clusters = link_chains(dataset.robot, o.markers, "dataset.mocap.markers"), {}
    for link, body in o.bodies.items():
        drawn = np.array(list(o.markers[link].values()))
        clusters[body.name] = mocap.MarkerCluster(
            chain=mocap.as_built(chains[link], opened.chain),
            places=mocap.place_markers(drawn, dataset.laboratory["mocap"], stream),
            shape=mocap.in_body(drawn, body.mount.position, body.mount.rpy),
        )
    for place in ("optitrack", "joints"):
        (folder / place).mkdir()
    _write_command(opened, dataset, folder)
    return partial(_write_in_space, clusters=clusters, dataset=dataset, folder=folder)


def _write_in_space(
    name: str, part: str, motion: PerformedMotion, stream, *, clusters, dataset, folder
) -> None:
    laboratory, world = dataset.laboratory, _base(dataset)
    captured = (clusters, motion.motion_capture, world, laboratory["mocap"], stream)
    poses = mocap.capture_bodies(*captured)
    bodies = {body: RigidBody(*pose) for body, pose in poses.items()}
    _write_take(name, {}, bodies, dataset, folder)
    log = session.log_joints(motion.swing, laboratory["trajectory"], laboratory["encoders"])
    write_joint_table(folder / "joints" / f"{name}.csv", *log, dataset.robot.joints)


def _write_command(
    opened: Session, dataset, folder: Path, trajectory: Callable | None = None
) -> None:
    """The commanded joint angles, behind the columns of a ``trajectory``, or of the time alone."""
    options = dataset.laboratory["trajectory"]
    path = desired_path(opened.nominal, options)
    time = pd.DataFrame({"t": np.arange(len(path)) / dataset.motion.rate})
    table = time if trajectory is None else trajectory(opened.nominal, options)
    table = table.assign(**spread("q", dataset.robot.joints, path))
    write_trajectory(folder / "trajectory.csv", table)


def _base(dataset) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position of the arm's base in the motion capture's world."""
    base = dataset.mocap.base
    return Rotation.from_euler("xyz", base.rpy).as_matrix(), np.array(base.position)


def _write_take(name: str, markers: dict, bodies: dict, dataset, folder: Path) -> None:
    """The take as Motive exports it."""
    frame, rate = np.arange(dataset.motion.steps + 1), dataset.motion.rate
    take = MotionTake(name, "1.23", rate, frame, frame / rate, markers, bodies, {})
    write_motive(folder / "optitrack" / f"{name}.csv", take, start=STARTED)


def _record_forces(folder: Path, settings) -> None:
    """The force records, as the transducer's own program logs them."""
    laboratory, force = settings.dataset.laboratory, settings.dataset.force
    transducer, seconds = laboratory["transducer"], settings.scale.force_seconds
    for number, c in enumerate(force.configurations.values()):
        robots = laboratory["robots"].first(len(c.tension))
        cables = Cables(c.tension, c.direction, c.elevation, c.attachment)
        stream = rng.stream(settings.seed, "record.force", number)
        felt = record_force(cables, robots, transducer, force.tare, seconds, stream)
        wrench, rate = (felt.time, felt.force, felt.torque), transducer.rate
        (file := folder / c.file).parent.mkdir(parents=True, exist_ok=True)
        write_daqft(file, ForceRecord(*wrench, rate, "FT00001", STARTED, {}))
