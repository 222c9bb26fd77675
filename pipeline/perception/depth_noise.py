"""Noise of the depth camera in the joint angles: mean and covariance over the time of the motion,
from other takes, and slope on the state, S of y = q* + (I + S)(q − q*) + noise.

Between samples of the motion capture a line misses short deviations, which makes a slope of its
own: frames near a sample are counted apart.
"""

import numpy as np
import pandas as pd

from pipeline.core.columns import columns, members, spread, triangle, values
from pipeline.core.errors import RecordingError

NEAR = 0.1  # of a step between samples of the motion capture: a frame that is near one
NEAR_A_SAMPLE, ALL = "near a sample", "all"


def errors_of(angles: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Return depth camera minus motion capture (family e, rad) at every depth frame."""
    names, errors = members(angles, "q"), []
    for take, rows in angles.groupby("take"):
        truth = joints[joints["take"] == take]
        inside = rows[(rows["t"] >= 0) & (rows["t"] <= truth["t"].iloc[-1])]
        error = values(inside, "q") - _interpolated(inside["t"], truth, names)
        errors.append(inside[["take", "frame", "t"]].assign(**spread("e", names, error)))
    return pd.concat(errors, ignore_index=True)


def _interpolated(times: pd.Series, joints: pd.DataFrame, names: tuple[str, ...]) -> np.ndarray:
    """Angles (times, n) of the rows ``joints`` at ``times`` (s), linear in between."""
    angles = [np.interp(times, joints["t"], joints[name]) for name in columns("q", names)]
    return np.stack(angles, axis=-1)


def leave_one_out(errors: pd.DataFrame, *, window: int) -> pd.DataFrame:
    """Return the table ``kinect_noise``: mean and covariance of the ``errors`` of :func:`errors_of`
    at each frame without the take that they will be used on, and ('none') of all takes; the
    covariance pooled over ``window`` frames on either side. Raises RecordingError for too few
    takes.
    """
    names, rows = members(errors, "e"), []
    components, n = columns("e", names), len(names)
    for left_out in [*errors["take"].unique(), "none"]:
        others = errors[errors["take"] != left_out]
        by_frame = others.groupby("frame")
        mean, time, count = by_frame[components].mean(), by_frame["t"].mean(), by_frame.size()
        centred = others[components].to_numpy() - mean.loc[others["frame"]].to_numpy()
        frames = mean.index.to_numpy()
        place = pd.Series(np.arange(len(frames)), frames)[others["frame"]].to_numpy()
        scatter = np.zeros((len(frames), n, n))
        np.add.at(scatter, place, centred[:, :, None] * centred[:, None, :])
        near = np.abs(frames[:, None] - frames[None, :]) <= window
        # one degree of freedom is spent on each frame's mean
        freedom = near @ (count.to_numpy() - 1)
        # a covariance of fewer samples than this is singular
        if len(frames) == 0 or freedom.min() < n + 1:
            message = "too few test takes to estimate the depth camera's noise from the others;"
            message += " record more, or widen articulation.noise_window"
            samples = int(freedom.min()) if len(frames) else 0
            raise RecordingError(message, take=left_out, samples=samples)
        covariance = np.tensordot(near, scatter, axes=1) / freedom[:, None, None]
        table = {"take": left_out, "frame": frames, "t": time.to_numpy()}
        table |= spread("b", names, mean.to_numpy()) | triangle("r", names, covariance)
        rows.append(pd.DataFrame(table))
    return pd.concat(rows, ignore_index=True)


def deviations(errors: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Return each frame's deviation of the arm from the mean of the training takes (family d, rad)
    and error of :func:`errors_of` (family e), both about their means over the takes.
    """
    names = members(errors, "e")
    mean = joints[joints["part"] == "training"].groupby("k")[["t", *columns("q", names)]].mean()
    parts = []
    for take, rows in errors.groupby("take", sort=False):
        own = joints[joints["take"] == take]
        d = _interpolated(rows["t"], own, names) - _interpolated(rows["t"], mean, names)
        parts.append(rows.assign(**spread("d", names, d)))
    table = pd.concat(parts)
    families = columns("d", names) + columns("e", names)
    table[families] -= table.groupby("frame")[families].transform("mean")
    return table


def error_slopes(table: pd.DataFrame, step: float, pose: np.ndarray) -> pd.DataFrame:
    """Slope of each joint's error on its own deviation in the ``table`` of :func:`deviations`:
    frames, joint, number, slope, standard_error, scatter of both in rad; ``step`` s between
    samples; ``pose`` (n, n) rad² noise of a measured pose, taken out of both. Standard errors allow
    for what a take's errors share (Liang and Zeger 1986). A slope of fewer than two takes is a gap.
    """
    rows, names, share = [], members(table, "e"), np.mod(table["t"].to_numpy() / step, 1.0)
    near = np.minimum(share, 1 - share) <= NEAR
    for frames, inside in ((NEAR_A_SAMPLE, near), (ALL, np.ones_like(near))):
        part, after = table[inside], share[inside]
        # a line between two samples averages their noise
        noise = np.sum((1 - after) ** 2 + after**2) * np.diag(pose)
        errors = values(part, "d").T, values(part, "e").T
        for joint, d, e, own in zip(names, *errors, noise, strict=True):
            slope, standard_error = _slope(d, e, part["take"], own)
            row = {"frames": frames, "joint": joint, "number": len(part), "slope": slope}
            rms = [float(np.sqrt(np.mean(s**2))) if len(s) else np.nan for s in (d, e)]
            row |= {"standard_error": standard_error, "deviation": rms[0], "scatter": rms[1]}
            rows.append(row)
    return pd.DataFrame(rows)


def slope_scores(slopes: pd.DataFrame) -> dict[str, float]:
    """The slopes of :func:`error_slopes` over the frames near a sample, by names; no gaps."""
    rows = slopes[(slopes["frames"] == NEAR_A_SAMPLE) & np.isfinite(slopes["slope"])]
    names = "depth_error_slope_" + rows["joint"]
    scores = dict(zip(names, rows["slope"], strict=True))
    return scores | dict(zip(names + "_standard_error", rows["standard_error"], strict=True))


def _slope(d: np.ndarray, e: np.ndarray, takes: pd.Series, noise: float) -> tuple[float, float]:
    """Slope of ``e`` on ``d`` (rows,) and its standard error; ``noise`` rad² in the sum of d²."""
    number, power = takes.nunique(), np.sum(d**2)
    if number < 2 or not power > noise:
        return np.nan, np.nan
    score = pd.Series(d * (e - d * (np.sum(d * e) / power)), index=takes.index)
    by_take = score.groupby(takes).sum().to_numpy()
    error = np.sqrt(number / (number - 1) * np.sum(by_take**2)) / (power - noise)
    return float((np.sum(d * e) + noise) / (power - noise)), float(error)
