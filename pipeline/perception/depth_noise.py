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
NEAR_A_SAMPLE, ALL = "near a sample", "all"


def errors_of(angles: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Return the angle errors, depth camera minus motion capture (family e, rad), by frame."""
    names, errors = members(angles, "q"), []
    for take, rows in angles.groupby("take"):
        truth = joints[joints["take"] == take]
        inside = rows[(rows["t"] >= 0) & (rows["t"] <= truth["t"].iloc[-1])]
        error = values(inside, "q") - _interpolate(inside["t"], truth, names)
        errors.append(
            inside[["take", "frame", "t"]].assign(**spread("e", names, error))
        )
    return pd.concat(errors, ignore_index=True)


def _interpolate(
    times: pd.Series, joints: pd.DataFrame, names: tuple[str, ...]
) -> np.ndarray:
    """Return the joint angles (times, n) in rad at ``times`` in s by linear interpolation."""
    angles = [
        np.interp(times, joints["t"], joints[name]) for name in columns("q", names)
    ]
    return np.stack(angles, axis=-1)


def leave_one_out(errors: pd.DataFrame, *, window: int) -> pd.DataFrame:
    """Return the table ``kinect_noise``: mean and covariance of ``errors`` (:func:`errors_of`) at
    each frame, over all takes but one and over all takes ('none'). The covariance is pooled over
    ``window`` frames on either side. Raises RecordingError for too few takes.
    """
    names, rows = members(errors, "e"), []
    components, n = columns("e", names), len(names)
    for left_out in [*errors["take"].unique(), "none"]:
        others = errors[errors["take"] != left_out]
        by_frame = others.groupby("frame")
        mean, time, count = (
            by_frame[components].mean(),
            by_frame["t"].mean(),
            by_frame.size(),
        )
        centred = others[components].to_numpy() - mean.loc[others["frame"]].to_numpy()
        frames = mean.index.to_numpy()
        scatter = np.zeros((len(frames), n, n))
        place = np.searchsorted(frames, others["frame"])
        np.add.at(scatter, place, centred[:, :, None] * centred[:, None, :])
        near = np.abs(frames[:, None] - frames[None, :]) <= window
        freedom = near @ (
            count.to_numpy() - 1
        )  # each frame's mean takes one degree of freedom
        samples = int(freedom.min()) if len(frames) else 0
        if samples < n + 1:  # fewer samples give a singular covariance
            message = "too few test takes to estimate the depth camera's noise from the others;"
            message += " record more, or widen articulation.noise_window"
            raise RecordingError(message, take=left_out, samples=samples)
        covariance = np.tensordot(near, scatter, axes=1) / freedom[:, None, None]
        table = {"take": left_out, "frame": frames, "t": time.to_numpy()}
        table |= spread("b", names, mean.to_numpy()) | triangle("r", names, covariance)
        rows.append(pd.DataFrame(table))
    return pd.concat(rows, ignore_index=True)


def deviations(errors: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Return the deviation of the arm from the mean of the training takes (family d, rad) and the
    error of :func:`errors_of` (family e) at each frame, minus their means over the takes.
    """
    names = members(errors, "e")
    mean = (
        joints[joints["part"] == "training"]
        .groupby("k")[["t", *columns("q", names)]]
        .mean()
    )
    parts = []
    for take, rows in errors.groupby("take", sort=False):
        measured = joints[joints["take"] == take]
        d = _interpolate(rows["t"], measured, names) - _interpolate(
            rows["t"], mean, names
        )
        parts.append(rows.assign(**spread("d", names, d)))
    table = pd.concat(parts)
    families = columns("d", names) + columns("e", names)
    table[families] -= table.groupby("frame")[families].transform("mean")
    return table


def error_slopes(table: pd.DataFrame, step: float, pose: np.ndarray) -> pd.DataFrame:
    """Tabulate the slope of each joint's error on the joint's deviation in the ``table`` of
    :func:`deviations`: frames, joint, slope, standard_error; NaN for fewer than two takes.

    ``step`` is the time between samples in s; the effect of the noise covariance ``pose`` (n, n) in
    rad² of a measured pose is removed. Standard errors are clustered by take (Liang, Zeger 1986).
    """
    rows, names, share = (
        [],
        members(table, "e"),
        np.mod(table["t"].to_numpy() / step, 1.0),
    )
    near = np.minimum(share, 1 - share) <= NEAR
    for frames, inside in ((NEAR_A_SAMPLE, near), (ALL, np.ones_like(near))):
        part, after = table[inside], share[inside]
        # interpolation averages the noise of two samples
        noise = np.sum((1 - after) ** 2 + after**2) * np.diag(pose)
        errors = values(part, "d").T, values(part, "e").T
        for joint, d, e, variance in zip(names, *errors, noise, strict=True):
            rows.append((frames, joint, *_slope(d, e, part["take"], variance)))
    return pd.DataFrame(rows, columns=["frames", "joint", "slope", "standard_error"])


def _slope(
    d: np.ndarray, e: np.ndarray, takes: pd.Series, noise: float
) -> tuple[float, float]:
    """Return the slope of ``e`` on ``d`` (rows,) and its standard error; Σd² has ``noise`` rad²."""
    number, power = takes.nunique(), np.sum(d**2)
    if number < 2 or not power > noise:
        return np.nan, np.nan
    score = pd.Series(d * (e - d * (np.sum(d * e) / power)), index=takes.index)
    by_take = score.groupby(takes).sum().to_numpy()
    error = np.sqrt(number / (number - 1) * np.sum(by_take**2)) / (power - noise)
    return float((np.sum(d * e) + noise) / (power - noise)), float(error)
