"""record@dataset: raw files of the synthetic laboratory, and the truth for the stage score."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import Chain
from pipeline.arm.model import Arm, arm_of, chain_of, link_chains
from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.columns import spread
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError
from pipeline.formats.depth.image import write_depth, write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.force.daqft import ForceRecord, write_daqft
from pipeline.formats.joints.table import write_joint_table
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.motion.take import MotionTake, RigidBody
from pipeline.formats.trajectory import write_trajectory
from pipeline.laboratory import dynamics, mocap
from pipeline.laboratory.dynamics import (
    DepthFrames,
    Session,
    desired_path,
    desired_trajectory,
)
from pipeline.laboratory.force import record_force
from pipeline.laboratory.kinect import DepthCamera, draw_bias

RAW = Path("data/raw")
# start of a capture in Motive's spelling; fixed, so that recordings do not depend on the time
CAPTURE_START = "2017-05-02 10.00.00.000 AM"
PARTS = {"train": "training", "test": "test"}  # by kind of a take


def run(name: str) -> None:
    """Record every take and every force record of the dataset ``name``. Where params.yaml selects
    another dataset, the recordings of ``name`` stay unchanged.
    """
    settings = config.sections("record", RAW / name / "dvc.yaml")
    dataset = settings.dataset
    laboratory = settings.dataset.laboratory
    places = RAW / name / "recordings", RAW / name / "truth"
    if Path(dataset.recordings) != places[0]:
        print(
            f"record: params.yaml selects another dataset; to record {name} set dataset: {name}",
        )
        for place in places:
            place.mkdir(exist_ok=True)
        return
    if laboratory is None:
        message = f"{name} has no synthetic laboratory to record it"
        raise ConfigError(message, key="dataset.laboratory")
    with (
        contracts.replacing(places[0]) as folder,
        contracts.replacing(places[1]) as truth,
    ):
        if dataset.robot is not None:
            _record_takes(settings, folder, truth)
        if "robots" in laboratory and dataset.force is not None:
            _record_forces(folder, settings)


def _record_takes(settings, folder: Path, truth: Path) -> None:
    """Write every take of the motion, and its truth."""
    dataset = settings.dataset
    scale = settings.scale
    # test takes have depth images and take longest: first, so that workers start
    takes = [("test", i) for i in range(scale.test_takes)]
    takes += [("train", i) for i in range(scale.training_takes)]
    # the arm moves with all task rows, even if only some are analysed
    nominal = chain_of(replace(dataset.robot, task=None))
    stream = rng.stream(settings.seed, "record.session")
    session = dynamics.open_session(nominal, dataset.laboratory["dynamics"], stream)
    (folder / "optitrack").mkdir()
    if dataset.robot.plane:
        (folder / "kinect").mkdir()
        instruments = _in_plane(session, dataset, stream)
        k = dataset.laboratory["kinect"]
        camera = Intrinsics(k.fx, k.fy, k.cx, k.cy, k.width, k.height)
        write_intrinsics(folder / "kinect" / "intrinsics.yaml", camera)
    else:
        (folder / "joints").mkdir()
        instruments = _in_space(session, dataset, stream)
    command = _command(nominal, dataset)
    write_trajectory(folder / "trajectory.csv", command)

    record = partial(
        _record_take,
        session=session,
        instruments=instruments,
        settings=settings,
        folder=folder,
    )
    workers = {"compute": settings.compute, "label": "record: takes"}
    rows = list(run_trials(record, takes, **workers))
    joints = rows[scale.test_takes :] + rows[: scale.test_takes]
    contracts.write(pd.concat(joints, ignore_index=True), "true_joints", truth)


def _command(nominal: Chain, dataset) -> pd.DataFrame:
    """Return the commanded trajectory of the ``nominal`` arm."""
    options = dataset.laboratory["trajectory"]
    rate = dataset.motion.rate
    path = desired_path(nominal, options)
    if dataset.robot.plane:
        command = desired_trajectory(nominal, options)
    else:
        command = pd.DataFrame({"t": np.arange(len(path)) / rate})
    return command.assign(**spread("q", dataset.robot.joints, path))


def _in_plane(session: Session, dataset, stream) -> tuple[Arm, np.ndarray, np.ndarray]:
    """Return a planar arm, random places of its markers, and the depth camera's bias."""
    laboratory = dataset.laboratory
    links = [[*link.values()] for link in dataset.mocap.markers.values()]
    template = np.array(links)
    markers = mocap.place_markers(template, laboratory["mocap"], stream)
    bias = draw_bias(laboratory["kinect"], stream)
    arm = replace(arm_of(dataset.robot), chain=session.chain)
    return arm, markers, bias


