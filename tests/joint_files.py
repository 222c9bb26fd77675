"""Small joint logs for tests."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import (
    JointLog,
    read_joint_log,
)


def log(samples: int = 100, joints: int = 6, seed: int = 1) -> JointLog:
    return JointLog(
        np.arange(samples) * 0.008,
        np.random.default_rng(seed).uniform(-3, 3, (samples, joints)),
        {},
    )


def refusal(file, joints: int = 2) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_joint_log(file, joints=joints)
    assert caught.value.evidence["file"] == file
    return caught.value


def table(folder, header: str, *rows: str):
    (folder / "log.txt").write_text(
        "".join(line + "\n" for line in ([header] if header else []) + list(rows))
    )
    return folder / "log.txt"
