"""The measurements that a dataset's test takes are filtered by: joint angles from the depth camera,
the readings of the encoders, or the poses of the tip.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.frames import rigid_motion
from pipeline.arm.urdf import describe
from pipeline.core import contracts
from pipeline.core.columns import columns, values
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Dataset
from pipeline.core.options.instruments import Mocap
from pipeline.filtering.encoder_noise import EncoderNoise, encoder_noise
from pipeline.filtering.measurement import Measurements, measurements

MOTION, TRACK, ARTICULATE = Path("data/ingest/motion"), Path("data/track"), Path("data/articulate")


def measured_takes(dataset: Dataset) -> list[Measurements]:
    """Of every test take, in the order of their names, what ``dataset.measurement`` chooses, from
    the tables of the stages before; none where the dataset has no depth camera to choose.

    Raises ConfigError where the instrument that is chosen is none of the dataset's, and where
    nothing says how far it is off.
    """
    if dataset.measurement == "depth":
        if not contracts.exists("angles", ARTICULATE):
            return []
        tables = [contracts.read(name, ARTICULATE) for name in ("angles", "kinect_noise")]
        return measurements(*tables)
    joints = contracts.read("joints", TRACK)
    takes = joints.loc[joints["part"] == "test", "take"].unique()
    if dataset.measurement == "encoders":
        noise = noise_of_encoders(dataset)
        rows = _of_takes("encoders", takes, "dataset.encoders", dataset.encoders)
        return [_encoders(take, each, dataset, noise) for take, each in rows]
    if dataset.robot.plane:
        message = "the pose of the tip is measured of an arm in space, not of one in a plane"
        raise ConfigError(message, key="dataset.measurement")
    rows = _of_takes("markers", takes, "dataset.mocap.deviation", dataset.mocap)
    tool = describe(dataset.robot).tip
    return [tip_poses(take, each, dataset.mocap, tool) for take, each in rows]


def _of_takes(name: str, takes: np.ndarray, key: str, stated: object) -> list[tuple]:
    """Of each of the ``takes`` its rows of the table ``name``."""
    if stated is None:
        raise ConfigError("the filter is to weigh by what the dataset does not have", key=key)
    table = contracts.read(name, MOTION)
    held = dict(list(table[table["take"].isin(takes)].groupby("take")))
    if absent := sorted(set(takes) - set(held)):
        raise ConfigError(f"nothing is measured of the takes {', '.join(absent)}", key=key)
    return sorted(held.items())


def noise_of_encoders(dataset: Dataset) -> EncoderNoise:
    """How far the encoders were off in the training takes, as the motion capture saw them."""
    joints = contracts.read("joints", TRACK)
    takes = joints.loc[joints["part"] == "training", "take"].unique()
    rows = _of_takes("encoders", takes, "dataset.encoders", dataset.encoders)
    errors = []
    for take, read in rows:
        observed = joints[joints["take"] == take]
        y = values(read, "q")
        at_steps = [np.interp(observed["t"], read["t"], reading) for reading in y.T]
        errors.append(np.stack(at_steps, axis=-1) - values(observed, "q"))
    return encoder_noise(np.stack(errors), 1 / dataset.motion.rate)


def _encoders(take: str, rows: pd.DataFrame, dataset: Dataset, noise: EncoderNoise) -> Measurements:
    """A reading for each step of the motion grid: what is read in between has the same error."""
    rate = 1 / rows["t"].diff().median()
    read = rows[:: max(1, round(rate / dataset.motion.rate))]
    t, y = read["t"].to_numpy(), read[columns("q", dataset.robot.joints)].to_numpy()
    bias, covariance = noise.of_readings(t)
    return Measurements(str(take), t, y, bias, covariance)


def tip_poses(take: str, rows: pd.DataFrame, mocap: Mocap, tool: str) -> Measurements:
    """The poses of the link ``tool`` in the base's axes from the ``rows`` of a take in the table
    ``markers``, at the frames that show three of its points; of their noise the covariance that
    white noise of ``mocap.deviation`` in each coordinate of a point makes of the least-squares
    pose.

    Raises ConfigError where no points on that link are known, or their deviation is not.
    """
    if tool not in mocap.markers or mocap.deviation is None:
        raise ConfigError(
            f"the pose of {tool!r} needs its markers or body, dataset.mocap.markers.{tool}, and "
            "the deviation of a marker",
            key="dataset.mocap.deviation",
        )
    number = list(mocap.markers).index(tool) + 1
    observed = rows[rows["link"] == number].sort_values(["marker", "k"], kind="stable")
    places = np.array(list(mocap.markers[tool].values()), dtype=float)
    points = observed[["x", "y", "z"]].to_numpy().reshape(len(places), -1, 3).transpose(1, 0, 2)
    rotation, position = rigid_motion(places, points)
    known = np.isfinite(position).all(axis=1)
    t = observed["t"].to_numpy()[: len(points)][known]
    present = np.isfinite(points).all(axis=-1)[known]
    rotation, position = rotation[known], position[known]
    # a displacement (δ, θ) moves the point at lever r from the tip by δ + θ × r
    lever = np.einsum("fab,pb->fpa", rotation, places)
    moves = np.zeros((*lever.shape, 6))
    moves[..., :3] = np.eye(3)
    for row, column, axis, sign in (
        (0, 1, 2, 1), (0, 2, 1, -1), (1, 0, 2, -1), (1, 2, 0, 1), (2, 0, 1, 1), (2, 1, 0, -1)
    ):  # fmt: skip
        moves[..., row, 3 + column] = sign * lever[..., axis]
    moves *= present[..., None, None]
    information = np.einsum("fpai,fpaj->fij", moves, moves)
    y = np.hstack([position, rotation.reshape(-1, 9)])
    covariance = mocap.deviation**2 * np.linalg.inv(information)
    return Measurements(str(take), t, y, np.zeros((len(y), 6)), covariance, tip=True)
