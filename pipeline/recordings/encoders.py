"""What the encoders read during the takes, as a table."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.core.columns import spread
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.formats.joints.log import LogOptions
from pipeline.recordings.movement import read_log, require_speeds, sliding_joints, speed_limits
from pipeline.recordings.quality import quality_row
from pipeline.recordings.take_names import named_takes

KEY = "dataset.encoders"


def encoder_rows(raw: Path, dataset: Dataset) -> list[tuple[pd.DataFrame, list[dict]]]:
    """Of every log below ``raw`` its rows of the table ``encoders`` and its quality.

    A log keeps its own rate: nothing is interpolated. Raises RecordingError where no file matches,
    and for logs that cannot be read, ConfigError for columns of another number of joints.
    """
    options, joints = dataset.encoders, dataset.robot.joints
    if len(options.actual) != len(joints):
        message = f"{len(options.actual)} columns for the {len(joints)} joints {', '.join(joints)}"
        raise ConfigError(message, key=f"{KEY}.actual")
    read = LogOptions(
        time=options.time,
        angle_unit=options.angle_unit,
        time_unit=options.time_unit,
        joints=len(joints),
        names=joints,
        sliding=sliding_joints(dataset.robot.urdf),
        signals={"actual": options.actual},
    )
    result, limits = [], speed_limits(dataset.robot.urdf)
    for part in ("training", "test"):
        pattern, key = getattr(options, part), f"{KEY}.{part}"
        files = named_takes(raw, pattern, key=key)
        if not files:
            raise RecordingError(f"no log matches {pattern!r}", file=raw, key=key)
        for name, file in files.items():
            log = read_log(file, read)
            require_speeds(log.time, log.signals, joints, limits, file=file)
            identity = {"take": name, "part": part, "t": log.time - options.start}
            rows = pd.DataFrame(identity | spread("q", joints, log.signals["actual"]))
            counts = {"rows": len(rows)} | log.counts
            quality = [quality_row(name, part, "encoders", *row) for row in counts.items()]
            result.append((rows, quality))
    return result
