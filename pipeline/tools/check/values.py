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
from pipeline.formats.patterns import matching

# keys that hold a path or a pattern below the recordings
PATHS = (
    *("trajectory", "mocap.training", "mocap.test", "encoders.training", "encoders.test"),
    *("joint_log.movements", "depth.takes", "depth.intrinsics", "force.log.calibration"),
)


def value_faults(values: dict[str, Any]) -> list[PipelineError]:
    """Return all faults of the ``values`` that are filled in."""
    refused = faults(values)
    sound = deepcopy(values)
    for fault in refused:
        *above, name = str(fault.evidence["key"]).removeprefix("dataset.").split(".")
        node = get_filled(sound, ".".join(above), whole=False) if above else sound
        if isinstance(node, dict):
            node.pop(name, None)
    return [*refused, *_robot(sound), *_files(sound)]


def get_filled(values: Any, key: str, *, whole: bool = True) -> Any:
    """Return the value of a nested ``key``, None where it is missing or, of a ``whole`` one, where
    anything below it is still ???.
    """
    node: Any = values
    for part in key.split("."):
        node = node.get(part) if isinstance(node, dict) else None
    return None if node is None or (whole and [*unfilled_keys(node)]) else node


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
        message = f"{', '.join(missing)} of robot.joints is not logged; the log holds"
        yield ConfigError(f"{message} {', '.join(logged)}", key="dataset.joint_log.joints")


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
            if pattern and not matching(folder, pattern, key=f"dataset.{key}"):
                message = f"no file or folder in {folder.as_posix()} is named {pattern}"
                yield RecordingError(message, key=f"dataset.{key}")
        except ConfigError as error:
            yield error
