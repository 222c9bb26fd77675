"""What the encoders read during the test takes, as a table."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.core.columns import spread
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.formats.joints.log import LogOptions
from pipeline.formats.patterns import matching
from pipeline.recordings.movement import read_log
from pipeline.recordings.quality import quality_row, require_text

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
    files = matching(raw, options.takes, key=f"{KEY}.takes")
    if not files:
        raise RecordingError(f"no log matches {options.takes!r}", file=raw, key=f"{KEY}.takes")
    read = LogOptions(
        time=options.time,
        angle_unit=options.angle_unit,
        time_unit=options.time_unit,
        joints=len(joints),
        signals={"actual": options.actual},
    )
    result = []
    for file in files:
        require_text(file)
        log = read_log(file, read)
        identity = {"take": file.stem, "part": "test", "t": log.time - options.start}
        rows = pd.DataFrame(identity | spread("q", joints, log.signals["actual"]))
        counts = {"rows": len(rows)} | log.counts
        result.append(
            (rows, [quality_row(file.stem, "test", "encoders", *row) for row in counts.items()])
        )
    return result
