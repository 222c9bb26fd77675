"""Measurements of a dataset's test takes by the instrument that the dataset names."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.frames import rigid_motion
from pipeline.arm.urdf import describe
from pipeline.core import contracts
from pipeline.core.columns import columns, values
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Dataset, Mocap
from pipeline.filtering.measurement import Measurements, measurements

MOTION, TRACK, ARTICULATE = Path("data/ingest/motion"), Path("data/track"), Path("data/articulate")


def measured_takes(dataset: Dataset) -> list[Measurements]:
    """Return the measurements of every test take, by name, that ``dataset.measurement`` chooses
    from the tables of earlier stages; none for a dataset without a depth camera to choose.

    Raises ConfigError where the dataset lacks the chosen instrument or its noise.
    """
    if dataset.measurement == "depth":
        if not contracts.exists("angles", ARTICULATE):
            return []
        return measurements(*(contracts.read(n, ARTICULATE) for n in ("angles", "kinect_noise")))
    joints = contracts.read("joints", TRACK)
    if dataset.measurement == "encoders":
        return _encoder_takes(dataset, joints)
    if dataset.robot.plane:
        message = "the pose of the tip is measured of an arm in space, not of one in a plane"
        raise ConfigError(message, key="dataset.measurement")
    rows = _rows_of("markers", joints, "test", "dataset.mocap.deviation", dataset.mocap)
    tool = describe(dataset.robot).tip
    return [tip_poses(take, each, dataset.mocap, tool) for take, each in rows]


def _rows_of(
    name: str, joints: pd.DataFrame, part: str, key: str, instrument: object
) -> list[tuple]:
    """Return (take, rows) of the table ``name`` of each take of ``joints`` in the ``part``."""
    if instrument is None:
        raise ConfigError("the filter needs measurements that the dataset does not have", key=key)
    takes, table = joints.loc[joints["part"] == part, "take"], contracts.read(name, MOTION)
    by_take = dict(list(table[table["take"].isin(takes)].groupby("take")))
    if absent := sorted(set(takes) - set(by_take)):
        raise ConfigError(f"there are no measurements of the takes {', '.join(absent)}", key=key)
    return sorted(by_take.items())


@dataclass(frozen=True)
class EncoderNoise:
    """Errors of n encoders at the K steps of the motion, ``dt`` (s) apart."""

    bias: np.ndarray  # (K, n) rad, mean error
    covariance: np.ndarray  # (K, n, n) rad², of one reading about it
    lasts: float  # s, correlation time of an error
    dt: float

    def of_readings(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (F, n) rad the bias of readings at the sorted times ``t`` (F,) in s, and (F, n, n)
        rad² the covariance by which they may be taken for independent.

        The readings within :attr:`lasts` tell together no more than one of them, so each has their
        number times its own covariance, as in the variance of the mean of a correlated sequence
        (Priestley, Spectral Analysis and Time Series, 1981).
        """
        steps = np.arange(len(self.bias))
        place = np.clip(t / self.dt, 0, steps[-1])
        bias = np.stack([np.interp(place, steps, b) for b in self.bias.T], axis=-1)
        together = max(1.0, self.lasts / float(np.median(np.diff(t)))) if len(t) > 1 else 1.0
        return bias, together * self.covariance[np.round(place).astype(int)]


def encoder_noise(errors: np.ndarray, dt: float) -> EncoderNoise:
    """Estimate the noise from ``errors`` (takes, K, n), rad, reading minus truth every ``dt`` s.

    The correlation time is the sum of the correlations over all lags, one value for all joints. The
    covariance of a step is pooled over as long on either side, about the mean of each step.
    """
    takes, steps, n = errors.shape
    bias = errors.mean(axis=0)
    off = errors - bias
    squares = np.sum(off**2)
    lasting = np.sum(off.sum(axis=1) ** 2) / squares if squares > 0 else 1.0
    total, window = np.zeros((steps + 1, n, n)), round(lasting)
    total[1:] = np.cumsum(np.einsum("tki,tkj->kij", off, off), axis=0)
    first = np.maximum(np.arange(steps) - window, 0)
    last = np.minimum(np.arange(steps) + window + 1, steps)
    freedom = (takes - 1) * (last - first)
    covariance = (total[last] - total[first]) / freedom[:, None, None]
    return EncoderNoise(bias, covariance, lasting * dt, dt)


def _encoder_takes(dataset: Dataset, joints: pd.DataFrame) -> list[Measurements]:
    """Return a reading for each step of the motion grid, as those in between have the same error,
    with the noise of the training takes, the motion capture taken for the truth.
    """
    rate, errors, takes = dataset.motion.rate, [], []
    training, test = (
        _rows_of("encoders", joints, part, "dataset.encoders", dataset.encoders)
        for part in ("training", "test")
    )
    for take, read in training:
        observed = joints[joints["take"] == take]
        at_steps = [np.interp(observed["t"], read["t"], y) for y in values(read, "q").T]
        errors.append(np.stack(at_steps, axis=-1) - values(observed, "q"))
    noise = encoder_noise(np.stack(errors), 1 / rate)
    for take, rows in test:
        read = rows[:: max(1, round(1 / rows["t"].diff().median() / rate))]
        t, y = read["t"].to_numpy(), read[columns("q", dataset.robot.joints)].to_numpy()
        takes.append(Measurements(str(take), t, y, *noise.of_readings(t)))
    return takes


def tip_poses(take: str, rows: pd.DataFrame, mocap: Mocap, tool: str) -> Measurements:
    """Return the poses of the link ``tool`` in the base's axes from the ``rows`` of a take in the
    table ``markers``, at the frames that show three of its points.

    The covariance of a pose is the one of its least-squares fit under white noise of
    ``mocap.deviation`` in each coordinate of a point. Raises ConfigError where the dataset states
    no points on that link, or no deviation.
    """
    if tool not in mocap.markers or mocap.deviation is None:
        needed = f"its markers or body, dataset.mocap.markers.{tool}, and the deviation of a marker"
        raise ConfigError(f"the pose of {tool!r} needs {needed}", key="dataset.mocap.deviation")
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
    moves[..., 3:] = np.cross(np.eye(3), lever[..., None, :]).swapaxes(-1, -2)
    moves *= present[..., None, None]
    information = np.einsum("fpai,fpaj->fij", moves, moves)
    y = np.hstack([position, rotation.reshape(-1, 9)])
    covariance = mocap.deviation**2 * np.linalg.inv(information)
    return Measurements(str(take), t, y, np.zeros((len(y), 6)), covariance, tip=True)
