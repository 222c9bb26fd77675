"""Conversion of a dataset's raw logs to tables in SI units, by part: motion, depth, force."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.core import contracts
from pipeline.core.bounds import within
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import Dataset
from pipeline.recordings.inventory import raw_folder
from pipeline.recordings.quality import REPETITIONS, require_distinct, rounding


def read_part(
    part_name: str,
    dataset: Dataset,
    compute: Any,
    folder: Path,
    errors: list | None = None,
) -> list[dict]:
    """Write the tables of ``part_name`` (motion, depth or force) into ``folder``, within the
    bounds of ``dataset.reading``, and return the rows of the table ``quality``.

    Append all errors to ``errors``; without ``errors``, raise the first error.
    """
    readers = {
        "motion": _motion,
        "depth": partial(_depth, compute=compute),
        "force": _force,
    }
    refused: list[PipelineError] = []
    raw = raw_folder(dataset.recordings)
    quality = within(dataset.reading, readers[part_name], dataset, raw, folder, refused)
    if errors is not None:
        errors += refused
        return quality
    if refused:
        raise refused[0]
    for row in quality:
        if row["quantity"] == REPETITIONS or row["unit"] == "row":
            quantity = row["quantity"].replace("_", " ")
            print(f"ingest: {row['take']}: {quantity} {row['value']:.0f}")
    return quality


def attempt(function: Callable, *arguments: Any) -> Any:
    """Return ``function(*arguments)``, or the PipelineError that it raises."""
    try:
        return function(*arguments)
    except PipelineError as error:
        return error


@contextmanager
def collecting(errors: list[PipelineError]) -> Iterator[None]:
    """Append a PipelineError raised in the context to ``errors``."""
    try:
        yield
    except PipelineError as error:
        errors.append(error)


def _write(takes: list[Any], name: str, folder: Path, errors: list) -> list[dict]:
    """Write the table ``name`` and return the quality rows; append an error for equal takes."""
    tables = []
    parts = {}
    samples = {}
    quality = []
    for rows, quality_of_take in takes:
        take = rows.iloc[0, 0]
        if "part" in rows:
            parts[take] = rows["part"].iloc[0]
        samples[take] = rows.drop(columns="t").select_dtypes("float").to_numpy()
        tables.append(rows)
        quality += quality_of_take
    with collecting(errors):
        require_distinct(name, samples, parts)
    if tables:
        contracts.write(pd.concat(tables, ignore_index=True), name, folder)
    return quality


def _motion(dataset: Dataset, raw: Path, folder: Path, errors: list) -> list[dict]:
    from pipeline.recordings import joint_logs, motion_capture

    quality = []
    takes = []
    encoders = []
    if dataset.joint_log is not None:
        quality += _joint_log(dataset, folder, errors)
    if dataset.trajectory is not None:
        with collecting(errors):
            table = motion_capture.trajectory_rows(raw / dataset.trajectory, dataset)
            contracts.write(table, "trajectory", folder)
    if dataset.mocap is not None:
        with collecting(errors):
            for take in motion_capture.find_takes(raw, dataset.mocap):
                with collecting(errors):
                    takes.append(motion_capture.marker_rows(*take, dataset))
    if dataset.encoders is not None:
        with collecting(errors):
            encoders = joint_logs.encoder_rows(raw, dataset)
    quality += _write(takes, "markers", folder, errors)
    return quality + _write(encoders, "encoders", folder, errors)


def _joint_log(dataset: Dataset, folder: Path, errors: list) -> list[dict]:
    """Write the tables of the controller's logs, for a dataset without robot only their paths."""
    from pipeline.recordings import joint_logs

    quality = []
    with collecting(errors):
        movements = joint_logs.read_movements(dataset, partial(collecting, errors))
        angles = {name: log.actual for name, log in movements.items()}
        exported = {name: rounding(measured) for name, measured in angles.items()}
        require_distinct("movements", angles, tolerances=exported)
    if errors:
        return quality
    if dataset.robot is None:
        for name, movement in movements.items():
            quality += joint_logs.count_rows(name, movement.counts)
        movement_rows = joint_logs.movement_paths(movements, dataset.motion.rate)
        contracts.write(movement_rows, "take_paths", folder)
        return quality
    with collecting(errors):
        tables = joint_logs.joint_log_rows(movements, dataset)
        for name in ("trajectory", "joint_log", "disturbed_log"):
            contracts.write(getattr(tables, name), name, folder)
        quality += tables.quality
    return quality


def _depth(
    dataset: Dataset,
    raw: Path,
    folder: Path,
    errors: list,
    compute: Any,
) -> list[dict]:
    """Write the time of every depth frame on the camera's clock, and the arm's points."""
    if dataset.depth is None:
        return []
    if dataset.mocap is None:
        message = "a depth camera needs motion capture (dataset.mocap) to find the clock offset"
        errors.append(ConfigError(message, key="dataset.depth"))
        return []
    from pipeline.arm.model import arm_of
    from pipeline.recordings.depth import depth_paths, frame_rows

    arm = arm_of(dataset.robot)
    results = []
    where = {"raw": raw, "folder": folder.resolve()}
    read = partial(frame_rows, depth=dataset.depth, arm=arm, **where)
    # set the bounds in each worker, since workers do not inherit them
    bounded = partial(attempt, within, dataset.reading, read)
    label = "ingest: depth takes"
    with collecting(errors):
        paths = list(depth_paths(raw, dataset.depth).items())
        results = list(run_trials(bounded, paths, compute=compute, label=label))
    takes = []
    for result in results:
        if isinstance(result, PipelineError):
            errors.append(result)
        else:
            takes.append(result)
    return _write(takes, "frames", folder, errors)


def _force(dataset: Dataset, raw: Path, folder: Path, errors: list) -> list[dict]:
    from pipeline.recordings.force import force_rows

    records = []
    for name in dataset.force.configurations if dataset.force is not None else ():
        with collecting(errors):
            records.append(force_rows(raw, name, dataset.force))
    return _write(records, "force", folder, errors)
