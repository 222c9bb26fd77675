"""The commanded motion: its steps, and checks of what is known of one motion twice."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.interface import Chain
from pipeline.arm.urdf import Joint, read_urdf
from pipeline.core.angles import whole_turns
from pipeline.core.columns import columns, members, values
from pipeline.core.errors import RecordingError
from pipeline.recordings.pairing import missed

UNFILLED = "???"  # name of a file that is still to be filled in
STEADY = 0.9  # of the speed, so that noise of the mean path leaves no gap
MOST = 0.25  # of the motion, by which either may be missed: far above any arm's uncertainty
VELOCITY = 0.05  # of the motion, by which commanded velocities may miss the commanded positions
LEAST_TIMES = 3  # readings within the take; fewer decide nothing


def commanded_steps(trajectory: pd.DataFrame, rate: float) -> np.ndarray:
    """Return v = ẋᵈΔt (M, m), m and rad; of a redundant arm (M, m + n) with the joint steps."""
    return np.hstack([values(trajectory, family) for family in ("v", "u")])[:-1] / rate


def constant_speed(q: np.ndarray) -> np.ndarray:
    """Return which (M,) steps of the mean of ``q`` (takes, M+1, n) rad are about the fastest."""
    pace = np.linalg.norm(np.diff(q.mean(axis=0), axis=0), axis=-1)
    return pace >= STEADY * np.quantile(pace, 0.9)


def named_joints(urdf: str, names: Sequence[str]) -> list[Joint | None]:
    """Return the joints ``names`` of the file ``urdf``, None for one that it lacks."""
    joints = {} if urdf == UNFILLED else read_urdf(Path(urdf)).joints
    return [joints.get(name) for name in names]


def circular_joints(urdf: str, names: Sequence[str]) -> np.ndarray:
    """Return which of the joints ``names`` turn: all but the prismatic ones of ``urdf``."""
    return np.array([(joint and joint.kind) != "prismatic" for joint in named_joints(urdf, names)])


def require_velocities(trajectory: pd.DataFrame, rate: float, file: Path) -> None:
    """Raise RecordingError where the velocities do not lead along the positions."""
    x, v = values(trajectory, "x"), values(trajectory, "v")
    # a velocity may be that of the instant, or the mean over the step before or behind it
    gone = np.cumsum((v[:-1] + v[1:]) / 2, axis=0) / rate
    fault = "the commanded velocities do not lead along the commanded positions"
    suspects, names = "their unit, the order of their columns, and t", members(trajectory, "x")
    _require(missed(x[1:] - x[0], gone), names, fault, suspects, VELOCITY, file=file)


def require_commanded(q: np.ndarray, trajectory: pd.DataFrame, chain: Chain, take: str) -> None:
    """Raise RecordingError where the tip at ``q`` (M+1, n) rad is not on the commanded path."""
    shares = missed(chain.coordinates(chain.pose(q)), values(trajectory, "x"))
    fault = "the tip that the motion capture tracked is not on the commanded path"
    suspects = "the path's unit and columns, when it starts (dataset.trajectory), and the arm's"
    suspects += " base (dataset.mocap.base)"
    _require(shares, chain.task, fault, suspects, MOST, take=take, key="dataset.trajectory")


def require_encoders(
    q: pd.DataFrame,
    readings: pd.DataFrame,
    joints: list[str],
    take: str,
    circular: np.ndarray | bool = True,
) -> None:
    """Raise RecordingError where ``readings``, rows of the table ``encoders``, are not the angles
    tracked at those times, rows ``q`` of the table ``joints``; ``circular``: which joints turn.
    """
    during = readings[readings["t"].between(q["t"].min(), q["t"].max())]
    where = {"take": take, "key": "dataset.encoders"}
    if len(during) < LEAST_TIMES:
        message = f"{len(during)} of {len(readings)} readings of the encoders are within the take"
        where["key"] += ".start"
        raise RecordingError(f"{message}: when does their log start?", **where)
    names = columns("q", joints)
    tracked = np.stack([np.interp(during["t"], q["t"], q[name]) for name in names], axis=1)
    read = during[names].to_numpy()
    turns = whole_turns(read, tracked, circular)
    for joint, own in zip(np.array(joints)[turns != 0], turns[turns != 0], strict=True):
        message = f"the encoders read {joint} {own:+g} turns (2π = 6.283 rad each) beside the angle"
        message += " that the motion capture tracked: log the angle that the arm's URDF has"
        raise RecordingError(message, **where)
    fault = "the encoders do not read what the motion capture tracked"
    suspects = "their angle_unit, the order of their columns (actual), and when their log starts"
    _require(missed(read, tracked), joints, fault, f"{suspects} (start)", MOST, **where)


def _require(
    shares: np.ndarray, names: Sequence[str], fault: str, suspects: str, most: float, **where
) -> None:
    worst = int(shares.argmax())
    if shares[worst] > most:
        off = f"{names[worst]} is off by {shares[worst]:.2g} of the motion, more than {most:g}"
        raise RecordingError(f"{fault}: {off}; suspected are {suspects}", **where)