def _in_space(session: Session, dataset, stream) -> dict[str, mocap.MarkerCluster]:
    """Return by name the rigid bodies on the links of an arm, with random places of markers."""
    o = dataset.mocap
    clusters = {}
    if {*o.bodies} != {*o.markers}:
        message = (
            "the laboratory follows rigid bodies: every link of markers needs its body"
        )
        raise ConfigError(message, key="dataset.mocap.bodies")
    chains = link_chains(dataset.robot, o.markers, "dataset.mocap.markers")
    for link, body in o.bodies.items():
        drawn = np.array(list(o.markers[link].values()))
        clusters[body.name] = mocap.MarkerCluster(
            chain=mocap.as_built(chains[link], session.chain),
            places=mocap.place_markers(drawn, dataset.laboratory["mocap"], stream),
            shape=mocap.in_body(drawn, body.mount.position, body.mount.rpy),
        )
    return clusters


def _record_take(
    take: tuple[str, int],
    session: Session,
    instruments,
    settings,
    folder: Path,
) -> pd.DataFrame:
    """Write the files of one take; return its true joint angles."""
    kind, number = take
    dataset = settings.dataset
    laboratory = settings.dataset.laboratory
    name = f"{kind}_{number + 1:03d}"
    stream = rng.stream(settings.seed, f"record.{kind}", number)
    trajectory = laboratory["trajectory"]
    base = dataset.mocap.base
    motion = dynamics.perform(session, trajectory, laboratory["dynamics"], stream)
    captured = motion.motion_capture
    options = laboratory["mocap"]
    world = Rotation.from_euler("xyz", base.rpy).as_matrix(), np.array(base.position)
    markers = {}
    bodies = {}
    if dataset.robot.plane:
        arm, placed, bias = instruments
        clock = laboratory["clock"]
        frames = dynamics.depth_frames(motion.swing, trajectory.duration, clock, stream)
        markers = mocap.capture(arm, captured, placed, world, options, stream)
        if kind == "test":
            camera = DepthCamera(arm, laboratory["kinect"], bias)
            _write_images(folder / "kinect" / name, camera, frames, stream)
    else:
        poses = mocap.capture_bodies(instruments, captured, world, options, stream)
        bodies = {body: RigidBody(*pose) for body, pose in poses.items()}
        log = dynamics.log_joints(motion.swing, trajectory, laboratory["encoders"])
        write_joint_table(folder / "joints" / f"{name}.csv", *log, dataset.robot.joints)

    k = np.arange(len(motion.truth))
    rate = dataset.motion.rate
    recorded = MotionTake(name, "1.23", rate, k, k / rate, markers, bodies, {})
    write_motive(folder / "optitrack" / f"{name}.csv", recorded, start=CAPTURE_START)
    step = {"take": name, "part": PARTS[kind], "k": k, "t": k / rate}
    return pd.DataFrame(step | spread("q", dataset.robot.joints, motion.truth))


def _write_images(
    folder: Path,
    camera: DepthCamera,
    frames: DepthFrames,
    stream: np.random.Generator,
) -> None:
    """Write the depth images of one take and their index."""
    (folder / "depth").mkdir(parents=True, exist_ok=True)
    files = tuple(f"depth/{i:04d}.png" for i in range(len(frames.times)))
    for file, q in zip(files, frames.joints, strict=True):
        write_depth(folder / file, camera.observe(q, stream))
    write_index(folder / "depth.txt", frames.times, files)


def _record_forces(folder: Path, settings) -> None:
    """Write the force records in the format of the transducer's program."""
    laboratory = settings.dataset.laboratory
    force = settings.dataset.force
    transducer = laboratory["transducer"]
    seconds = settings.scale.force_seconds
    for number, arrangement in enumerate(force.configurations.values()):
        robots = laboratory["robots"].first(len(arrangement.tension))
        stream = rng.stream(settings.seed, "record.force", number)
        felt = record_force(
            arrangement,
            robots,
            transducer,
            force.tare,
            seconds,
            stream,
        )
        record = ForceRecord(
            felt.time,
            felt.force,
            felt.torque,
            transducer.rate,
            "FT00001",
            CAPTURE_START,
            {},
        )
        file = folder / arrangement.file
        file.parent.mkdir(parents=True, exist_ok=True)
        write_daqft(file, record)
