"""What is wrong with the files that the values of a dataset name, as far as a glance at them
shows: folders, patterns, and the robot.
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
from pipeline.formats.patterns import matching

# keys that hold a path or a pattern below the recordings
NAMED = (
    "trajectory",
    "mocap.training",
    "mocap.test",
    "encoders.training",
    "encoders.test",
    "joint_log.movements",
    "depth.takes",
    "depth.intrinsics",
    "force.log.calibration",
)
IN_EACH_MOVEMENT = ("actual", "target", "speed")


def wrong(values: dict[str, Any]) -> list[PipelineError]:
    """Everything that is wrong with the ``values`` that are there, but for what the recordings
    hold.
    """
    refused = faults(values)
    sound = deepcopy(values)
    for fault in refused:
        _drop(sound, str(fault.evidence["key"]).removeprefix("dataset."))
    return [*refused, *_robot(sound), *_files(sound)]


def _drop(values: dict[str, Any], key: str) -> None:
    *above, name = key.split(".")
    for part in above:
        values = values.get(part) if isinstance(values, dict) else None
    if isinstance(values, dict):
        values.pop(name, None)


def held(values: dict[str, Any], key: str) -> Any:
    """The value of a nested ``key``, None where it is not there or still ???."""
    node: Any = values
    for part in key.split("."):
        node = node.get(part) if isinstance(node, dict) else None
    return None if node is None or [*unfilled_keys(node)] else node


def _robot(values: dict[str, Any]) -> Iterator[PipelineError]:
    try:
        if urdf := held(values, "robot.urdf"):
            read_urdf(Path(urdf))
        if robot := held(values, "robot"):
            chain_of(Robot(**robot))
    except PipelineError as error:
        yield error
    logged, joints = held(values, "joint_log.joints"), held(values, "robot.joints")
    if logged and (missing := [joint for joint in joints or [] if joint not in logged]):
        yield ConfigError(
            f"{', '.join(missing)} of robot.joints is not logged; the log holds "
            f"{', '.join(logged)}",
            key="dataset.joint_log.joints",
        )


def _files(values: dict[str, Any]) -> Iterator[PipelineError]:
    if not (recordings := held(values, "recordings")):
        return
    folder = Path(recordings)
    if not folder.is_dir():
        yield RecordingError("there is no such folder", file=folder, key="dataset.recordings")
        return
    named = {key: held(values, key) for key in NAMED}
    for name, configuration in (held(values, "force.configurations") or {}).items():
        named[f"force.configurations.{name}.file"] = configuration.get("file")
    for key, pattern in named.items():
        if not pattern:
            continue
        try:
            matched = matching(folder, pattern, key=f"dataset.{key}")
        except ConfigError as error:
            yield error
            continue
        if not matched:
            yield RecordingError(
                f"nothing in {folder.as_posix()} is named {pattern}", key=f"dataset.{key}"
            )
        if key == "joint_log.movements":
            yield from _in_movements(values, [path for path in matched if path.is_dir()])


def _in_movements(values: dict[str, Any], folders: list[Path]) -> Iterator[PipelineError]:
    for signal in IN_EACH_MOVEMENT:
        name = held(values, f"joint_log.{signal}")
        if name and (without := [path for path in folders if not (path / name).is_file()]):
            others = f", nor do {len(without) - 1} others" if len(without) > 1 else ""
            yield RecordingError(
                f"{without[0].as_posix()} does not hold {name}{others}",
                key=f"dataset.joint_log.{signal}",
            )
