"""``python -m pipeline check [DATASET]``: everything that the stages would refuse in a dataset:
its two files, its robot and its recordings.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.arm.model import chain_of
from pipeline.arm.urdf import read_urdf
from pipeline.core import config, contracts, datasheet
from pipeline.core.columns import columns
from pipeline.core.datasheet import absent, faults, filled
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.core.options.analysis import Compute
from pipeline.core.options.dataset import Dataset, Robot
from pipeline.core.typed_yaml import read_yaml
from pipeline.recordings.ingest import attempt, read_part

PARAMS = Path("params.yaml")


def run(words: list[str]) -> None:
    """Print a line a fault; ConfigError where there are any."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline check", description=__doc__.partition(": ")[2]
    )
    parser.add_argument(
        "name", nargs="?", metavar="DATASET", help="name of the dataset (default params.yaml's)"
    )
    name = parser.parse_args(words).name or read_yaml(PARAMS).get("dataset")
    if name not in config.option_names("dataset"):
        there_are = ", ".join(config.option_names("dataset"))
        raise ConfigError(f"no dataset {name!r}; there are {there_are}")
    option_file = config.CONF / "dataset" / f"{name}.yaml"
    found = dataset_faults(option_file)
    for number, fault in enumerate(found, start=1):
        print(f"{number}. {fault}")
    if found:
        raise ConfigError(
            f"{len(found)} to be mended, in {datasheet.path_of(name)} or {option_file} where no "
            "other file is named"
        )
    print(f"check: nothing is wrong with {name}")


def dataset_faults(option_file: Path) -> list[str]:
    """Return every fault of the values of the dataset of ``option_file``, and where there is none,
    of what the stages configure and ingest make of it.
    """
    try:
        values = config.dataset_values(option_file)
    except PipelineError as error:
        return [str(error)]
    texts = [f"{key}: ??? must be replaced by a value" for key in datasheet.unfilled_keys(values)]
    texts += [f"{key}: no value for it" for key in absent(values)]
    refused = value_faults(values)
    if not texts and not refused:
        refused = ingest_faults(filled(values))
    if not texts and not refused and read_yaml(PARAMS).get("dataset") == option_file.stem:
        refused = _errors(attempt(config.compose_config, PARAMS))
    # errors that differ in numbers or files are one line, with the number of the others
    groups: dict[tuple[str, Any], list[PipelineError]] = {}
    for error in refused:
        kind = re.sub(r"[0-9]+", "#", error.message.partition(";")[0])
        groups.setdefault((kind, error.evidence.get("key")), []).append(error)
    for first, *others in groups.values():
        files = [str(error.evidence["file"]) for error in others if "file" in error.evidence]
        named = f", as {', '.join(files[:3])}{' …' if len(files) > 3 else ''}" if files else ""
        texts.append(f"{first}{f'; and {len(others)} more{named}' if others else ''}")
    return texts


def value_faults(values: dict[str, Any]) -> list[PipelineError]:
    """Return the faults of the ``values`` that are filled in, before any recording is read: types
    and ranges, the robot, and the recordings' folder.
    """
    refused, sound = faults(values), deepcopy(values)
    for fault in refused:
        *above, name = str(fault.evidence["key"]).removeprefix("dataset.").split(".")
        node: Any = sound
        for part in above:
            node = node.get(part) if isinstance(node, dict) else None
        if isinstance(node, dict):
            node.pop(name, None)
    return [*refused, *_robot(sound)]


def get_filled(values: Any, key: str) -> Any:
    """Return the value of a nested ``key``, None where it is missing or still ???."""
    node = values
    for part in key.split("."):
        node = node.get(part) if isinstance(node, dict) else None
    return None if node is None or [*datasheet.unfilled_keys(node)] else node


def _robot(values: dict[str, Any]) -> Iterator[PipelineError]:
    recordings = get_filled(values, "recordings")
    if recordings and not Path(recordings).is_dir():
        yield RecordingError("no such folder", file=recordings, key="dataset.recordings")
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


def ingest_faults(dataset: Dataset) -> list[PipelineError]:
    """Return every refusal of the stage ingest, which writes into a folder that is deleted; and of
    poses on the way where the arm is singular.
    """
    errors: list[PipelineError] = []
    for part in ("motion", "depth", "force"):
        with TemporaryDirectory() as name:
            folder = Path(name)
            errors += _errors(attempt(read_part, part, dataset, Compute(), folder, errors))
            if contracts.exists("joint_log", folder):
                joints = contracts.read("joint_log", folder)
                q = joints[columns("q", dataset.robot.joints)].to_numpy()
                errors += _errors(attempt(lambda q=q: chain_of(dataset.robot).require_regular(q)))
    return errors


def _errors(outcome: Any) -> list[PipelineError]:
    return [outcome] if isinstance(outcome, PipelineError) else []
