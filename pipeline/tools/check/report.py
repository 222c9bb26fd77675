"""Everything that is wrong with a dataset, each in a sentence."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pipeline.arm.model import chain_of
from pipeline.core import config
from pipeline.core.columns import columns
from pipeline.core.datasheet import unfilled_keys
from pipeline.core.draft import absent, filled
from pipeline.core.errors import PipelineError
from pipeline.core.options.dataset import Dataset
from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.patterns import matching
from pipeline.recordings.joint_logs import joint_log_rows
from pipeline.recordings.logged_movement import read_logged_movement
from pipeline.recordings.take_names import named_takes
from pipeline.tools.check.files import NAMED, held, wrong
from pipeline.tools.inspect.examine import inspect


def problems(option_file: Path, params: Path) -> list[str]:
    """Of the dataset of ``option_file``: keys that are open, absent, unknown, of another type or
    out of range; files that are not there; recordings that cannot be read, hold no pair, or not the
    motion; last what ``params``, the file of the parameters, is refused for where it has this
    dataset.
    """
    try:
        values = config.dataset_values(option_file)
    except PipelineError as error:
        return [str(error)]
    amiss = [f"{key}: there is ??? for a value" for key in unfilled_keys(values)]
    amiss += [f"{key}: no value for it" for key in absent(values)]
    refused = [str(fault) for fault in wrong(values)]
    amiss += refused or _recorded(values)
    if not amiss and read_yaml(params).get("dataset") == option_file.stem:
        try:
            config.compose_config(params)
        except PipelineError as error:
            amiss.append(str(error))
    return list(dict.fromkeys(amiss))


def _recorded(values: dict) -> Iterator[str]:
    """What is wrong with the recordings themselves."""
    if not (recordings := held(values, "recordings")):
        return
    folder = Path(recordings)
    patterns = [held(values, key) for key in NAMED if key != "joint_log.movements"]
    forces = held(values, "force.configurations") or {}
    patterns += [force.get("file") for force in forces.values()]
    for pattern in filter(None, patterns):
        for path in matching(folder, pattern, key="dataset"):
            yield from (
                f"{finding.file}: {reason}" for finding in inspect(path) for reason in finding.stops
            )
    dataset = filled(values)
    if dataset is None or dataset.joint_log is None:
        return
    unread = list(_unread(dataset, folder))
    yield from unread or _motion(dataset, folder)


def _unread(dataset: Dataset, folder: Path) -> Iterator[str]:
    """The movements that cannot be read."""
    log = dataset.joint_log
    movements = named_takes(folder, log.movements, key="dataset.joint_log.movements")
    for name, place in movements.items():
        try:
            read_logged_movement(name, place, log, dataset.motion.rate)
        except PipelineError as error:
            yield str(error)


def _motion(dataset: Dataset, folder: Path) -> Iterator[str]:
    """What is wrong with the motion that was chosen, and with the arm on its way."""
    chain = chain_of(dataset.robot)
    try:
        _, joints, _ = joint_log_rows(folder, dataset, chain)
        chain.require_regular(joints[columns("q", dataset.robot.joints)].to_numpy(), what="row")
    except PipelineError as error:
        yield str(error)
