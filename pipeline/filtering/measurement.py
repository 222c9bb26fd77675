"""Measurements of the joint angles during one take, y_j = q(t_j) + b_j + N(0, R_j), with a bias and
a covariance per frame, and the measurements of a dataset's test takes.

The paper does not state how frames at 30 Hz are compared with steps at 100 Hz. The velocity of a
motion model is constant within a step. So a frame is compared with the pose interpolated at its
time between the two ends of the step: the exact likelihood of that path.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.core import contracts
from pipeline.core.columns import columns, matrices, members, values
from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.core.options.dataset import Dataset

MOTION = Path("data/ingest/motion")
TRACK = Path("data/track")
ARTICULATE = Path("data/articulate")
SHARE_DIGITS = 6  # of times in steps: 0.03 s / 0.01 s is step 3, not a later step
SINGULAR_VARIANCE = 1e-12  # least/greatest variance of R at which R counts as singular


class Frames(NamedTuple):
    """The F measurements in order of their steps; frames first[k] to first[k+1] are in step k. The
    density of y is proportional to exp(−‖whitening·(y − bias − q)‖²/2) for the pose q at ``share``
    of the step.
    """

    first: ndarray  # (M+2,)
    share: ndarray  # (F,)
    unbiased: ndarray  # (F, n) joint angles without bias, rad
    whitening: ndarray  # (F, n, n) lower triangular, 1/rad


@dataclass(frozen=True)
class Measurements:
    """The F ≥ 0 frames of one take."""

    take: str
    t: ndarray  # (F,) times on the motion clock, s, in any order
    y: ndarray  # (F, n) measured joint angles, rad
    bias: ndarray  # (F, n) rad, mean of the noise
    covariance: ndarray  # (F, n, n) rad², covariance R of the noise

    def schedule(self, steps: int, dt: float) -> tuple[ndarray, ndarray, ndarray]:
        """Return indices, steps k and shares of the step (F',) of the frames within ``steps`` steps
        of ``dt`` (s), in order of k. A frame at t_k has share 1 of the step that ends there; a
        frame at the start of the motion has share 1 of k = 0.
        """
        position = np.round(self.t / dt, SHARE_DIGITS)
        inside = np.flatnonzero((position >= 0) & (position <= steps))
        order = np.argsort(np.ceil(position[inside]), kind="stable")
        frame = inside[order]
        place = position[frame]
        step = np.ceil(place).astype(int)
        return frame, step, place - step + 1

    def frames(self, steps: int, dt: float) -> Frames:
        """Return the frames of :meth:`schedule`; raises ModelDomainError as :attr:`whitening`."""
        frame, step, share = self.schedule(steps, dt)
        first = np.searchsorted(step, np.arange(steps + 2))
        unbiased = self.y[frame] - self.bias[frame]
        return Frames(first, share, unbiased, self.whitening[frame])

    @cached_property
    def whitening(self) -> ndarray:
        """Lower triangular inverses (F, n, n) of the Cholesky factors of R. Raises ModelDomainError
        where R is not positive definite.
        """
        variances = np.linalg.eigvalsh(self.covariance)
        singular = variances[:, 0] <= SINGULAR_VARIANCE * variances[:, -1]
        if singular.any():
            raise ModelDomainError(
                "the covariance of the measurement's noise is not positive definite; estimate it "
                "from more takes than joints",
                take=self.take,
                frame=int(np.argmax(singular)),
            )
        return np.linalg.inv(np.linalg.cholesky(self.covariance))


def measurements(angles: pd.DataFrame, noise: pd.DataFrame) -> list[Measurements]:
    """Return the depth camera's measurements of every take from the tables ``angles`` and
    ``kinect_noise``; the noise of a take is estimated from the other takes.
    """
    joints = members(angles, "q")
    takes = []
    for take, rows in angles.groupby("take"):
        noise_of_take = noise[noise["take"] == take].set_index("frame")
        # no noise is estimated at a frame that no other take has
        rows = rows[rows["frame"].isin(noise_of_take.index)]
        noise_of_frames = noise_of_take.loc[rows["frame"]]
        takes.append(
            Measurements(
                take=str(take),
                t=rows["t"].to_numpy(),
                y=values(rows, "q"),
                bias=values(noise_of_frames, "b"),
                covariance=matrices(noise_of_frames, "r", joints),
            ),
        )
    return takes


def measured_takes(dataset: Dataset) -> list[Measurements]:
    """Return the measurements of every test take by the instrument ``dataset.measurement``; [] for
    a missing depth camera. Raises ConfigError for any other missing instrument.
    """
    if dataset.measurement == "depth":
        if not contracts.exists("angles", ARTICULATE):
            return []
        angles = contracts.read("angles", ARTICULATE)
        return measurements(angles, contracts.read("kinect_noise", ARTICULATE))
    return _encoder_takes(dataset, contracts.read("joints", TRACK))


def _encoder_rows(joints: pd.DataFrame, part: str) -> list[tuple]:
    """Return (take, rows) of the table ``encoders`` for the takes of ``joints`` in the ``part``."""
    takes = joints.loc[joints["part"] == part, "take"]
    table = contracts.read("encoders", MOTION)
    absent = sorted(set(takes) - set(table["take"]))
    if absent:
        message = f"there are no measurements of the takes {', '.join(absent)}"
        raise ConfigError(message, key="dataset.encoders")
    rows = table[table["take"].isin(takes)]
    return list(rows.groupby("take"))


class EncoderNoise(NamedTuple):
    """Noise of n encoders at the K steps of the motion, ``dt`` (s) apart."""

    bias: ndarray  # (K, n) rad
    covariance: ndarray  # (K, n, n) rad², of one reading
    lasts: float  # s, correlation time of an error
    dt: float

    def of_readings(self, t: ndarray) -> tuple[ndarray, ndarray]:
        """Return bias (F, n) in rad and covariance (F, n, n) in rad² of readings at the sorted
        times ``t`` (F,) in s. To count as independent with equal information, the covariance of one
        reading is multiplied by the number of readings within :attr:`lasts`, as for the mean of a
        correlated sequence (Priestley, Spectral Analysis and Time Series, 1981).
        """
        steps = np.arange(len(self.bias))
        place = np.clip(t / self.dt, 0, steps[-1])
        bias = np.empty((len(t), self.bias.shape[1]))
        for encoder, bias_at_steps in enumerate(self.bias.T):
            bias[:, encoder] = np.interp(place, steps, bias_at_steps)
        correlated = 1.0  # readings within ``lasts``
        if len(t) > 1:
            period = float(np.median(np.diff(t)))
            correlated = max(1.0, self.lasts / period)
        nearest = np.round(place).astype(int)
        return bias, correlated * self.covariance[nearest]


def encoder_noise(errors: ndarray, dt: float) -> EncoderNoise:
    """Estimate the noise from ``errors`` (takes, K, n), rad, reading minus truth every ``dt`` s.
    The correlation time is the sum of correlations over all lags, one value for all joints. The
    covariance of a step is pooled over the steps within this time, about the mean of each step.
    """
    takes, steps, n = errors.shape
    bias = errors.mean(axis=0)
    deviation = errors - bias
    squares = np.sum(deviation**2)
    lasting = 1.0  # correlation time in steps
    if squares > 0:
        lasting = np.sum(deviation.sum(axis=1) ** 2) / squares

    products = np.einsum("tki,tkj->kij", deviation, deviation)
    total = np.zeros((steps + 1, n, n))
    total[1:] = np.cumsum(products, axis=0)
    window = round(lasting)
    step = np.arange(steps)
    first = np.maximum(step - window, 0)
    last = np.minimum(step + window + 1, steps)
    freedom = (takes - 1) * (last - first)[:, None, None]
    covariance = (total[last] - total[first]) / freedom
    return EncoderNoise(bias, covariance, lasting * dt, dt)


def _encoder_takes(dataset: Dataset, joints: pd.DataFrame) -> list[Measurements]:
    """Return one reading per step of the motion, as the errors within a step are equal. The noise
    is estimated from the training takes against the motion capture.
    """
    if dataset.encoders is None:
        message = "the filter needs measurements that the dataset does not have"
        raise ConfigError(message, key="dataset.encoders")
    rate = dataset.motion.rate
    errors = []
    for take, readings in _encoder_rows(joints, "training"):
        tracked = joints[joints["take"] == take]
        at_steps = [
            np.interp(tracked["t"], readings["t"], angle)
            for angle in values(readings, "q").T
        ]
        errors.append(np.stack(at_steps, axis=-1) - values(tracked, "q"))
    noise = encoder_noise(np.stack(errors), 1 / rate)

    takes = []
    for take, rows in _encoder_rows(joints, "test"):
        readings_per_step = max(1, round(1 / rows["t"].diff().median() / rate))
        readings = rows[::readings_per_step]
        t = readings["t"].to_numpy()
        y = readings[columns("q", dataset.robot.joints)].to_numpy()
        takes.append(Measurements(str(take), t, y, *noise.of_readings(t)))
    return takes
