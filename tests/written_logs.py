"""Logs as instruments write them, for tests of what reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.formats.force.record import ForceRecord
from pipeline.formats.joints.log import JointLog


def write_netft(file: Path, record: ForceRecord, *, counts_per_unit: int | None = None) -> None:
    """Write ``record`` as the program of ATI's network transducers does, in N and N·m, or in whole
    counts where ``counts_per_unit`` is given.
    """
    per_unit = counts_per_unit or 1_000_000
    values = np.hstack([record.force, record.torque])
    cells = np.rint(values * per_unit).astype(int) if counts_per_unit else values
    lines = [f"Start Time: {record.started}", f"RDT Sample Rate: {record.rate:.0f}"]
    lines += [
        "Force Units: N",
        f"Counts per Unit Force: {per_unit}.0",
        "Torque Units: N-m",
        f"Counts per Unit Torque: {per_unit}.0",
    ]
    lines += ["Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time"]
    for number, row in zip(
        np.rint(record.time * record.rate).astype(int) + 1, cells.tolist(), strict=True
    ):
        lines.append(
            ",".join(f'"{cell}"' for cell in ("0x0", number, 10 * number, *row, record.started))
        )
    Path(file).write_bytes(("\r\n".join(lines) + "\r\n").encode())


def write_joint_log(file: Path, log: JointLog) -> None:
    """Write ``log`` with six decimals, which is what controllers print: 1 µs and 1 µrad."""
    table = np.column_stack([log.time, log.signals["actual"]])
    row = ", ".join(["%.6f"] * table.shape[1]) + "\n"
    Path(file).write_bytes((row * len(table) % tuple(table.ravel().tolist())).encode())
