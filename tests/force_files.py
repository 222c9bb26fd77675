"""Small logs of an ATI DAQ F/T for tests."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.force.daqft import read_daqft
from pipeline.formats.force.record import ForceRecord

SETTINGS = (
    '"Frequency = 1000","Averaging Level = 16","F/T Serial Number = FT1","Time '
    'Started = 1/2/2024 3:04:05 PM"'
)


ROW = "1.5,2,3,4,5,6"


def record(samples: int = 200, seed: int = 1) -> ForceRecord:
    values = np.random.default_rng(seed).normal(size=(samples, 6)) * 10.0 ** np.arange(-7, 5, 2)
    return ForceRecord(
        np.arange(samples) / 62.5,
        values[:, :3],
        values[:, 3:],
        62.5,
        "FT38684",
        "20.12.2023 13:59:33",
        {},
    )


def log(folder, *rows: str, force: str = "N", torque: str = "N-m", top: str = ""):
    labels = [f'"Force {axis} ({force})"' for axis in "XYZ"] + [
        f'"Torque {axis} ({torque})"' for axis in "XYZ"
    ]
    file = folder / "log.csv"
    file.write_bytes(
        (
            top + ",".join([*labels, SETTINGS]) + "\r\n" + "".join(row + "\r\n" for row in rows)
        ).encode()
    )
    return file


def refusal(file) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_daqft(file)
    assert caught.value.evidence["file"] == file
    return caught.value
