"""What is told of one motion twice, held against each other: the commanded path and its velocities,
the arm that the motion capture tracked, and what its encoders read. Another unit, order of columns
or clock is no uncertainty of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.commanded import task_coordinates
from pipeline.arm.interface import Chain
from pipeline.core.angles import whole_turns
from pipeline.core.columns import columns, members, values
from pipeline.core.errors import RecordingError
from pipeline.recordings.pairing import missed

MOST = 0.25  # of the motion, by which either may be missed: far above any arm's uncertainty
VELOCITY = 0.05  # of the motion, by which commanded velocities may miss the commanded positions
LEAST_TIMES = 3  # readings within the take, fewer tell nothing


def require_velocities(trajectory: pd.DataFrame, rate: float, file: Path) -> None:
    """RecordingError where the velocities of the table ``trajectory``, from ``file`` at ``rate``
    rows a second, do not lead along its positions.
    """
    x, v = values(trajectory, "x"), values(trajectory, "v")
    # a velocity may be that of the instant, or the mean over the step before or behind it
    gone = np.cumsum((v[:-1] + v[1:]) / 2, axis=0) / rate
    _require(
        missed(x[1:] - x[0], gone),
        members(trajectory, "x"),
        "the commanded velocities do not lead along the commanded positions",
        "their unit, the order of their columns, and t",
        VELOCITY,
        file=file,
    )


def require_commanded(q: np.ndarray, trajectory: pd.DataFrame, chain: Chain, take: str) -> None:
    """RecordingError where the tip of the tracked angles ``q`` (M+1, n) in rad is not on the
    commanded path of the table ``trajectory``, in a row of the task.
    """
    tip = task_coordinates(chain, chain.pose(q))
    _require(
        missed(tip, values(trajectory, "x")),
        chain.task,
        "the tip that the motion capture tracked is not on the commanded path",
        "the path's unit and columns, when it starts (dataset.trajectory), and the arm's base "
        "(dataset.mocap.base)",
        MOST,
        take=take,
        key="dataset.trajectory",
    )


def require_encoders(q: pd.DataFrame, readings: pd.DataFrame, joints: list[str], take: str) -> None:
    """RecordingError where what the encoders read, rows of the table ``encoders``, is not what was
    tracked at those times, rows of the table ``joints``.
    """
    during = readings[readings["t"].between(q["t"].min(), q["t"].max())]
    if len(during) < LEAST_TIMES:
        raise RecordingError(
            f"{len(during)} of {len(readings)} readings of the encoders are within the take: when "
            "does their log start?",
            take=take,
            key="dataset.encoders.start",
        )
    names = columns("q", joints)
    tracked = np.stack([np.interp(during["t"], q["t"], q[name]) for name in names], axis=1)
    read = during[names].to_numpy()
    for joint, turns in zip(joints, whole_turns(read, tracked), strict=True):
        if turns:
            raise RecordingError(
                f"the encoders read {joint} {turns:+g} turns (2π = 6.283 rad each) beside the "
                "angle that the motion capture tracked: log the angle that the arm's URDF has",
                take=take,
                key="dataset.encoders",
            )
    _require(
        missed(read, tracked),
        joints,
        "the encoders do not read what the motion capture tracked",
        "their angle_unit, the order of their columns (actual), and when their log starts (start)",
        MOST,
        take=take,
        key="dataset.encoders",
    )


def _require(
    shares: np.ndarray,
    names: Sequence[str],
    fault: str,
    suspects: str,
    most: float,
    **evidence: object,
) -> None:
    worst = int(shares.argmax())
    if shares[worst] > most:
        raise RecordingError(
            f"{fault}: {names[worst]} is off by {shares[worst]:.2g} of the motion, more than "
            f"{most:g}; suspected are {suspects}",
            **evidence,
        )
