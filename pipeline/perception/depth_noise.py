"""Noise of the depth camera in the joint angles: mean and covariance at each time of the motion.

The noise of a take is estimated from the other takes. The slope S of the error on the deviation is
defined by y = q* + (I + S)(q − q*) + noise. Interpolated motion capture misses short deviations,
which causes a slope; a second slope therefore uses only frames near a sample.
"""

import numpy as np
import pandas as pd

from pipeline.core.columns import columns, members, spread, triangle, values
from pipeline.core.errors import RecordingError

NEAR = 0.1  # greatest distance of a near frame from a sample, as a share of the sampling step
NEAR_A_SAMPLE = "near a sample"
ALL = "all"


def errors_of(angles: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Return the angle errors, depth camera minus motion capture (family e, rad), by frame."""
    names = members(angles, "q")
    tables = []
    truth_by_take = dict(list(joints.groupby("take")))
    for take, rows in angles.groupby("take"):
        truth = truth_by_take[take]
        end = truth["t"].iloc[-1]
        rows = rows[rows["t"].between(0, end)]
        error = values(rows, "q") - _interpolate(rows["t"], truth, names)
        table = rows[["take", "frame", "t"]].assign(**spread("e", names, error))
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _interpolate(
    times: pd.Series,
    joints: pd.DataFrame,
    names: tuple[str, ...],
) -> np.ndarray:
    """Return the joint angles (times, n) in rad at ``times`` in s by linear interpolation."""
    angles = []
    for column in columns("q", names):
        angles.append(np.interp(times, joints["t"], joints[column]))
    return np.stack(angles, axis=-1)


def leave_one_out(errors: pd.DataFrame, *, window: int) -> pd.DataFrame:
    """Return the table ``kinect_noise``: mean and covariance of ``errors`` (:func:`errors_of`) at
    each frame, over all takes but one and over all takes ('none'). The covariance is pooled over
    ``window`` frames on either side. Raises RecordingError for too few takes.
    """
    names = members(errors, "e")
    tables = []
    components = columns("e", names)
    n = len(names)
    for left_out in [*errors["take"].unique(), "none"]:
        used = errors[errors["take"] != left_out]
        by_frame = used.groupby("frame")
        mean = by_frame[components].mean()
        time = by_frame["t"].mean()
        frames = mean.index.to_numpy()
        mean_of_rows = mean.loc[used["frame"]].to_numpy()
        centred = used[components].to_numpy() - mean_of_rows

        scatter = np.zeros((len(frames), n, n))
        place = np.searchsorted(frames, used["frame"])
        products = centred[:, :, None] * centred[:, None, :]
        np.add.at(scatter, place, products)

        apart = frames[:, None] - frames[None, :]
        near = np.abs(apart) <= window
        # each frame's mean takes one degree of freedom
        freedom = near @ (by_frame.size().to_numpy() - 1)
        samples = int(freedom.min()) if len(frames) else 0
        if samples < n + 1:  # fewer samples give a singular covariance
            raise RecordingError(
                "too few test takes to estimate the depth camera's noise from the others; "
                "record more, or widen articulation.noise_window",
                take=left_out,
                samples=samples,
            )

        covariance = np.tensordot(near, scatter, axes=1) / freedom[:, None, None]
        table = {"take": left_out, "frame": frames, "t": time.to_numpy()}
        table |= spread("b", names, mean.to_numpy()) | triangle("r", names, covariance)
        tables.append(pd.DataFrame(table))
    return pd.concat(tables, ignore_index=True)


def deviations(errors: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Return the deviation of the arm from the mean of the training takes (family d, rad) and the
    error of :func:`errors_of` (family e) at each frame, minus their means over the takes.
    """
    names = members(errors, "e")
    by_step = joints[joints["part"] == "training"].groupby("k")
    mean = by_step[["t", *columns("q", names)]].mean()
    tables = []
    for take, rows in errors.groupby("take", sort=False):
        measured = joints[joints["take"] == take]
        usual = _interpolate(rows["t"], mean, names)
        d = _interpolate(rows["t"], measured, names) - usual
        tables.append(rows.assign(**spread("d", names, d)))
    table = pd.concat(tables)
    families = columns("d", names) + columns("e", names)
    table[families] -= table.groupby("frame")[families].transform("mean")
    return table


def error_slopes(table: pd.DataFrame, step: float, pose: np.ndarray) -> pd.DataFrame:
    """Tabulate the slope of each joint's error on the joint's deviation in the ``table`` of
    :func:`deviations`: frames, joint, slope, standard_error; NaN for fewer than two takes.

    ``step`` is the time between samples in s; the effect of the noise covariance ``pose`` (n, n) in
    rad² of a measured pose is removed. Standard errors are clustered by take (Liang, Zeger 1986).
    """
    rows = []
    names = members(table, "e")
    share = np.mod(table["t"].to_numpy() / step, 1.0)
    near = np.minimum(share, 1 - share) <= NEAR
    masks = {NEAR_A_SAMPLE: near, ALL: np.ones_like(near)}
    # interpolation averages the noise of two samples
    weights = (1 - share) ** 2 + share**2
    for frames, inside in masks.items():
        used = table[inside]
        noise = np.sum(weights[inside]) * np.diag(pose)
        deviation = values(used, "d")
        error = values(used, "e")
        columns_of_joints = zip(names, deviation.T, error.T, noise, strict=True)
        for joint, d, e, noise_of_joint in columns_of_joints:
            slope = _slope(d, e, used["take"], noise_of_joint)
            rows.append((frames, joint, *slope))
    return pd.DataFrame(rows, columns=["frames", "joint", "slope", "standard_error"])


def _slope(
    d: np.ndarray,
    e: np.ndarray,
    takes: pd.Series,
    noise: float,
) -> tuple[float, float]:
    """Return the slope of ``e`` on ``d`` (rows,) and its standard error; Σd² has ``noise`` rad²."""
    number = takes.nunique()
    power = np.sum(d**2)
    if number < 2 or not power > noise:
        return np.nan, np.nan
    product = np.sum(d * e)
    residual = e - d * (product / power)
    score = pd.Series(d * residual, index=takes.index)
    by_take = score.groupby(takes).sum().to_numpy()

    power_of_arm = power - noise
    variance = number / (number - 1) * np.sum(by_take**2)
    error = np.sqrt(variance) / power_of_arm
    return float((product + noise) / power_of_arm), float(error)
