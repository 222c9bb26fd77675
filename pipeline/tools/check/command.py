"""``python -m pipeline check [DATASET]``: faults of a dataset's two files, robot and recordings for
which the stages would raise an error.
"""

import os
import re
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.arm.model import chain_of
from pipeline.arm.urdf import read_urdf
from pipeline.configuration import config, datasheet
from pipeline.configuration.datasheet import get_filled, get_nested
from pipeline.core import contracts
from pipeline.core.columns import columns
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.analysis import Compute
from pipeline.core.options.dataset import Dataset, Robot
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated
from pipeline.recordings.ingest import collecting, read_part
from pipeline.recordings.inventory import listing, raw_folder

PARAMS = Path("params.yaml")


def run(name: str | None = None) -> None:
    """Print one line per fault; ConfigError if there is a fault."""
    config.require_dataset(name := name or read_yaml(PARAMS).get("dataset"))
    option_file = config.CONF / "dataset" / f"{name}.yaml"
    faults = dataset_faults(option_file)
    for number, fault in enumerate(faults, start=1):
        print(f"{number}. {fault}")
    if faults:
        files = " or ".join(
            os.path.relpath(f) for f in (datasheet.path_of(name), option_file)
        )
        message = f"{len(faults)} fault(s): correct {files}, or the named file"
        unfilled = datasheet.OPEN in str(faults)
        remedy = f"; `new-dataset {name} --ask` asks for every ???" if unfilled else ""
        raise ConfigError(f"{message}{remedy}")
    chosen = read_yaml(PARAMS).get("dataset") == name
    choose = "" if chosen else f"set `dataset: {name}` in params.yaml, and "
    print(f"check: {name} has no faults; next: {choose}run `dvc repro`")


def dataset_faults(option_file: Path) -> list[str]:
    """Return all faults of the dataset's values; without such faults, of ingest and configure."""
    try:
        values = config.dataset_values(option_file)
    except PipelineError as error:
        return [str(error)]
    dataset, _, absent = datasheet.check_values(values)
    texts = [
        f"{key}: ??? must be replaced by a value"
        for key in datasheet.unfilled_keys(values)
    ]
    texts += [f"{key}: no value" for key in absent]
    errors = value_faults(values)
    if not texts and not errors:
        errors = ingest_faults(dataset)
    if (
        not texts
        and not errors
        and read_yaml(PARAMS).get("dataset") == option_file.stem
    ):
        with collecting(errors):
            config.compose_config(PARAMS)
    # errors that differ only in numbers are one line, with the files of the further errors
    groups: dict[str, list[PipelineError]] = {}
    for error in errors:
        kind = f"{error.message.partition(';')[0]} {error.evidence.get('key')}"
        groups.setdefault(re.sub(r"[0-9]+", "#", kind), []).append(error)
    for first, *others in groups.values():
        files = ", ".join(str(error.evidence.get("file", "")) for error in others[:3])
        texts.append(
            f"{first}; and {len(others)} more: {files}" if others else str(first),
        )
    return texts


def value_faults(values: dict[str, Any]) -> list[PipelineError]:
    """Return the faults of types, ranges, robot and folder in the filled-in ``values``."""
    sound = deepcopy(values)
    errors: list[PipelineError] = [*datasheet.check_values(values)[1]]
    for fault in errors:  # remove faulty values before the robot is read
        above, _, name = (
            str(fault.evidence["key"]).removeprefix("dataset.").rpartition(".")
        )
        if isinstance(node := get_nested(sound, above), dict):
            node.pop(name, None)
    recordings, urdf, robot = (
        get_filled(sound, k) for k in ("recordings", "robot.urdf", "robot")
    )
    if recordings and not raw_folder(recordings).is_dir():
        with collecting(errors):
            listing(Path(recordings))  # its message names how to get them
    if urdf:
        with collecting(errors):
            read_urdf(Path(urdf))
            if robot:
                chain_of(validated(Robot, robot, "robot"))
    logged, joints = (
        get_filled(sound, k) for k in ("joint_log.joints", "robot.joints")
    )
    if logged and (missing := [joint for joint in joints or [] if joint not in logged]):
        message = f"{', '.join(missing)} of robot.joints is not logged; the log holds"
        errors.append(
            ConfigError(
                f"{message} {', '.join(logged)}",
                key="dataset.joint_log.joints",
            ),
        )
    return errors


def ingest_faults(dataset: Dataset) -> list[PipelineError]:
    """Return all errors of the stage ingest, run in a temporary folder, and singular poses."""
    errors: list[PipelineError] = []
    for part in ("motion", "depth", "force"):
        with TemporaryDirectory() as name:
            folder = Path(name)
            with collecting(errors):
                read_part(part, dataset, Compute(), folder, errors)
            if contracts.exists("joint_log", folder):
                joints = contracts.read("joint_log", folder)
                q = joints[columns("q", dataset.robot.joints)].to_numpy()
                with collecting(errors):
                    chain_of(dataset.robot).require_regular(q)
    return errors
