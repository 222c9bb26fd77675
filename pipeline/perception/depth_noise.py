"""The depth camera's noise in the joint angles: its mean and covariance over the time of the
motion, as other takes show it.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.core.columns import columns, members, spread, triangle, values
from pipeline.core.errors import RecordingError


def errors_of(angles: pd.DataFrame, joints: pd.DataFrame) -> pd.DataFrame:
    """Depth camera minus motion capture at every depth frame during the motion, the motion capture
    interpolated linearly at its time.

    ``angles``: the table of the depth camera's joint angles; ``joints``: that of the motion
    capture's, in the order of time. Returns take, frame, t (s) and the family e (rad).
    """
    names, errors = members(angles, "q"), []
    for take, rows in angles.groupby("take"):
        truth = joints[joints["take"] == take]
        inside = rows[(rows["t"] >= 0) & (rows["t"] <= truth["t"].iloc[-1])]
        at_frames = [
            np.interp(inside["t"], truth["t"], truth[column]) for column in columns("q", names)
        ]
        error = values(inside, "q") - np.stack(at_frames, axis=-1)
        errors.append(inside[["take", "frame", "t"]].assign(**spread("e", names, error)))
    return pd.concat(errors, ignore_index=True)


def leave_one_out(errors: pd.DataFrame, *, window: int) -> pd.DataFrame:
    """Mean and covariance of the noise at each frame without the take that they will be used on,
    and ('none') of all takes.

    ``errors`` are those of :func:`errors_of`. The mean of a frame is that over the other takes; the
    covariance is that of their deviations from the means, pooled over ``window`` frames on either
    side, so that it varies with time as smoothly as a moving arm looks. Returns the table
    ``kinect_noise``. Raises RecordingError where the other takes are too few, or have no such
    frame.
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
            raise RecordingError(
                "too few test takes to estimate the depth camera's noise from the others; record "
                "more, or widen articulation.noise_window",
                take=left_out,
                samples=int(freedom.min()) if len(frames) else 0,
            )
        covariance = np.tensordot(near, scatter, axes=1) / freedom[:, None, None]
        table = {"take": left_out, "frame": frames, "t": time.to_numpy()}
        table |= spread("b", names, mean.to_numpy()) | triangle("r", names, covariance)
        rows.append(pd.DataFrame(table))
    return pd.concat(rows, ignore_index=True)
