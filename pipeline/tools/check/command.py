"""``python -m pipeline check [DATASET]``: everything that the stages would refuse in a dataset:
its two files, its robot and its recordings.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.arm.model import chain_of
from pipeline.core import config, contracts, datasheet
from pipeline.core.columns import columns
from pipeline.core.draft import absent, filled
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.analysis import Compute
from pipeline.core.options.dataset import Dataset
from pipeline.core.typed_yaml import read_yaml
from pipeline.recordings.ingest import attempt, read_part
from pipeline.tools.check.values import value_faults

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
    faults = dataset_faults(option_file)
    for number, fault in enumerate(faults, start=1):
        print(f"{number}. {fault}")
    if faults:
        raise ConfigError(
            f"{len(faults)} to be mended, in {datasheet.path_of(name)} or {option_file} where no "
            "other file is named"
        )
    print(f"check: nothing is wrong with {name}")


def dataset_faults(option_file: Path) -> list[str]:
    """Return every fault of the dataset of ``option_file``: of its values, and of what the stages
    configure and ingest make of it.
    """
    try:
        values = config.dataset_values(option_file)
    except PipelineError as error:
        return [str(error)]
    faults = [f"{key}: ??? must be replaced by a value" for key in datasheet.unfilled_keys(values)]
    faults += [f"{key}: no value for it" for key in absent(values)]
    refused = value_faults(values)
    if not faults and not any(isinstance(fault, ConfigError) for fault in refused):
        # a key whose file is missing is named above
        named = {fault.evidence.get("key") for fault in refused}
        refused += [
            fault
            for fault in ingest_faults(filled(values))
            if not refused or fault.evidence.get("key", named) not in named
        ]
    if not refused and not faults and read_yaml(PARAMS).get("dataset") == option_file.stem:
        refused += _errors([attempt(config.compose_config, PARAMS)])
    return faults + _grouped(refused)


def ingest_faults(dataset: Dataset) -> list[PipelineError]:
    """Return every refusal of the stage ingest, which writes into a folder that is deleted; and of
    poses on the way where the arm is singular.
    """
    errors: list[PipelineError] = []
    for part in ("motion", "depth", "force"):
        with TemporaryDirectory() as name:
            folder = Path(name)
            errors += _errors([attempt(read_part, part, dataset, Compute(), folder, errors)])
            if contracts.exists("joint_log", folder):
                joints = contracts.read("joint_log", folder)
                q = joints[columns("q", dataset.robot.joints)].to_numpy()
                errors += _errors([attempt(lambda q=q: chain_of(dataset.robot).require_regular(q))])
    return errors


def _errors(outcomes: list[Any]) -> list[PipelineError]:
    return [outcome for outcome in outcomes if isinstance(outcome, PipelineError)]


def _grouped(errors: list[PipelineError]) -> list[str]:
    """The errors as text; of those that differ in numbers or files the first, with the number of
    the others.
    """
    groups: dict[tuple[str, Any], list[PipelineError]] = {}
    for error in errors:
        kind = re.sub(r"[0-9]+", "#", error.message.partition(";")[0])
        groups.setdefault((kind, error.evidence.get("key")), []).append(error)
    texts = []
    for first, *others in groups.values():
        files = [str(error.evidence["file"]) for error in others if "file" in error.evidence]
        named = f", as {', '.join(files[:3])}{' …' if len(files) > 3 else ''}" if files else ""
        texts.append(f"{first}{f'; and {len(others)} more{named}' if others else ''}")
    return texts
