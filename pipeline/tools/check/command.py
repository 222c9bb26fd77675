"""``python -m pipeline check [DATASET]``: faults of a dataset that the stages would refuse, in its
two files, its robot and its recordings.
"""

import os
import re
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.arm.model import chain_of
from pipeline.arm.urdf import read_urdf
from pipeline.core import config, contracts, datasheet
from pipeline.core.columns import columns
from pipeline.core.datasheet import get_filled, get_nested
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.core.options.analysis import Compute
from pipeline.core.options.dataset import Dataset, Robot
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated
from pipeline.recordings.ingest import attempt, read_part

PARAMS = Path("params.yaml")
HELP = "name of the dataset (default params.yaml's)"
ARGUMENTS = {"name": {"nargs": "?", "metavar": "DATASET", "help": HELP}}


def run(name: str | None = None) -> None:
    """Print a line for each fault; ConfigError where there are any."""
    config.require_dataset(name := name or read_yaml(PARAMS).get("dataset"))
    option_file = config.CONF / "dataset" / f"{name}.yaml"
    found = dataset_faults(option_file)
    for number, fault in enumerate(found, start=1):
        print(f"{number}. {fault}")
    if found:
        files = " or ".join(os.path.relpath(f) for f in (datasheet.path_of(name), option_file))
        message = f"{len(found)} to be mended in {files}, or in the file that is named"
        asks = f"; `new-dataset {name} --ask` asks for every ???" * ("???" in str(found))
        raise ConfigError(message + asks)
    print(f"check: nothing is wrong with {name}")


def dataset_faults(option_file: Path) -> list[str]:
    """Return every fault of the dataset's values and, without one, of configure and ingest."""
    try:
        values = config.dataset_values(option_file)
    except PipelineError as error:
        return [str(error)]
    dataset, _, absent = datasheet.check_values(values)
    texts = [f"{key}: ??? must be replaced by a value" for key in datasheet.unfilled_keys(values)]
    texts += [f"{key}: no value for it" for key in absent]
    refused = value_faults(values)
    if not texts and not refused:
        refused = ingest_faults(dataset)
    if not texts and not refused and read_yaml(PARAMS).get("dataset") == option_file.stem:
        refused = _errors(config.compose_config, PARAMS)
    # errors alike but for their numbers are one line, with the number of the others
    groups: dict[tuple[str, Any], list[PipelineError]] = {}
    for error in refused:
        kind = re.sub(r"[0-9]+", "#", error.message.partition(";")[0])
        groups.setdefault((kind, error.evidence.get("key")), []).append(error)
    for first, *others in groups.values():
        files = [str(error.evidence["file"]) for error in others if "file" in error.evidence]
        named = f", as {', '.join(files[:3])}{' …' * (len(files) > 3)}" if files else ""
        texts.append(f"{first}; and {len(others)} more{named}" if others else str(first))
    return texts


def value_faults(values: dict[str, Any]) -> list[PipelineError]:
    """Return the faults of types, ranges, robot and folder in the ``values`` filled in."""
    sound = deepcopy(values)
    refused: list[PipelineError] = [*datasheet.check_values(values)[1]]
    for fault in refused:  # the robot is read without them
        above, _, name = str(fault.evidence["key"]).removeprefix("dataset.").rpartition(".")
        if isinstance(node := get_nested(sound, above), dict):
            node.pop(name, None)
    recordings, urdf, robot = (get_filled(sound, k) for k in ("recordings", "robot.urdf", "robot"))
    if recordings and not Path(recordings).is_dir():
        key = "dataset.recordings"
        refused.append(RecordingError("no such folder", file=recordings, key=key))
    if urdf:
        unread = _errors(read_urdf, Path(urdf))
        refused += unread
        if robot and not unread:
            refused += _errors(lambda: chain_of(validated(Robot, robot, "robot")))
    logged, joints = (get_filled(sound, k) for k in ("joint_log.joints", "robot.joints"))
    if logged and (missing := [joint for joint in joints or [] if joint not in logged]):
        message = f"{', '.join(missing)} of robot.joints is not logged; the log holds"
        key = "dataset.joint_log.joints"
        refused.append(ConfigError(f"{message} {', '.join(logged)}", key=key))
    return refused


def ingest_faults(dataset: Dataset) -> list[PipelineError]:
    """Return every refusal of the stage ingest, run in a temporary folder, and singular poses."""
    errors: list[PipelineError] = []
    for part in ("motion", "depth", "force"):
        with TemporaryDirectory() as name:
            folder = Path(name)
            errors += _errors(read_part, part, dataset, Compute(), folder, errors)
            if contracts.exists("joint_log", folder):
                joints = contracts.read("joint_log", folder)
                q = joints[columns("q", dataset.robot.joints)].to_numpy()
                errors += _errors(lambda q=q: chain_of(dataset.robot).require_regular(q))
    return errors


def _errors(function: Callable, *arguments: Any) -> list[PipelineError]:
    outcome = attempt(function, *arguments)
    return [outcome] if isinstance(outcome, PipelineError) else []
