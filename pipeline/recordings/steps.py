"""Recorded steps for fitting models, ranges of the steps, and reference joint angles."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import chain_of
from pipeline.core import contracts
from pipeline.core.options.dataset import Dataset, Motion, Robot
from pipeline.models.model import frobenius
from pipeline.models.steps import Recorded
from pipeline.recordings.commands import commanded_steps

MOTION = Path("data/ingest/motion")
TRACK = Path("data/track")


def training_steps(robot: Robot, motion: Motion) -> Recorded:
    """Return poses, commanded steps and process noise of the training takes of ``motion``."""
    joints = contracts.read("joints", TRACK)
    trajectory = contracts.read("trajectory", MOTION)
    process_noise = contracts.read("process_noise", TRACK)
    _, q = contracts.stacked(joints[joints["part"] == "training"], "q")
    _, noise = contracts.stacked(process_noise, "w")
    measurement = None
    if motion.pose_noise is not None:
        measurement = 2 * motion.pose_noise**2 * np.eye(len(robot.joints))
    return Recorded(
        chain=chain_of(robot),
        q=q[:, :-1],
        v=commanded_steps(trajectory, motion.rate),
        noise=noise,
        joints=tuple(robot.joints),
        known_measurement=measurement,
        rate=motion.rate,
    )


def fitted_ranges(recorded: Recorded, rate: float) -> pd.DataFrame:
    """Return least and greatest value of the measured ``pose``, the commanded ``joint speed``, the
    commanded ``speed`` of each task coordinate (``rate`` in Hz), and the ``condition`` ‖J⁺‖.
    """
    chain = recorded.chain
    joints = recorded.joints
    v = recorded.v
    speeds = rate * chain.nominal_step(recorded.q, v)
    norms = frobenius(chain.inverse_jacobian(recorded.q))[..., None]
    command = [*chain.task, *joints][: v.shape[-1]]
    translations = ("x", "y", "z")
    units = ["m/s" if name in translations else "rad/s" for name in command]

    tables = [
        _ranges("pose", joints, "rad", recorded.poses),
        _ranges("joint speed", joints, "rad/s", speeds),
        _ranges("speed", command, units, rate * v),
        _ranges("condition", ["‖J⁺‖"], "1/m and 1", norms),
    ]
    return pd.concat(tables, ignore_index=True)


def _ranges(
    quantity: str,
    names: Sequence[str],
    unit: str | Sequence[str],
    array: np.ndarray,
) -> pd.DataFrame:
    """Return name, unit, least and greatest value of a ``quantity`` (..., names)."""
    values = array.reshape(-1, len(names))
    columns = {"quantity": quantity, "name": names, "unit": unit}
    columns |= {"least": values.min(axis=0), "greatest": values.max(axis=0)}
    return pd.DataFrame(columns)


def truth_of(dataset: Dataset) -> Path:
    """Return the folder of a synthetic dataset's truth, which only the stage ``score`` reads."""
    return Path(dataset.recordings).parent / "truth"
