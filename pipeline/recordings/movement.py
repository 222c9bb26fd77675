"""The logs of one movement of a robot, paired row by row."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats import joints as joint_formats
from pipeline.formats.format import Kind, format_of, formats_in
from pipeline.formats.joints import table
from pipeline.formats.joints.log import JointLog, LogOptions

CLOCK_TOLERANCE = 0.1  # of a step


def read_movement(
    files: Mapping[Path, LogOptions], rate: float
) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Signals (N, joints) of the logs ``files`` of one movement, row by row at the same times, as
    many as the shortest log has; of each the signals of its options, or all where these name none.

    ``counts``: those of the logs, and ``rows_without_partner`` that were left out because another
    log ends before them. Raises RecordingError for clocks that disagree or do not step at ``rate``
    (1/s) throughout.
    """
    logs = {file: read_log(file, options) for file, options in files.items()}
    length = min(len(log.time) for log in logs.values())
    first, time = next((file, log.time[:length]) for file, log in logs.items())
    uneven = np.abs(np.diff(time) * rate - 1) > CLOCK_TOLERANCE
    if uneven.any():
        row = int(np.argmax(uneven))
        message = (
            f"the log steps by {time[row + 1] - time[row]:.6g} s at {time[row]:.6g} "
            f"s, not by 1/{rate:g} s; samples are missing"
        )
        raise RecordingError(message, file=first)
    for file, log in logs.items():
        if (np.abs(log.time[:length] - time) * rate > CLOCK_TOLERANCE).any():
            raise RecordingError(
                f"the times are not those of {first.name}; take logs of one recording", file=file
            )
    counts: Counter[str] = Counter()
    for log in logs.values():
        counts.update(log.counts | {"rows_without_partner": len(log.time) - length})
    signals = {
        name: values[:length] for log in logs.values() for name, values in log.signals.items()
    }
    return signals, dict(counts)


def read_log(file: Path, options: LogOptions) -> JointLog:
    """The log in ``file``, of whichever format it begins like, else as a plain table.

    Raises RecordingError for another number of joints than the options say.
    """
    chosen = format_of(file, formats_in(joint_formats, Kind.JOINTS)) or table.FORMAT
    log = chosen.read(file, options)
    signals = {
        name: values
        for name, values in log.signals.items()
        if name in (options.signals or log.signals)
    }
    if wrong := {values.shape[1] for values in signals.values()} - {options.joints}:
        raise RecordingError(
            f"the log holds {wrong.pop()} joints, not {options.joints}",
            file=file,
            key="dataset.joint_log.joints",
        )
    return JointLog(log.time, signals, log.counts)
