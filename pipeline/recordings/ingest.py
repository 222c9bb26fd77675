"""Raw logs of a dataset → tables in SI units in a folder, part by part: motion, depth, force."""

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
from pipeline.recordings.quality import REPETITIONS


def read_part(
    part: str,
    dataset: Dataset,
    compute: Any,
    folder: Path,
    errors: list[PipelineError] | None = None,
) -> list[dict]:
    """Write the tables of ``part`` (motion, depth or force) into ``folder``, within the bounds of
    ``dataset.reading``, and return the rows of the table quality.
    """
    read = {"motion": _motion, "depth": partial(_depth, compute=compute), "force": _force}[part]
    found: list[PipelineError] = []
    quality = within(dataset.reading, read, dataset, Path(dataset.recordings), folder, found)
    if errors is not None:
        errors += found
        return quality
    if found:
        raise found[0]
    for row in quality:
        if row["quantity"] == REPETITIONS or row["unit"] == "row":
            print(f"ingest: {row['take']}: {row['quantity'].replace('_', ' ')} {row['value']:.0f}")
    return quality


def attempt(function: Callable, *arguments: Any) -> Any:
    """Return ``function(*arguments)``, or the PipelineError that it raises."""
    try:
        return function(*arguments)
    except PipelineError as error:
        return error


def _kept(results: Iterable[Any], errors: list[PipelineError]) -> list[Any]:
    """The ``results`` without the errors among them, which are appended to ``errors``."""
    results = list(results)
    errors += [result for result in results if isinstance(result, PipelineError)]
    return [result for result in results if not isinstance(result, PipelineError)]


def _write(takes: list[Any], name: str, folder: Path) -> list[dict]:
    """Write the table ``name`` of the takes' rows; the rows of their quality."""
    if takes:
        contracts.write(pd.concat([rows for rows, _ in takes], ignore_index=True), name, folder)
    return [row for _, rows in takes for row in rows]


def _motion(dataset: Dataset, raw: Path, folder: Path, errors: list) -> list[dict]:
    from pipeline.arm.model import chain_of
    from pipeline.recordings import joint_logs, motion_capture

    quality = []
    if dataset.joint_log is not None:
        known, chain = len(errors), chain_of(dataset.robot)
        rows = _kept([attempt(joint_logs.joint_log_rows, raw, dataset, chain)], errors)
        for trajectory, joints, counts in rows:
            contracts.write(trajectory, "trajectory", folder)
            contracts.write(joints, "joint_log", folder)
            quality += counts
        if not rows:  # every movement's refusals, not the first alone
            for movements in _kept([attempt(joint_logs.find_movements, raw, dataset)], []):
                read, every = joint_logs.read_dataset_movement, []
                _kept((attempt(read, *one, dataset) for one in movements.items()), every)
                errors[known:] = every or errors[known:]
    if dataset.trajectory is not None:
        read = motion_capture.trajectory_rows, raw / dataset.trajectory, dataset
        for table in _kept([attempt(*read)], errors):
            contracts.write(table, "trajectory", folder)
    if dataset.mocap is not None:
        for takes in _kept([attempt(motion_capture.find_takes, raw, dataset.mocap)], errors):
            read = (attempt(motion_capture.marker_rows, *take, dataset) for take in takes)
            quality += _write(_kept(read, errors), "markers", folder)
    if dataset.encoders is not None:
        for takes in _kept([attempt(joint_logs.encoder_rows, raw, dataset)], errors):
            quality += _write(takes, "encoders", folder)
    return quality


def _depth(dataset: Dataset, raw: Path, folder: Path, errors: list, compute: Any) -> list[dict]:
    """The time of every depth frame on the camera's clock, and the arm's points."""
    if dataset.depth is None:
        return []
    if dataset.mocap is None:
        message = "a depth camera needs the motion capture that its clock is set by"
        errors.append(ConfigError(message, key="dataset.depth"))
        return []
    from pipeline.arm.model import arm_of
    from pipeline.recordings.depth import frame_rows, take_paths

    arm, rows = arm_of(dataset.robot), []
    read = partial(frame_rows, depth=dataset.depth, arm=arm, raw=raw, folder=folder.resolve())
    # workers do not share the bounds of this process
    bounded, label = partial(attempt, within, dataset.reading, read), "ingest: depth takes"
    for takes in _kept([attempt(take_paths, raw, dataset.depth)], errors):
        rows = run_trials(bounded, list(takes.items()), compute=compute, label=label)
    return _write(_kept(rows, errors), "frames", folder)


def _force(dataset: Dataset, raw: Path, folder: Path, errors: list) -> list[dict]:
    from pipeline.recordings.force import force_rows

    if dataset.force is None:
        return []
    names = dataset.force.configurations
    read = (attempt(force_rows, raw, name, dataset.force) for name in names)
    return _write(_kept(read, errors), "force", folder)
