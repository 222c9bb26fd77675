"""The motions in the joint logs of a new dataset as a table, and what one of them says of the four
options that name it.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.datasheet import unfilled_keys
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from pipeline.core.options.instruments import JointLog
from pipeline.recordings.logged_movement import read_logged_movement
from pipeline.recordings.motions import Motion, motions
from pipeline.recordings.take_names import named_takes

KEYS = ("motion.steps", "joint_log.start", "joint_log.end", "joint_log.rest")
HEADINGS = (
    *("no.", "from (rad)", "to (rad)", "steps", "pause", "times", "disturbed"),
    *("least singular value", "commands differ by (rad)", "movements"),
)


def found_motions(values: dict[str, Any]) -> list[Motion]:
    """The motions in the logs that the ``values`` of a dataset name; ConfigError where one that is
    needed for that is still ???, and as what reads the logs.
    """
    log = values["joint_log"] | {"start": [], "end": [], "rest": 0, "tolerance": 1.0}
    rate = values["motion"]["rate"]
    needed = {"joint_log": log, "robot": values["robot"], "motion": {"rate": rate}}
    if open_keys := [*unfilled_keys(needed)]:
        message = f"the motions are found once these are filled in: {', '.join(open_keys)}"
        raise ConfigError(message)
    options, folder = JointLog(**log), Path(values["recordings"])
    places = named_takes(folder, options.movements, key="dataset.joint_log.movements")
    movements = {
        name: read_logged_movement(name, place, options, float(rate))
        for name, place in places.items()
    }
    return motions(movements, Robot(**values["robot"]), rate)


def answers(motion: Motion, rate: float) -> dict[str, str]:
    """What the ``motion`` says of the four KEYS, at ``rate`` steps a second."""
    rest = motion.rest(rate)
    values = (motion.steps + 2 * rest, _list(motion.start, 4), _list(motion.end, 4), rest)
    return dict(zip(KEYS, map(str, values), strict=True))


def table(offered: list[Motion]) -> str:
    """A line a motion, numbered from 1."""
    rows = [HEADINGS]
    for number, motion in enumerate(offered, start=1):
        counts = Counter(name for name, _ in motion.places)
        disturbed = ", ".join(f"{name} row {row}" for name, row in motion.disturbed)
        rows.append(
            (
                str(number),
                _list(motion.start, 2),
                _list(motion.end, 2),
                str(motion.steps),
                "never rests" if motion.pause is None else str(motion.pause),
                str(len(motion.places)),
                disturbed or "none",
                f"{motion.least_singular:.2g}",
                f"{motion.deviation:.2g}",
                ", ".join(f"{name} ({count})" for name, count in counts.items()),
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def _list(angles: np.ndarray, digits: int) -> str:
    return str((np.round(angles, digits) + 0.0).tolist())
