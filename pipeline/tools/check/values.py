"""Faults of a dataset's values that show before any recording is read: types and ranges, the robot,
and files that are not there.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

from pipeline.arm.model import chain_of
from pipeline.arm.urdf import read_urdf
from pipeline.core.datasheet import unfilled_keys
from pipeline.core.draft import faults
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.core.options.dataset import Robot
from pipeline.formats.format import matching

# keys that hold a path or a pattern below the recordings
PATHS = (
    *("trajectory", "mocap.training", "mocap.test", "encoders.training", "encoders.test"),
    *("joint_log.movements", "depth.takes", "depth.intrinsics", "force.log.calibration"),
)
IN_EACH_MOVEMENT = ("actual", "target", "speed")


def value_faults(values: dict[str, Any]) -> list[PipelineError]:
    """Return all faults of the ``values`` that are filled in."""
    refused = faults(values)
    sound = deepcopy(values)
    for fault in refused:
        *above, name = str(fault.evidence["key"]).removeprefix("dataset.").split(".")
        node: Any = sound
        for part in above:
            node = node.get(part) if isinstance(node, dict) else None
        if isinstance(node, dict):
            node.pop(name, None)
    return [*refused, *_robot(sound), *_files(sound)]


def get_filled(values: dict[str, Any], key: str) -> Any:
    """Return the value of a nested ``key``, None where it is missing or still ???."""
    node: Any = values
    for part in key.split("."):
        node = node.get(part) if isinstance(node, dict) else None
    return None if node is None or [*unfilled_keys(node)] else node


def _robot(values: dict[str, Any]) -> Iterator[PipelineError]:
    try:
        if urdf := get_filled(values, "robot.urdf"):
            read_urdf(Path(urdf))
        if robot := get_filled(values, "robot"):
            chain_of(Robot(**robot))
    except PipelineError as error:
        yield error
    logged, joints = get_filled(values, "joint_log.joints"), get_filled(values, "robot.joints")
    if logged and (missing := [joint for joint in joints or [] if joint not in logged]):
        yield ConfigError(
            f"{', '.join(missing)} of robot.joints is not logged; the log holds "
            f"{', '.join(logged)}",
            key="dataset.joint_log.joints",
        )


def _files(values: dict[str, Any]) -> Iterator[PipelineError]:
    if not (recordings := get_filled(values, "recordings")):
        return
    folder = Path(recordings)
    if not folder.is_dir():
        yield RecordingError("no such folder", file=folder, key="dataset.recordings")
        return
    patterns = {key: get_filled(values, key) for key in PATHS}
    for name, configuration in (get_filled(values, "force.configurations") or {}).items():
        patterns[f"force.configurations.{name}.file"] = configuration.get("file")
    for key, pattern in patterns.items():
        try:
            matched = matching(folder, pattern, key=f"dataset.{key}") if pattern else None
        except ConfigError as error:
            yield error
            continue
        if matched == []:
            message = f"no file or folder in {folder.as_posix()} is named {pattern}"
            yield RecordingError(message, key=f"dataset.{key}")
        if key == "joint_log.movements":
            yield from _in_movements(values, [path for path in matched or [] if path.is_dir()])


def _in_movements(values: dict[str, Any], folders: list[Path]) -> Iterator[PipelineError]:
    for signal in IN_EACH_MOVEMENT:
        name = get_filled(values, f"joint_log.{signal}")
        if name and (without := [path for path in folders if not (path / name).is_file()]):
            others = f", nor do {len(without) - 1} others" if len(without) > 1 else ""
            message = f"{without[0].as_posix()} does not hold {name}{others}"
            yield RecordingError(message, key=f"dataset.joint_log.{signal}")
