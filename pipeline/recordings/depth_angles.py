"""The arm's points in the frames of the depth takes, and the joint angles that they give."""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import arm_of
from pipeline.core import contracts
from pipeline.core.columns import columns
from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import ArticulationSection, Compute
from pipeline.core.options.dataset import Robot
from pipeline.perception.articulation import articulate_rows

MOTION, DEPTH, TRACK = Path("data/ingest/motion"), Path("data/ingest/depth"), Path("data/track")


def arm_points(rows: pd.DataFrame, folder: Path) -> list[np.ndarray]:
    """Read the arm's points (I, 2), m in its plane, of a take's ``rows`` of ``frames``."""
    take = rows["take"].iloc[0]
    return np.split(np.load(folder / f"{take}.npy"), np.cumsum(rows["points"])[:-1])


def depth_takes() -> list[pd.DataFrame]:
    """Return the rows of the table ``frames`` of every take that ``track`` has not left out."""
    frames, joints = contracts.read("frames", TRACK), contracts.read("joints", TRACK)
    return [rows for _, rows in frames[frames["take"].isin(joints["take"])].groupby("take")]


def articulated(
    takes: list[pd.DataFrame],
    robot: Robot,
    options: ArticulationSection,
    compute: Compute,
    label: str,
) -> pd.DataFrame:
    """Return the table ``angles`` of the ``takes`` of :func:`depth_takes`."""
    joints = contracts.read("joints", TRACK)
    first = joints[(joints.part == "training") & (joints.k == 0)]
    start = first[columns("q", robot.joints)].mean().to_numpy()
    given = arm_of(robot), robot.joints, contracts.read("trajectory", MOTION), options, start
    angles = run_trials(partial(_fit, given=given), takes, compute=compute, label=label)
    return pd.concat(angles, ignore_index=True)


def _fit(rows: pd.DataFrame, given: tuple) -> pd.DataFrame:
    return articulate_rows(rows, arm_points(rows, DEPTH), *given)
