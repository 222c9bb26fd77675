"""``python -m pipeline view [TAKE]``: write a take as a file of the viewer Rerun, with arm, point
cloud, and measured and filtered joint angles over time.
"""

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.model import arm_of, link_chains
from pipeline.arm.urdf import describe
from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.columns import matrices, values
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import Robot
from pipeline.recordings.depth_takes import arm_points

HERE = Path(__file__).parent
FOLDER = Path("data/view")
ENVIRONMENT = Path(".venv-view")
TRACK = Path("data/track")
FILTER = Path("data/filter")
ARTICULATE = Path("data/articulate")
DEPTH = Path("data/ingest/depth")
MEASURED = (40, 40, 40)
COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0))
# time (s) and points (I, 3) m of each depth frame
Clouds = list[tuple[float, np.ndarray]]


class Track(NamedTuple):
    """Joint angles over time: ``t`` (K,) s, ``q`` (K, n) rad or m, ``std`` (K, n) or None."""

    t: np.ndarray
    q: np.ndarray
    std: np.ndarray | None = None


def run(take: str | None = None, open: bool = False) -> None:
    """Write data/view/DATASET_TAKE.rrd, and ``open`` it. Raises ConfigError for an unknown take."""
    rerun = _rerun()
    settings = config.sections("view", HERE / "reads.yaml")
    robot = settings.dataset.robot
    joints = contracts.read("joints", TRACK)
    # test before training
    name = take or joints.sort_values("part", kind="stable")["take"].iloc[0]
    measured = joints[joints["take"] == name]
    if measured.empty:
        names = ", ".join(joints["take"].unique())
        raise ConfigError(f"no take {name!r}; there are {names}", key="TAKE")
    tracks = {"measured": Track(measured["t"].to_numpy(), values(measured, "q"))}
    for model in settings.models:
        if contracts.exists("posterior", FILTER / model):
            posterior = contracts.read("posterior", FILTER / model)
            rows = posterior[posterior["take"] == name]
            if len(rows):
                tracks[model] = _filtered_track(rows, robot.joints)
    clouds = []
    if settings.dataset.depth is not None:
        clouds = _clouds(name, robot)
    file = FOLDER / f"{settings.dataset.name}_{name}.rrd"
    file.parent.mkdir(parents=True, exist_ok=True)
    write_recording(rerun, file, name, robot, tracks, clouds)
    print(f"view: wrote {file}; `python -m pipeline view {name} --open` shows it")
    if open:
        viewer = rerun.RecordingStream(settings.dataset.name)
        viewer.spawn()
        viewer.log_file_from_path(file)


def _filtered_track(rows: pd.DataFrame, joints: Sequence[str]) -> Track:
    """Return mean and standard deviation of a take's ``rows`` of the table posterior."""
    covariance = matrices(rows, "c", joints)
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return Track(rows["t"].to_numpy(), values(rows, "m"), std)


def _rerun() -> ModuleType:
    """Return the module rerun, from this environment or else the environment of `make view`."""
    sys.path += map(str, ENVIRONMENT.glob("lib/python*/site-packages"))
    try:
        return importlib.import_module("rerun")
    except ModuleNotFoundError:
        raise PipelineError("rerun-sdk is not installed; run `make view`") from None


def _clouds(name: str, robot: Robot) -> Clouds:
    """Return time on the motion capture's clock and arm points of every depth frame of a take."""
    angles = contracts.read("angles", ARTICULATE)
    angles = angles[angles["take"] == name]
    frames = contracts.read("frames", DEPTH)
    frames = frames[frames["take"] == name]
    times = dict(zip(angles["frame"], angles["t"], strict=True))
    points = dict(zip(frames["frame"], arm_points(frames, DEPTH), strict=True))
    arm = arm_of(robot)
    clouds = []
    for frame in sorted(times.keys() & points.keys()):
        in_plane = np.insert(points[frame], 1, 0.0, axis=1)  # y = 0
        clouds.append((times[frame], arm.to_base(in_plane)))
    return clouds


def skeletons(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Return base, joint origins and tip (K, L, 3), m in the base frame, at ``q`` (K, n)."""
    described = describe(robot)
    tree = described.tree
    links = [tree.children[name] for name in robot.joints]
    links = dict.fromkeys([*links, described.tip])  # each link once
    chains = link_chains(robot, links, "robot.joints")
    nodes = [np.zeros((len(q), 3))]  # the base
    for chain in chains.values():
        # the joints that move a link are the first ones of the arm
        poses = chain.pose(q[:, : len(chain.lower)])
        nodes.append(poses[:, :3])
    return np.stack(nodes, axis=1)


def write_recording(
    rerun: ModuleType,
    file: Path,
    take: str,
    robot: Robot,
    tracks: dict[str, Track],
    clouds: Clouds,
) -> None:
    """Write an .rrd file whose layout shows the scene and one plot per joint."""
    blueprint = importlib.import_module("rerun.blueprint")
    recording = rerun.RecordingStream("manipulator-uncertainty")
    plots = [
        blueprint.TimeSeriesView(
            origin=rerun.new_entity_path(["angles", joint]),
            name=joint,
        )
        for joint in robot.joints
    ]
    scene = blueprint.Spatial3DView(origin="scene", name=take)
    layout = blueprint.Horizontal(scene, blueprint.Vertical(*plots))
    recording.save(file, default_blueprint=blueprint.Blueprint(layout))
    for (name, track), colour in zip(
        tracks.items(),
        (MEASURED, *COLOURS),
        strict=False,
    ):
        for t, nodes in zip(track.t, skeletons(robot, track.q), strict=True):
            recording.set_time("time", duration=float(t))
            strip = rerun.LineStrips3D([nodes], colors=[colour], radii=[0.004])
            recording.log(rerun.new_entity_path(["scene", name]), strip)
        lines = [("mean", name, 2.0, track.q)]
        if track.std is not None:
            lines += [("upper", f"{name} + 1σ", 0.7, track.q + track.std)]
            lines += [("lower", f"{name} − 1σ", 0.7, track.q - track.std)]
        time = rerun.TimeColumn("time", duration=track.t)
        for j, joint in enumerate(robot.joints):
            for curve, label, width, line in lines:
                place = rerun.new_entity_path(["angles", joint, name, curve])
                style = rerun.SeriesLines(
                    colors=[colour],
                    names=[label],
                    widths=[width],
                )
                recording.log(place, style, static=True)
                recording.send_columns(
                    place,
                    [time],
                    rerun.Scalars.columns(scalars=line[:, j]),
                )
    for t, points in clouds:
        recording.set_time("time", duration=float(t))
        recording.log("scene/cloud", rerun.Points3D(points, radii=[0.002]))
    recording.flush()
    recording.disconnect()
