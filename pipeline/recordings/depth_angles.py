"""Joint angles of the recorded depth takes, from the tables of the stages before."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pandas as pd

from pipeline.arm.model import arm_of
from pipeline.core import contracts
from pipeline.core.columns import columns
from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Compute
from pipeline.core.options.dataset import Robot
from pipeline.perception.articulation import ArticulationOptions, articulate_rows
from pipeline.recordings.depth_points import arm_points

MOTION, DEPTH, TRACK = Path("data/ingest/motion"), Path("data/ingest/depth"), Path("data/track")


def depth_takes() -> list[pd.DataFrame]:
    """The rows of the table ``frames`` of every take that ``track`` has not left out."""
    frames, joints = contracts.read("frames", TRACK), contracts.read("joints", TRACK)
    return [rows for _, rows in frames[frames["take"].isin(joints["take"])].groupby("take")]


def articulated(
    takes: list[pd.DataFrame],
    robot: Robot,
    options: ArticulationOptions,
    compute: Compute,
    label: str,
) -> pd.DataFrame:
    """The table ``angles`` of ``takes``.

    Args:
        takes: as of :func:`depth_takes`.
        robot: of the dataset.
        options: of the articulation.
        compute: where the takes are fitted.
        label: of the progress that is printed.
    """
    joints = contracts.read("joints", TRACK)
    first = joints[(joints.part == "training") & (joints.k == 0)]
    fit = partial(
        _fit,
        arm=arm_of(robot),
        joints=robot.joints,
        trajectory=contracts.read("trajectory", MOTION),
        options=options,
        start=first[columns("q", robot.joints)].mean().to_numpy(),
    )
    return pd.concat(run_trials(fit, takes, compute=compute, label=label), ignore_index=True)


def _fit(rows: pd.DataFrame, **given: object) -> pd.DataFrame:
    return articulate_rows(rows, arm_points(rows, DEPTH), **given)
