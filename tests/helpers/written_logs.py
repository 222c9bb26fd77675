"""Logs as instruments write them, for tests of what reads them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.force.record import ForceRecord
from pipeline.formats.joints.log import JointLog
from pipeline.tools.inspect.command import as_table, inspect

# a calibration of ATI's, one axis with other gauges than the next
GAUGED = {"Fx": "6.25", "Fy": "7", "Fz": "8", "Tx": "6.25", "Ty": "7", "Tz": "8"}
AXES = "".join(
    f'<UserAxis Name="{axis}" values="1 2 3 4 5 {gauge}" max="25"/>\n'
    for axis, gauge in GAUGED.items()
)
CALIBRATION = f"""<?xml version="1.0" encoding="utf-8"?>
<FTSensor Serial="FT1">
<Calibration ForceUnits="N" TorqueUnits="N-mm">
{AXES}</Calibration></FTSensor>
"""


def refusal(
    read: Callable[..., object],
    file: Path,
    *arguments: object,
) -> RecordingError:
    """The error with which ``read`` refuses ``file``, which it has to name."""
    with pytest.raises(RecordingError) as caught:
        read(file, *arguments)
    assert caught.value.evidence["file"] == file
    return caught.value


def write_netft(
    file: Path,
    record: ForceRecord,
    *,
    counts_per_unit: int | None = None,
) -> None:
    """Write :func:`netft_text`."""
    Path(file).write_bytes(netft_text(record, counts_per_unit).encode())


def netft_text(record: ForceRecord, counts_per_unit: int | None = None) -> str:
    """The log of ``record`` as the program of ATI's network transducers writes it, in N and N·m, or
    in whole counts where ``counts_per_unit`` is given.
    """
    values = np.hstack([record.force, record.torque])
    if counts_per_unit:
        values = np.rint(values * counts_per_unit).astype(int)
    per_unit = counts_per_unit or 1_000_000
    lines = [
        f"Start Time: {record.started}",
        f"RDT Sample Rate: {record.rate:.0f}",
        "Force Units: N",
        f"Counts per Unit Force: {per_unit}.0",
        "Torque Units: N-m",
        f"Counts per Unit Torque: {per_unit}.0",
        "Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time",
    ]

    numbers = np.rint(record.time * record.rate).astype(int) + 1
    for number, wrench in zip(numbers, values.tolist(), strict=True):
        cells = "0x0", number, 10 * number, *wrench, record.started
        lines.append(",".join(f'"{cell}"' for cell in cells))
    return "\r\n".join(lines) + "\r\n"


def write_joint_log(file: Path, log: JointLog) -> None:
    """Write ``log`` with six decimals, which is what controllers print: 1 µs and 1 µrad."""
    table = np.column_stack([log.time, log.signals["actual"]])
    np.savetxt(file, table, fmt="%.6f", delimiter=", ")


def seen(file: Path) -> str:
    """The text that ``inspect`` prints of ``file``."""
    return " ".join(as_table(inspect(file), file.parent).split())
