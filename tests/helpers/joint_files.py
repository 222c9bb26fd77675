"""Small joint logs for tests."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.core.options.dataset import SIGNALS
from pipeline.formats.joints.log import JointLog, LogOptions
from pipeline.recordings import movement

PLAIN = LogOptions()


def log(samples: int = 100, joints: int = 6, seed: int = 1) -> JointLog:
    angles = np.random.default_rng(seed).uniform(-1.5, 1.5, (samples, joints))
    return JointLog(np.arange(samples) * 0.008, {"actual": angles}, {})


def read_joint_log(file: Path, *, joints: int, columns=None, options=PLAIN) -> JointLog:
    """The log of one signal in ``file``."""
    return movement.read_log(
        file,
        replace(options, joints=joints, signals={"actual": columns}),
    )


def read_movement(
    folder: Path,
    files: Sequence[str],
) -> tuple[list[np.ndarray], dict[str, int]]:
    """Values of the signals of six joints at 125 Hz, each in one of ``files``, and the counts."""
    names = dict(zip(files, SIGNALS, strict=False))
    options = {
        folder / f: replace(PLAIN, joints=6, signals={names[f]: None}) for f in names
    }
    signals, counts = movement.read_movement(options, 125.0)
    return list(signals.values()), counts


def table(folder, header: str, *rows: str):
    lines = [header, *rows] if header else rows
    (folder / "log.txt").write_text("".join(line + "\n" for line in lines))
    return folder / "log.txt"
