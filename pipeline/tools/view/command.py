"""``python -m pipeline view [TAKE]``: take in the viewer Rerun: arm, point cloud, and measured and
filtered joint angles over time.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from pipeline.arm.model import arm_of, link_chains
from pipeline.arm.urdf import describe
from pipeline.core import config, contracts
from pipeline.core.columns import matrices, members, values
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import Robot
from pipeline.recordings.depth_angles import arm_points

HERE, FOLDER, ENVIRONMENT = Path(__file__).parent, Path("data/view"), Path(".venv-view")
TRACK, FILTER, ARTICULATE, DEPTH = map(
    Path, ("data/track", "data/filter", "data/articulate", "data/ingest/depth")
)
MEASURED = (40, 40, 40)
COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0))


TO = f"output file (default {FOLDER}/DATASET_TAKE.rrd)"
ARGUMENTS = {
    "take": {"nargs": "?", "metavar": "TAKE", "help": "take's name (default the first test take)"},
    "--to": {"type": Path, "metavar": "FILE", "help": TO},
    "--open": {"action": "store_true", "help": "viewer that shows the file"},
}


class Track(NamedTuple):
    """Joint angles over time: ``t`` (K,) s, ``q`` (K, n) rad or m, ``std`` (K, n) or None."""

    t: np.ndarray
    q: np.ndarray
    std: np.ndarray | None = None


class ViewedTake(NamedTuple):
    """Tracks of a take, measured and by model, and time (s) and points (I, 3) m of each frame."""

    name: str
    robot: Robot
    joints: list[str]
    measured: Track
    filtered: dict[str, Track]
    clouds: list[tuple[float, np.ndarray]]


def run(take: str | None = None, to: Path | None = None, open: bool = False) -> None:
    """Write the take to an .rrd file, and open it where that was asked for."""
    rerun = _rerun()
    settings = config.sections("view", HERE / "reads.yaml")
    viewed = read_viewed_take(settings, take)
    file = to or FOLDER / f"{settings.dataset.name}_{viewed.name}.rrd"
    file.parent.mkdir(parents=True, exist_ok=True)
    write_recording(rerun, viewed, file)
    print(f"view: wrote {file}; `python -m pipeline view {viewed.name} --open` shows it")
    if open:
        viewer = rerun.RecordingStream(settings.dataset.name)
        viewer.spawn()
        viewer.log_file_from_path(file)


def _rerun() -> ModuleType:
    """Import rerun, from the environment of `make view` where this one lacks it."""
    sys.path += map(str, ENVIRONMENT.glob("lib/python*/site-packages"))
    try:
        return importlib.import_module("rerun")
    except ModuleNotFoundError:
        raise PipelineError("rerun-sdk is not installed; run `make view`") from None


def read_viewed_take(settings: Any, name: str | None) -> ViewedTake:
    """Read the take ``name``, else the first test take; ConfigError for an unknown name."""
    joints = contracts.read("joints", TRACK)
    if name is None:
        name = joints.sort_values("part", kind="stable")["take"].iloc[0]  # test before training
    own = joints[joints["take"] == name]
    if own.empty:
        names = ", ".join(joints["take"].unique())
        raise ConfigError(f"no take {name!r}; there are {names}", key="TAKE")
    names, filtered = members(joints, "q"), {}
    for folder in (FILTER / model for model in settings.models):
        if contracts.exists("posterior", folder):
            rows = contracts.read("posterior", folder).query("take == @name")
            std = np.sqrt(np.diagonal(matrices(rows, "c", names), axis1=-2, axis2=-1))
            filtered[folder.name] = Track(rows["t"].to_numpy(), values(rows, "m"), std)
    filtered = {model: track for model, track in filtered.items() if len(track.t)}
    robot = settings.dataset.robot
    clouds = _clouds(name, robot) if settings.dataset.depth is not None else []
    measured = Track(own["t"].to_numpy(), values(own, "q"))
    return ViewedTake(name, robot, list(names), measured, filtered, clouds)


def _clouds(name: str, robot: Robot) -> list[tuple[float, np.ndarray]]:
    """Points of the arm in every depth frame of a take, at the motion capture's time."""
    angles, frames = contracts.read("angles", ARTICULATE), contracts.read("frames", DEPTH)
    angles, frames = (table[table["take"] == name] for table in (angles, frames))
    arm, times = arm_of(robot), dict(zip(angles["frame"], angles["t"], strict=True))
    points = dict(zip(frames["frame"], arm_points(frames, DEPTH), strict=True))
    return [
        (times[frame], arm.to_base(np.insert(points[frame], 1, 0.0, axis=1)))
        for frame in sorted(times.keys() & points.keys())
    ]


def skeletons(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Return the arm's points (K, L, 3), m in the base frame, at the joint angles ``q`` (K, n):
    base, origin of each joint, tip.
    """
    described = describe(robot)
    links = dict.fromkeys([*(joint.child for joint in described.joints), described.tip])
    chains = link_chains(robot, links, "robot.joints")
    # the joints that move a link are the first ones of the arm
    nodes = [chain.pose(q[:, : len(chain.lower)])[:, :3] for chain in chains.values()]
    return np.stack([np.zeros_like(nodes[0]), *nodes], axis=1)


def write_recording(rerun: ModuleType, take: ViewedTake, file: Path) -> None:
    """Write ``take`` as an .rrd file with its layout: the scene beside a plot of each joint."""
    blueprint = importlib.import_module("rerun.blueprint")
    recording = rerun.RecordingStream("manipulator-uncertainty")
    plots = [
        blueprint.TimeSeriesView(origin=rerun.new_entity_path(["angles", joint]), name=joint)
        for joint in take.joints
    ]
    scene = blueprint.Spatial3DView(origin="scene", name=take.name)
    layout = blueprint.Horizontal(scene, blueprint.Vertical(*plots))
    recording.save(file, default_blueprint=blueprint.Blueprint(layout))
    tracks = {"measured": take.measured} | take.filtered
    for (name, track), colour in zip(tracks.items(), (MEASURED, *COLOURS), strict=False):
        for t, nodes in zip(track.t, skeletons(take.robot, track.q), strict=True):
            recording.set_time("time", duration=float(t))
            strip = rerun.LineStrips3D([nodes], colors=[colour], radii=[0.004])
            recording.log(rerun.new_entity_path(["scene", name]), strip)
        time = rerun.TimeColumn("time", duration=track.t)
        for j, joint in enumerate(take.joints):
            q, std = track.q[:, j], None if track.std is None else track.std[:, j]
            lines = [("mean", name, 2.0, q)]
            if std is not None:
                lines += [("upper", f"{name} + 1σ", 0.7, q + std)]
                lines += [("lower", f"{name} − 1σ", 0.7, q - std)]
            for part, label, width, line in lines:
                place = rerun.new_entity_path(["angles", joint, name, part])
                style = rerun.SeriesLines(colors=[colour], names=[label], widths=[width])
                recording.log(place, style, static=True)
                recording.send_columns(place, [time], rerun.Scalars.columns(scalars=line))
    for t, points in take.clouds:
        recording.set_time("time", duration=float(t))
        recording.log("scene/cloud", rerun.Points3D(points, radii=[0.002]))
    recording.flush()
    recording.disconnect()
