"""Raw logs of a dataset → tables in SI units in a folder, part by part: motion, depth, force.

Without a list of ``errors`` the first refusal is raised; with one, all are appended to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.core import contracts
from pipeline.core.bounds import within
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import Dataset

Errors = list[PipelineError] | None


def read_part(
    part: str, dataset: Dataset, compute: Any, folder: Path, errors: Errors = None
) -> list[dict]:
    """Write the tables of ``part`` (motion, depth or force) into ``folder``, within the bounds of
    ``dataset.reading``, and return the rows of the table quality.
    """
    read = {"motion": _motion, "depth": partial(_depth, compute=compute), "force": _force}[part]
    return within(dataset.reading, read, dataset, Path(dataset.recordings), folder, errors)


def attempt(function: Callable, *arguments: Any) -> Any:
    """Return ``function(*arguments)``, or the PipelineError that it raises."""
    try:
        return function(*arguments)
    except PipelineError as error:
        return error


def _kept(results: Iterable[Any], errors: Errors) -> list[Any]:
    """The ``results`` without their errors, which are appended or, of the first, raised."""
    results = list(results)
    refused = [result for result in results if isinstance(result, PipelineError)]
    if refused and errors is None:
        raise refused[0]
    if errors is not None:
        errors += refused
    return [result for result in results if not isinstance(result, PipelineError)]


def _motion(dataset: Dataset, raw: Path, folder: Path, errors: Errors) -> list[dict]:
    from pipeline.recordings import joint_logs, motion_capture

    quality = []
    if dataset.joint_log is not None:
        quality = _joint_log(dataset, raw, folder, errors)
    if dataset.trajectory is not None:
        file = raw / dataset.trajectory
        for table in _kept([attempt(motion_capture.trajectory_rows, file, dataset)], errors):
            contracts.write(table, "trajectory", folder)
    if dataset.mocap is not None:
        for takes in _kept([attempt(motion_capture.find_takes, raw, dataset.mocap)], errors):
            read = (attempt(motion_capture.marker_rows, *take, dataset) for take in takes)
            quality += _write(read, "markers", folder, errors)
    if dataset.encoders is not None:
        for takes in _kept([attempt(joint_logs.encoder_rows, raw, dataset)], errors):
            quality += _write(takes, "encoders", folder, errors)
    return quality


def _joint_log(dataset: Dataset, raw: Path, folder: Path, errors: Errors) -> list[dict]:
    from pipeline.arm.model import chain_of
    from pipeline.recordings import joint_logs
    from pipeline.recordings.quality import REPETITIONS

    if errors is not None:  # every movement's refusals, not the first alone
        known = len(errors)
        for movements in _kept([attempt(joint_logs.find_movements, raw, dataset)], errors):
            read = joint_logs.read_dataset_movement
            _kept((attempt(read, *one, dataset) for one in movements.items()), errors)
        if len(errors) > known:
            return []
    rows = attempt(joint_logs.joint_log_rows, raw, dataset, chain_of(dataset.robot))
    for trajectory, joints, quality in _kept([rows], errors):
        contracts.write(trajectory, "trajectory", folder)
        contracts.write(joints, "joint_log", folder)
        for row in quality if errors is None else []:
            if row["quantity"] == REPETITIONS or row["unit"] == "row":
                quantity = row["quantity"].replace("_", " ")
                print(f"ingest: {row['take']}: {quantity} {row['value']:.0f}")
        return quality
    return []


def _depth(dataset: Dataset, raw: Path, folder: Path, errors: Errors, compute: Any) -> list[dict]:
    """The time of every depth frame on the camera's clock, and the arm's points."""
    if dataset.depth is None:
        return []
    if dataset.mocap is None:
        message = "a depth camera needs the motion capture that its clock is set by"
        return _kept([ConfigError(message, key="dataset.depth")], errors)
    from pipeline.arm.model import arm_of
    from pipeline.recordings.depth import frame_rows, take_paths

    arm = arm_of(dataset.robot)
    read = partial(frame_rows, depth=dataset.depth, arm=arm, raw=raw, folder=folder.resolve())
    # workers do not share the bounds of this process
    bounded = partial(attempt, within, dataset.reading, read)
    for takes in _kept([attempt(take_paths, raw, dataset.depth)], errors):
        label = "ingest: depth takes"
        rows = run_trials(bounded, list(takes.items()), compute=compute, label=label)
        return _write(rows, "frames", folder, errors)
    return []


def _force(dataset: Dataset, raw: Path, folder: Path, errors: Errors) -> list[dict]:
    """Force records without their bias."""
    from pipeline.recordings.force import force_rows

    if dataset.force is None:
        return []
    names = dataset.force.configurations
    read = (attempt(force_rows, raw, name, dataset.force) for name in names)
    return _write(read, "force", folder, errors)


def _write(results: Iterable[Any], name: str, folder: Path, errors: Errors) -> list[dict]:
    """Write the table ``name`` of the takes' rows; the rows of their quality."""
    takes = _kept(results, errors)
    if takes:
        contracts.write(pd.concat([rows for rows, _ in takes], ignore_index=True), name, folder)
    return [row for _, rows in takes for row in rows]
